// Isosurfaces drawn by plain scripts: the nearest triangle of each ray; see surrogate/ray_casting/reference.py.

import { lit } from "draw/casting.js";

/**
 * Premultiplied RGBA (H, W, 4) of triangles from `trianglesOf`, of a color under a light, by rays of `raysOf` at samples' middles.
 * Each triangle is met by the rays of its rectangle in the picture (Olano & Greer 1997: edges as planes through the eye).
 */
export function castSurface({ places, normals, corners }, { color, light, spacing }, rays, { matrix, shift }, { fx, fy, cx, cy }) {
  const { across, down, corner, width, height } = rays, seen = new Float32Array(width * height), owners = new Int32Array(width * height).fill(-1);
  const local = viewed(places, matrix, shift), picture = new Float32Array(4 * width * height), planes = new Float64Array(9);
  for (let t = 0; t < corners.length; t += 3) {
    const box = boxOf(local, corners, t, { fx, fy, cx, cy, width, height });
    if (!box || !planesOf(local, corners, t, planes)) continue;
    for (let row = box[2]; row <= box[3]; ++row) {
      const y = (row + 0.5 - cy) / fy;
      for (let column = box[0]; column <= box[1]; ++column) {
        const x = (column + 0.5 - cx) / fx, a = planes[0] * x + planes[1] * y + planes[2];
        if (a < 0) continue;
        const b = planes[3] * x + planes[4] * y + planes[5], c = planes[6] * x + planes[7] * y + planes[8], at = row * width + column;
        if (b < 0 || c < 0 || !(a + b + c > seen[at])) continue;
        seen[at] = a + b + c; // one over the depth
        owners[at] = t;
      }
    }
  }
  for (let at = 0; at < owners.length; ++at) if (owners[at] >= 0) shade(at);
  return picture;

  function shade(at) {
    const t = owners[at], column = at % width + 0.5, row = Math.floor(at / width) + 0.5;
    planesOf(local, corners, t, planes);
    const point = [(column - cx) / fx, (row - cy) / fy, 1], shares = [0, 3, 6].map(k => planes[k] * point[0] + planes[k + 1] * point[1] + planes[k + 2]);
    const sum = shares[0] + shares[1] + shares[2];
    let along = 0, squared = 0, length = 0;
    for (let k = 0; k < 3; ++k) {
      let normal = 0;
      for (let corner = 0; corner < 3; ++corner) normal += shares[corner] / sum * normals[3 * corners[t + corner] + k];
      const ray = (across[k] * column + down[k] * row + corner[k]) * spacing[k];
      along += normal * ray;
      squared += normal * normal;
      length += ray * ray;
    }
    const facing = squared > 0 ? Math.min(Math.abs(along) / Math.sqrt(squared * length), 1) : 0;
    picture.set([...lit(light, color, facing), 1], 4 * at);
  }
}

/** Places in samples (P, 3) as the camera has them. */
function viewed(places, matrix, shift) {
  const local = new Float64Array(places.length);
  for (let at = 0; at < places.length; at += 3) {
    for (let k = 0; k < 3; ++k) {
      local[at + k] = matrix[3 * k] * places[at] + matrix[3 * k + 1] * places[at + 1] + matrix[3 * k + 2] * places[at + 2] + shift[k];
    }
  }
  return local;
}

/** First and last column and row of the samples that may meet a triangle; null where none does. */
function boxOf(local, corners, t, { fx, fy, cx, cy, width, height }) {
  let left = Infinity, right = -Infinity, top = Infinity, bottom = -Infinity, behind = 0;
  for (let k = 0; k < 3; ++k) {
    const at = 3 * corners[t + k], z = local[at + 2];
    if (!(z > 1e-9)) ++behind;
    const x = local[at] / z * fx + cx, y = local[at + 1] / z * fy + cy;
    left = Math.min(left, x);
    right = Math.max(right, x);
    top = Math.min(top, y);
    bottom = Math.max(bottom, y);
  }
  if (behind === 3) return null;
  if (behind) return [0, width - 1, 0, height - 1];
  const box = [Math.max(Math.ceil(left - 0.5), 0), Math.min(Math.floor(right - 0.5), width - 1), Math.max(Math.ceil(top - 0.5), 0), Math.min(Math.floor(bottom - 0.5), height - 1)];
  return box[0] > box[1] || box[2] > box[3] ? null : box;
}

/** The planes (9,) through the eye and two corners each, over the volume of all: of a point they give its corners' weights over its depth. */
function planesOf(local, corners, t, planes) {
  const at = [0, 1, 2].map(k => 3 * corners[t + k]);
  for (let k = 0; k < 3; ++k) {
    const a = at[(k + 1) % 3], b = at[(k + 2) % 3];
    for (let c = 0; c < 3; ++c) {
      const d = (c + 1) % 3, e = (c + 2) % 3;
      planes[3 * k + c] = local[a + d] * local[b + e] - local[a + e] * local[b + d];
    }
  }
  const volume = planes[0] * local[at[0]] + planes[1] * local[at[0] + 1] + planes[2] * local[at[0] + 2];
  if (volume === 0) return false;
  for (let k = 0; k < 9; ++k) planes[k] /= volume;
  return true;
}
