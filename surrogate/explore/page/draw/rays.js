// Rays through a field, and transfer functions as they meet them; see native/ray_casting.

import { interpolated } from "draw/nodes.js";

const NARROW = 1 / 256, FARTHEST = 1e6, SHORTEST = 1 / 16, ERROR = 1e-5; // of a mean square: 50 dB
export const SLACK = 1e-3, OPAQUE = 1 / 8192; // of a step that a ray may be longer, and light that is left where it ends
export const SAMPLES = 4; // of a surface, along each side of a pixel

/** A camera's rays in samples: eye + t (u across + v down + corner) for the pixel whose middle is (u, v). */
export function raysOf({ world_to_camera: rows, fx, fy, cx, cy, width, height }, { spacing, origin }) {
  const [right, down, forward] = rows, position = [0, 1, 2].map(k => -(right[k] * right[3] + down[k] * down[3] + forward[k] * forward[3]));
  const inSamples = vector => vector.map((x, k) => x / spacing[k]), corner = [0, 1, 2].map(k => forward[k] - cx / fx * right[k] - cy / fy * down[k]);
  return {
    eye: inSamples(position.map((x, k) => x - origin[k])), across: inSamples(right.slice(0, 3).map(x => x / fx)),
    down: inSamples(down.slice(0, 3).map(x => x / fy)), corner: inSamples(corner), spacing, width, height,
  };
}

/** The map from samples to the camera: {matrix (9,) by rows, shift (3,)}. */
export function cameraOf({ world_to_camera: rows }, { spacing, origin }) {
  const three = rows.slice(0, 3);
  return {
    matrix: three.flatMap(row => [0, 1, 2].map(k => row[k] * spacing[k])),
    shift: three.map(row => row[3] + row[0] * origin[0] + row[1] * origin[1] + row[2] * origin[2]),
  };
}

/** The values that become 0 and 1: the bounds of a function, or of a field (low, high) that spans little of them. */
export function drawnRange([low, high], { color_points: colors, opacity_points: opacities }) {
  const first = Math.min(colors[0][0], opacities[0][0]), last = Math.max(colors.at(-1)[0], opacities.at(-1)[0]);
  return high > low && high - low < NARROW * (last - first) ? [low, high] : [first, last];
}

/** Rows (K, 5) of place, opacity, red, green and blue, between which a function is linear over a range. */
export function knotsOf({ color_points: colors, opacity_points: opacities }, [low, high]) {
  const values = new Set([...opacities.map(point => point[0]), ...colors.map(point => point[0]), low, high]);
  return [...values].filter(value => value >= low && value <= high).sort((a, b) => a - b).map(value =>
    [(value - low) / (high - low), interpolated(opacities, value), ...[1, 2, 3].map(channel => interpolated(colors, value, channel))]);
}

/** Values (V,) of which 0 to 1 is drawn. */
export function drawnValues(values, [low, high]) {
  const perUnit = 1 / (high - low);
  return Float32Array.from(values, value => Math.min(Math.max((value - low) * perUnit, -FARTHEST), FARTHEST));
}

/** As many cells (V,) as samples: 1 where one of the eight corners is a hole. */
export function hiddenCells({ holes, size: [nx, ny] }) {
  const hidden = new Uint8Array(holes.length), offsets = [0, 1, nx, nx + 1].flatMap(offset => [offset, offset + nx * ny]);
  for (let at = 0; at < holes.length; ++at) hidden[at] = offsets.some(offset => holes[at + offset]) ? 1 : 0;
  return hidden;
}

/** The longest of 1, 1/2, 1/4, ... of the smallest spacing whose small image `draw(camera, distance)` is good enough, world units. */
export function fittingDistance(draw, camera, spacing) {
  const least = Math.min(...spacing);
  let distance = least, image = draw(camera, distance);
  while (distance > SHORTEST * least) {
    const finer = draw(camera, distance / 2), error = image.reduce((sum, x, k) => sum + (x - finer[k]) ** 2, 0) / image.length;
    if (error <= ERROR) break;
    [distance, image] = [distance / 2, finer];
  }
  return distance;
}
