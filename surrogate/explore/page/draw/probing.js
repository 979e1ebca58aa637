// What is seen at a pixel, and the field's value there; see surrogate/explore/probing.py.

import { boundsOf } from "draw/cuts.js";
import { interpolated } from "draw/nodes.js";
import { raysOf } from "draw/rays.js";

const FAINT = 0.02, FINENESS = 4, MOST_SAMPLES = 1 << 14, MOST_OPAQUE = 1 - 1e-12, BINS = 64;

/** The place in the world that is seen at a pixel (right, down) of a camera's picture, cut by a clip and a slice; null where nothing is. */
export function seenPlace(field, appearance, camera, [right, down], cut = {}) {
  const { spacing, origin } = field, { low, high } = boundsOf(cut, field), rays = raysOf(camera, field);
  const ray = [0, 1, 2].map(k => rays.across[k] * right + rays.down[k] * down + rays.corner[k] || 1e-200), length = Math.hypot(...ray.map((x, k) => x * spacing[k]));
  const faces = [0, 1, 2].map(k => [(low[k] - rays.eye[k]) / ray[k], (high[k] - rays.eye[k]) / ray[k]]);
  const enter = Math.max(0, ...faces.map(pair => Math.min(...pair))), leave = Math.min(...faces.map(pair => Math.max(...pair)));
  const placeOf = at => rays.eye.map((x, k) => x + at * ray[k]), worldOf = at => placeOf(at).map((x, k) => origin[k] + spacing[k] * x);
  if (!(leave > enter)) return null;
  if (cut.slice) return Number.isNaN(sampled(field, placeOf((enter + leave) / 2), true)) ? null : worldOf((enter + leave) / 2);
  const count = Math.min(Math.ceil(FINENESS * (leave - enter) * length / Math.min(...spacing)) + 1, MOST_SAMPLES), step = (leave - enter) / count;
  const at = appearance.kind === "isosurface" ? crossing(i => sampled(field, placeOf(enter + i * step), true) - appearance.isovalue, count)
    : half(i => depthAt(sampled(field, placeOf(enter + (i + 0.5) * step), true), appearance.transfer_function) * step * length, count);
  return at === null ? null : worldOf(enter + at * step);
}

/** The field's value at a place in the world; null outside it and beside holes. */
export function valueAt(field, place) {
  const value = sampled(field, place.map((x, k) => (x - field.origin[k]) / field.spacing[k]), false);
  return Number.isNaN(value) ? null : value;
}

/** How often the field's samples lie in bins between edges, even ones over its range without any: { edges, shares }. */
export function sharesOf({ values, holes }, edges) {
  const used = holes ? values.filter((_, i) => !holes[i]) : values;
  const low = used.reduce((a, b) => Math.min(a, b), Infinity), high = used.reduce((a, b) => Math.max(a, b), -Infinity);
  const bounds = edges ?? Array.from({ length: BINS + 1 }, (_, i) => low + i / BINS * (high - low)), last = bounds.length - 1, counts = new Array(last).fill(0);
  for (const value of used) {
    if (!(value >= bounds[0] && value <= bounds[last])) continue;
    let from = 0, to = last;
    while (to - from > 1) {
      const middle = from + to >> 1;
      if (value >= bounds[middle]) from = middle;
      else to = middle;
    }
    counts[from] += 1;
  }
  return { edges: bounds, shares: counts.map(count => count / used.length) };
}

const depthAt = (value, { opacity_points: opacities, opacity_unit_distance: unit }) =>
  Number.isNaN(value) ? 0 : -Math.log1p(-Math.min(interpolated(opacities, value), MOST_OPAQUE)) / unit;

/** Where half of the opacity is reached that steps of such depths have together, in steps; null where it is faint. */
function half(depth, count) {
  const opacities = [0];
  for (let i = 0, sum = 0; i < count; ++i) opacities.push(-Math.expm1(-(sum += depth(i))));
  const wanted = opacities[count] / 2, after = opacities.findIndex(opacity => opacity >= wanted);
  return opacities[count] < FAINT ? null : after - (opacities[after] - wanted) / (opacities[after] - opacities[after - 1]);
}

/** Where values change their sign first, in steps; null where they do not. */
function crossing(value, count) {
  for (let i = 0, before = value(0); i < count; ++i) {
    const after = value(i + 1);
    if (before * after <= 0) return i + (after === before ? 0 : before / (before - after));
    before = after;
  }
  return null;
}

/** The field at a place in samples, trilinear; NaN beyond it, in cells with a hole, or, unless it `isDrawn`, beside those alone that count. */
function sampled({ values, holes, size: [nx, ny, nz] }, place, isDrawn) {
  const last = [nx, ny, nz].map(n => n - 1);
  if (place.some((x, k) => x < -1e-6 || x > last[k] + 1e-6)) return NaN;
  const inside = place.map((x, k) => Math.min(Math.max(x, 0), last[k])), low = inside.map((x, k) => Math.min(Math.floor(x), Math.max(last[k] - 1, 0)));
  let sum = 0;
  for (let corner = 0; corner < 8; ++corner) {
    const step = [corner & 1, corner >> 1 & 1, corner >> 2], [i, j, k] = low.map((x, axis) => Math.min(x + step[axis], last[axis]));
    const weight = step.reduce((product, one, axis) => product * (one ? inside[axis] - low[axis] : 1 - inside[axis] + low[axis]), 1), at = (k * ny + j) * nx + i;
    if (holes?.[at] && (isDrawn || weight > 0)) return NaN;
    sum += weight * values[at];
  }
  return sum;
}
