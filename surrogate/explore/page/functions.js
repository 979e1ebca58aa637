// Transfer functions as plain values: opacity over field values, colours over field values, and both as JSON to copy and paste.
//
// A function is { opacity: [[value, opacity], ...], colors }, values increasing; `colors` are [[value, "#rrggbb"], ...], or null for
// those of a colour map or of the base.

export const MOST_POINTS = 256;
const THIN = 1.5 / 255; // colours between points that differ by less are left out

/** The axis of values on which `knots` are equally far apart: { place(value), value(place) }, places in [0, 1] between the ends. */
export function axisOf(knots) {
  const last = knots.length - 1;
  return {
    place(value) {
      let low = 0;
      while (low < last - 1 && value >= knots[low + 1]) ++low;
      return (low + (value - knots[low]) / (knots[low + 1] - knots[low])) / last;
    },
    value(place) {
      const low = Math.max(0, Math.min(last - 1, Math.floor(place * last)));
      return knots[low] + (place * last - low) * (knots[low + 1] - knots[low]);
    },
  };
}

/** What is linear between points [x, ...] at x, one of its channels; constant beyond the ends. */
export function between(points, x, channel = 1) {
  const after = points.findIndex(point => x <= point[0]);
  if (after <= 0) return (after ? points.at(-1) : points[0])[channel];
  const [a, b] = [points[after - 1], points[after]];
  return a[channel] + (x - a[0]) / (b[0] - a[0]) * (b[channel] - a[channel]);
}

export const hexOf = rgb => `#${rgb.map(part => Math.round(255 * Math.max(0, Math.min(1, part))).toString(16).padStart(2, "0")).join("")}`;
export const rgbOf = hex => [1, 3, 5].map(at => parseInt(hex.slice(at, at + 2), 16) / 255);

/** Colour points [value, red, green, blue] of what is shown: a function's own colours, else a map's over the base's, else the base's. */
export function colorsOf({ colors }, colorMap, of) {
  if (colors) return colors.map(([value, hex]) => [value, ...rgbOf(hex)]);
  const base = of.function.color_points, map = of.color_maps.find(({ name }) => name === colorMap);
  if (!map) return base;
  const [low, high] = [base[0][0], base.at(-1)[0]];
  return map.points.map(([place, ...rgb]) => [low + place * (high - low), ...rgb]);
}

/** The base's function with its inner points where `points` has them: { c1_value, ... }. */
export function displaced(of, points) {
  const opacity = of.function.opacity_points.map(point => [...point]);
  of.points.forEach(({ name }) => { opacity[Number(name[1])][name.endsWith("value") ? 0 : 1] = points[name]; });
  return { opacity, colors: null };
}

/** { points, free } of a function: places of the base's inner points where that says it all, else the function itself. */
export function settled({ opacity, colors }, of) {
  const base = of.function.opacity_points, same = (a, b) => a[0] === b[0] && a[1] === b[1];
  const first = Object.fromEntries(of.points.map(p => [p.name, p.origin]));
  if (!colors && opacity.length === base.length) {
    const moved = opacity.map((point, i) => [point, i]).filter(([point, i]) => !same(point, base[i]));
    if (!moved.length) return { points: first, free: null };
    const places = Object.fromEntries(of.points.map(p => [p.name, opacity[Number(p.name[1])][p.name.endsWith("value") ? 0 : 1]]));
    if (of.points.length && moved.every(([, i]) => i === 1 || i === 2) && of.points.every(p => p.least <= places[p.name] && places[p.name] <= p.most))
      return { points: places, free: null };
  }
  return { points: first, free: { opacity, colors } };
}

/** As catalogs and the program have it: { opacity_points, color_points }; a map's or the base's colours are left to them. */
export const recordOf = ({ opacity, colors }) => ({ opacity_points: opacity, ...(colors && { color_points: colorsOf({ colors }) }) });

/** The function as text for a link, and back; throws an Error saying what is wrong. */
export const wordOf = ({ opacity, colors }) => [opacity, colors ?? []].map(points => points.map(([x, y]) => `${x},${String(y).replace("#", "")}`).join(";")).join("|");
export function ofWord(word) {
  const [opacity, colors = ""] = word.split("|").map(part => part && part.split(";").map(point => point.split(",")));
  const wrong = [...(opacity || []), ...(colors || [])].some(point => point.length !== 2 || point.some(part => !part.trim()));
  if (wrong || (colors || []).some(([, hex]) => !/^[0-9a-f]{6}$/i.test(hex))) throw new Error("is not a list of control points");
  return checked({ opacity: (opacity || []).map(point => point.map(Number)), colors: colors ? colors.map(([x, hex]) => [Number(x), `#${hex.toLowerCase()}`]) : null });
}

/** The same function, if it is one; throws an Error saying what is wrong. */
function checked(made) {
  for (const [name, points] of [["opacity", made.opacity], ["colour", made.colors]]) {
    if (!points) continue;
    if (points.length < 2 || points.length > MOST_POINTS) throw new Error(`has ${points.length} points of ${name}, not 2 to ${MOST_POINTS}`);
    if (!points.every(point => point.every(part => typeof part === "string" || Number.isFinite(part)))) throw new Error("has values other than numbers");
    if (points.some(([value], i) => i && value <= points[i - 1][0])) throw new Error(`has points of ${name} whose values do not increase`);
  }
  if (!made.opacity.every(([, opacity]) => opacity >= 0 && opacity <= 1)) throw new Error("has opacities outside 0 to 1");
  return made;
}

// ---- JSON

/** The function as JSON that catalogs read, and ParaView's presets of it. */
export const textOf = (made, colors, of) =>
  JSON.stringify({ color_points: colors, opacity_points: made.opacity, opacity_unit_distance: of.function.opacity_unit_distance });
export const paraviewOf = (made, colors, name) => JSON.stringify([{
  ColorSpace: "RGB", Name: name, NanColor: [1, 1, 0], RGBPoints: colors.flat(), Points: made.opacity.flatMap(([value, opacity]) => [value, opacity, 0.5, 0]),
}]);

/**
 * { made, notes } of JSON, ours or ParaView's, beside the function that is shown `now`; what it does not say stays.  A preset over
 * 0 to 1 or −1 to 1 is stretched over the base's values.  Throws an Error saying what is wrong.
 */
export function ofText(text, now, of) {
  let given;
  try {
    given = JSON.parse(text);
  } catch {
    throw new Error("This is not JSON.");
  }
  const preset = Array.isArray(given) ? given[0] : given, notes = [];
  if (preset?.RGBPoints === undefined && preset?.Points === undefined && preset?.opacity_points === undefined && preset?.color_points === undefined)
    throw new Error("This JSON holds no transfer function: neither opacity_points nor color_points, and no RGBPoints or Points of ParaView.");
  const rows = (flat, width) => Array.from({ length: Math.floor((flat?.length ?? 0) / width) }, (_, i) => flat.slice(width * i, width * (i + 1)).map(Number));
  const ours = preset.opacity_points ?? preset.color_points;
  let colors = ours ? preset.color_points ?? [] : rows(preset.RGBPoints, 4), opacity = ours ? preset.opacity_points ?? [] : rows(preset.Points, 4);
  if (![colors, opacity].every(points => Array.isArray(points) && points.every(Array.isArray))) throw new Error("Its points are not lists of numbers.");
  if (!ours) {
    if (opacity.some(([, , middle, sharp]) => middle !== 0.5 || sharp !== 0)) notes.push("midpoints and sharpness of its opacity are left out");
    if (colors.length && preset.ColorSpace && preset.ColorSpace !== "RGB") notes.push(`colours between its points are mixed in RGB, not in ${preset.ColorSpace}`);
    [colors, opacity] = stretched([colors, opacity], of.function.color_points, notes);
  }
  const own = thinned(colors).map(([value, ...rgb]) => [value, hexOf(rgb)]);
  try {
    return { made: checked({ opacity: opacity.length ? opacity.map(point => point.slice(0, 2)) : now.opacity, colors: own.length ? own : now.colors }), notes };
  } catch (error) {
    throw new Error(`This function ${error.message}.`);
  }
}

function stretched(lists, base, notes) {
  const values = lists.flat().map(point => point[0]), [from, to] = [Math.min(...values), Math.max(...values)], [low, high] = [base[0][0], base.at(-1)[0]];
  if (to !== 1 || (from !== 0 && from !== -1)) return lists;
  notes.push(`a preset over ${from} to ${to}: stretched over the base's values`);
  return lists.map(points => points.map(([value, ...rest]) => [low + (value - from) / (to - from) * (high - low), ...rest]));
}

/** Colour points without those that lie on the line between the others (Ramer, Douglas and Peucker). */
export function thinned(points) {
  if (points.length < 3) return points;
  const ends = [points[0], points.at(-1)], off = points.map(point => Math.max(...[1, 2, 3].map(k => Math.abs(point[k] - between(ends, point[0], k)))));
  const worst = off.indexOf(Math.max(...off));
  return off[worst] < THIN ? ends : [...thinned(points.slice(0, worst + 1)), ...thinned(points.slice(worst)).slice(1)];
}
