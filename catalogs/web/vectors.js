// Small vectors, [x, y, z], and how a hand turns a camera.

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const scaled = (s, a) => a.map(x => s * x);
export const plus = (a, b) => a.map((x, i) => x + b[i]);
export const unit = a => scaled(1 / (Math.hypot(...a) || 1), a);
/** The part of `a` at right angles to the unit vector `direction`, of length 1. */
export const across = (a, direction) => unit(plus(a, scaled(-dot(a, direction), direction)));

/**
 * The { direction, up } of a camera (unit vectors, from the target to the camera and upwards) turned by angles (radians).  The
 * object follows the pointer, so the camera goes the other way.
 */
export function turned({ direction, up }, right, down) {
  const level = unit(plus(scaled(Math.cos(right), direction), scaled(-Math.sin(right), cross(up, direction))));
  const moved = unit(plus(scaled(Math.cos(down), level), scaled(Math.sin(down), up)));
  return { direction: moved, up: across(plus(scaled(Math.cos(down), up), scaled(-Math.sin(down), level)), moved) };
}
