// Cuts through a field: a box that what is drawn ends at, and a slice perpendicular to an axis; see native/ray_casting/cuts.py.

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
  const depths = new Float64Array(places.length / 3);
  for (let corner = 0; corner < depths.length; ++corner) depths[corner] = sign * places[3 * corner + axis] - least;
  if (depths.every(depth => depth >= 0)) return { places, normals, corners };
  const kept = new Uint32Array(2 * corners.length), morePlaces = [], moreNormals = [];
  let count = 0;
  for (let t = 0; t < corners.length; t += 3) {
    const a = corners[t], b = corners[t + 1], c = corners[t + 2], first = depths[a] >= 0, second = depths[b] >= 0, third = depths[c] >= 0;
    if (first && second && third) keep(a, b, c);
    else if (first || second || third) {
      const alone = first === second ? 2 : first === third ? 1 : 0, three = [a, b, c], [own, next, last] = [0, 1, 2].map(k => three[(alone + k) % 3]);
      if (depths[own] >= 0) keep(own, added(own, next), added(own, last));
      else {
        const [before, after] = [added(next, own), added(last, own)];
        keep(before, next, last);
        keep(before, last, after);
      }
    }
  }
  return { places: joined(places, morePlaces), normals: joined(normals, moreNormals), corners: kept.subarray(0, count) };

  function keep(a, b, c) {
    kept[count++] = a;
    kept[count++] = b;
    kept[count++] = c;
  }

  /** A corner between one inside and one outside, in this order, so that neighbours agree. */
  function added(inside, outside) {
    const share = depths[inside] / (depths[inside] - depths[outside]), between = (of, k) => of[3 * inside + k] + share * (of[3 * outside + k] - of[3 * inside + k]);
    for (let k = 0; k < 3; ++k) {
      morePlaces.push(k === axis ? sign * least : between(places, k));
      moreNormals.push(between(normals, k));
    }
    return (places.length + morePlaces.length) / 3 - 1;
  }
}

/** Numbers with more behind them. */
function joined(numbers, more) {
  const all = new Float64Array(numbers.length + more.length);
  all.set(numbers);
  all.set(more, numbers.length);
  return all;
}
