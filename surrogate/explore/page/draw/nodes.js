// Nodes of a transfer function on a scale of values, between which extinction and emission are linear.
// The same as `resampled` in surrogate/appearance/averages.py, which derives it.

export const SPREADS = [0.004, 0.6]; // for which averages are exact to the tolerance
export const VALUES = [-0.5, 1.5];
const OPAQUE = 0.999, TOLERANCE = 1e-4, NEGLIGIBLE = 0.01, DARK = 1e-6;

/**
 * Nodes of `{color_points, opacity_points, opacity_unit_distance}` on the scale of `knots`, per the unit distance `unit`:
 * {places (K,), columns (K, 4) of extinction and emission, low and high (3,) colours of what absorbs, dark}.
 */
export function resampled(transfer, unit, knots) {
  const pieces = piecesOf(transfer, knots), counts = partsOf(pieces);
  const { places, columns } = placed(pieces, counts), scale = unit / transfer.opacity_unit_distance;
  for (let i = 0; i < columns.length; ++i) columns[i] *= scale;
  return { places, columns, ...rangeOf(columns) };
}

/** The value at x of a function that is linear between points [x, ...], whose channel it is; constant beyond the ends. */
export function interpolated(points, x, channel = 1) {
  if (x <= points[0][0]) return points[0][channel];
  for (let k = 1; k < points.length; ++k) {
    const [before, after] = [points[k - 1], points[k]];
    if (x > after[0]) continue;
    return before[channel] + (x - before[0]) / (after[0] - before[0]) * (after[channel] - before[channel]);
  }
  return points.at(-1)[channel];
}

/** A field value on the scale of knots. */
export function onScale(value, knots) {
  let low = 0;
  while (low < knots.length - 2 && value >= knots[low + 1]) ++low;
  return (low + (value - knots[low]) / (knots[low + 1] - knots[low])) / (knots.length - 1);
}

/** The places at which opacity or colour, both linear in between, bend: arrays of one entry each. */
function piecesOf({ color_points: colors, opacity_points: opacities }, knots) {
  const values = [...opacities.map(point => point[0]), ...knots, ...colors.map(point => point[0])];
  for (let k = 1; k < opacities.length; ++k) {
    const [before, after] = [opacities[k - 1][1] - OPAQUE, opacities[k][1] - OPAQUE];
    if (before * after < 0) values.push(opacities[k - 1][0] + before / (before - after) * (opacities[k][0] - opacities[k - 1][0]));
  }
  const breaks = [...new Set(values)].sort((a, b) => a - b);
  const opacity = breaks.map(value => Math.min(interpolated(opacities, value), OPAQUE));
  const depths = opacity.map(alpha => -Math.log1p(-alpha));
  return {
    places: breaks.map(value => onScale(value, knots)), opacity, depths,
    colors: breaks.map(value => [1, 2, 3].map(channel => interpolated(colors, value, channel))),
    floor: Math.max(NEGLIGIBLE * Math.max(...depths), 1e-12),
  };
}

/** The number of parts that each piece is cut into. */
function partsOf({ places, opacity, depths, colors, floor }) {
  const roots = depths.map(depth => Math.sqrt(depth + floor)), chords = [], widest = [];
  for (let i = 0; i + 1 < places.length; ++i) {
    const step = Math.abs(roots[i + 1] - roots[i]), low = Math.min(roots[i], roots[i + 1]), length = places[i + 1] - places[i];
    const change = Math.max(...colors[i].map((c, channel) => Math.abs(colors[i + 1][channel] - c)));
    chords.push(step ** 2 / 2 + change * step / (2 * Math.max(low, step)));
    const middle = Math.min(Math.max(Math.SQRT1_2, low), low + step);
    const steepest = 2 * middle * Math.exp(floor - middle ** 2) * step / Math.max(Math.abs(opacity[i + 1] - opacity[i]), 1e-300);
    widest.push(length * steepest / SPREADS[0]);
  }
  const most = Math.ceil(Math.sqrt(Math.max(...chords) / TOLERANCE)) + 1;
  return chords.map((whole, i) => {
    const chord = whole * Math.min(1, 0.3 / NEGLIGIBLE * (places[i + 1] - places[i]) / SPREADS[0]);
    for (let parts = 1; parts <= most; ++parts) {
      const width = Math.max(widest[i] / parts, 1e-3);
      const damping = parts === 1 ? 1 : Math.min(1, 0.15 * width + Math.exp(-20 / width ** 2) + 20 / parts ** 2);
      if (chord / parts ** 2 * damping <= TOLERANCE) return parts;
    }
    return 1;
  });
}

/** Nodes that cut pieces into as many parts: places (K,) and columns (K, 4) by the function's own unit distance. */
function placed({ places, opacity, depths, colors, floor }, counts) {
  const parts = counts.flatMap((count, piece) => Array.from({ length: count }, (_, part) => partOf(piece, part / count)));
  const nodes = [...parts.map(part => part.place), places.at(-1)], columns = new Float64Array(4 * nodes.length);
  parts.forEach((part, k) => columns.set(part.column, 4 * k));
  columns.set([1, ...colors.at(-1)].map(hue => depths.at(-1) * hue), 4 * parts.length);
  parts.forEach((part, k) => {
    if (!part.inner) return; // a line errs by h³ / 12 times the second derivative, which inner nodes make up for
    const ends = [parts.at(k - 1).inner ? 1 : 2, parts[(k + 1) % parts.length].inner ? 1 : 2];
    const before = nodes[k] - nodes[k - 1], after = nodes[k + 1] - nodes[k];
    const moved = (before ** 3 * ends[0] + after ** 3 * ends[1]) / Math.max(12 * (before + after), 1e-300);
    part.bends.forEach((bend, column) => { columns[4 * k + column] -= moved * bend; });
  });
  return { places: Float64Array.from(nodes), columns: columns.map(x => Math.max(x, 0)) };

  function partOf(piece, inside) {
    const inner = inside > 0, length = places[piece + 1] - places[piece], change = opacity[piece + 1] - opacity[piece];
    const roots = [piece, piece + 1].map(i => Math.sqrt(depths[i] + floor));
    const depth = inner ? (roots[0] + inside * (roots[1] - roots[0])) ** 2 - floor : depths[piece];
    const share = change === 0 ? inside : (-Math.expm1(-depth) - opacity[piece]) / change;
    const turns = colors[piece].map((c, channel) => colors[piece + 1][channel] - c);
    const hues = [1, ...colors[piece].map((c, channel) => c + share * turns[channel])];
    const perLength = length > 0 ? 1 / length : 0, slope = change * perLength * Math.exp(depth);
    return {
      inner, place: places[piece] + share * length, column: hues.map(hue => depth * hue),
      bends: hues.map((hue, column) => slope ** 2 * hue + (column ? 2 * slope * perLength * turns[column - 1] : 0)),
    };
  }
}

/** The lowest and the highest colours of what absorbs, and the extinction below which colours fade to the lowest. */
function rangeOf(columns) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  let most = 0;
  for (let at = 0; at < columns.length; at += 4) {
    most = Math.max(most, columns[at]);
    for (let c = 0; columns[at] > 0 && c < 3; ++c) {
      low[c] = Math.min(low[c], columns[at + c + 1] / columns[at]);
      high[c] = Math.max(high[c], columns[at + c + 1] / columns[at]);
    }
  }
  const nothing = most === 0;
  return { low: nothing ? [0, 0, 0] : low, high: nothing ? [0, 0, 0] : high, dark: Math.max(DARK * most, 1e-30) };
}
