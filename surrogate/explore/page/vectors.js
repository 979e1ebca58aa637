// Small vectors, [x, y, z].

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const scaled = (s, a) => a.map(x => s * x);
export const plus = (a, b) => a.map((x, i) => x + b[i]);
export const unit = a => scaled(1 / Math.hypot(...a), a);
/** The part of `a` that stands upright on the unit vector `direction`, of length 1. */
export const across = (a, direction) => unit(plus(a, scaled(-dot(a, direction), direction)));
