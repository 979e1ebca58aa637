// Cuts through a field: a box that what is drawn ends at, and a slice perpendicular to an axis; see surrogate/ray_casting/cuts.py.

const THICKNESS = 1e-2, OPAQUE = 1e-6; // of a slice in samples; of that, the length that its opacities are of
export const AXES = "xyz";

/** Where rays through a field begin and end, {low, high} in samples, by a setting's clip and slice; equal along an axis where nothing is. */
export function boundsOf({ clip, slice }, { size, spacing, origin }) {
  const last = size.map(n => n - 1), inSamples = corner => corner.map((x, k) => Math.min(Math.max((x - origin[k]) / spacing[k], 0), last[k]));
  const low = clip ? inSamples(clip.slice(0, 3)) : [0, 0, 0], high = clip ? inSamples(clip.slice(3)) : last.slice();
  if (slice) {
    const axis = AXES.indexOf(slice[0]), at = (slice[1] - origin[axis]) / spacing[axis], meets = low[axis] <= at && at <= high[axis];
    if (meets) low[axis] = Math.min(at, last[axis] - THICKNESS);
    high[axis] = low[axis] + (meets ? THICKNESS : 0);
  }
  return { low, high };
}

/** The appearance of a slice: the colours of a volume, opaque and without light. */
export function sliced(appearance, spacing) {
  const { transfer_function: transfer } = appearance;
  if (!transfer) throw new Error("a slice has the colours of a transfer function, and an isosurface has none: show the volume");
  const points = transfer.opacity_points.map(([value]) => [value, 1]), unit = OPAQUE * THICKNESS * Math.min(...spacing);
  return { ...appearance, transfer_function: { ...transfer, opacity_points: points, opacity_unit_distance: unit }, shaded: false };
}

/** The triangles of a surface cut to bounds: those that reach out end there. */
export function clipped(triangles, { low, high }) {
  if (low.some((x, k) => !(x < high[k]))) return { ...triangles, corners: new Uint32Array(0) };
  const cut = [0, 1, 2].reduce((one, k) => beyond(beyond(one, k, 1, low[k]), k, -1, -high[k]), triangles);
  return { places: Float32Array.from(cut.places), normals: Float32Array.from(cut.normals), corners: Uint32Array.from(cut.corners) };
}

/** The surface where `sign` times the places along an axis are `least` or more. */
function beyond({ places, normals, corners }, axis, sign, least) {
  const own = { places: Array.from(places), normals: Array.from(normals), corners: [] }, depth = corner => sign * places[3 * corner + axis] - least;
  for (let t = 0; t < corners.length; t += 3) {
    const three = [corners[t], corners[t + 1], corners[t + 2]], inside = three.map(corner => depth(corner) >= 0), count = inside.filter(Boolean).length;
    if (count === 3) own.corners.push(...three);
    if (count === 0 || count === 3) continue;
    const lone = inside.indexOf(count === 1), [alone, next, last] = [0, 1, 2].map(k => three[(lone + k) % 3]);
    const [first, second] = [next, last].map(other => count === 1 ? added(alone, other) : added(other, alone));
    if (count === 1) own.corners.push(alone, first, second);
    else own.corners.push(first, next, last, first, last, second);
  }
  return own;

  /** A corner between one inside and one outside, in this order, so that neighbours agree. */
  function added(start, stop) {
    const share = depth(start) / (depth(start) - depth(stop));
    for (let k = 0; k < 3; ++k) {
      const [from, to] = [places[3 * start + k], places[3 * stop + k]];
      own.places.push(k === axis ? sign * least : from + share * (to - from));
      own.normals.push(normals[3 * start + k] + share * (normals[3 * stop + k] - normals[3 * start + k]));
    }
    return own.places.length / 3 - 1;
  }
}
