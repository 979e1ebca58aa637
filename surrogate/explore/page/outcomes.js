// Parameters and outcomes of runs and predictions, as axes: what each row has there, and from where to where it goes.

import { between, displaced } from "./functions.js";
import { current, shareOf, valueAt, variation } from "./state.js";

const NUMBERS = ["mean", "minimum", "maximum"]; // the first columns of a table

/** The table of an answer: { count, runs, parameters: [[...]], numbers: (count, columns) Float32Array, columns, levels, name, unit }. */
export function tableOf({ parameters, runs, levels, name, unit, pictures: [bytes] }) {
  const numbers = new Float32Array(bytes.slice().buffer), count = parameters.length;
  return { count, runs, parameters, numbers, columns: numbers.length / count, levels, name: name || "value", unit };
}

/** All axes: [{ key, label, unit, low, high, isLogarithmic, isOutcome, values: (count,) }]. */
export function axesOf(table, level, state, facts) {
  const ofParameters = facts.parameters.map((p, i) => ({
    key: p.name, label: labelled(p.name, p.unit), unit: p.unit, low: p.low, high: p.high, scale: p.scale, isOutcome: false, values: table.parameters.map(row => row[i]),
  }));
  const { count, columns, numbers, levels, name, unit } = table, row = i => numbers.subarray(i * columns, (i + 1) * columns);
  const outcome = (key, label, of, at) => {
    const values = Array.from({ length: count }, (_, i) => at(row(i))), low = Math.min(...values), high = Math.max(...values);
    return { key: `field.${key}`, label, unit: of, low, high: high > low ? high : low + 1, scale: "linear", isOutcome: true, values };
  };
  const setting = current(state), functions = variation(facts, "transfer_function"), shown = setting.kind === "transfer_function" && functions;
  const opacity = shown && opacityOf((setting.free ?? displaced(functions, setting.points)).opacity, levels);
  return [
    ...ofParameters, ...NUMBERS.map((words, i) => outcome(words, labelled(`${words} ${name}`, unit), unit, numbersOf => numbersOf[i])),
    outcome("share", `share ${name} > ${+level.toPrecision(3)}`, "", numbersOf => shareAbove(numbersOf.subarray(NUMBERS.length), levels, level)),
    ...shown ? [outcome("opacity", "mean opacity", "", numbersOf => opacity(numbersOf.subarray(NUMBERS.length)))] : [],
  ];
}

const labelled = (name, unit) => unit ? `${name} (${unit})` : name;

/** The share of samples above a level, linear between the levels of which it is known. */
export function shareAbove(shares, levels, level) {
  const last = levels.length - 1;
  if (level <= levels[0]) return shares[0];
  if (level >= levels[last]) return shares[last];
  const i = levels.findIndex(other => other > level) - 1, part = (level - levels[i]) / (levels[i + 1] - levels[i]);
  return shares[i] + part * (shares[i + 1] - shares[i]);
}

/** The mean opacity of samples, of which shares lie above levels, per the function's unit distance. */
function opacityOf(points, levels) {
  const at = level => between(points, level), inside = levels.slice(1).map((high, i) => (at(levels[i]) + 4 * at((levels[i] + high) / 2) + at(high)) / 6);
  const [first, last] = [at(levels[0]), at(levels.at(-1))];
  return shares => inside.reduce((sum, opacity, i) => sum + (shares[i] - shares[i + 1]) * opacity, (1 - shares[0]) * first + shares[levels.length - 1] * last);
}

/** Where a value lies on an axis, 0 below to 1 above; and the value there. */
export const placeOn = (axis, value) => shareOf(axis, value);
export const valueOn = (axis, place) => valueAt(axis, place);

/** The rows that lie within all brushes, { key: [from, to] } in shares of axes. */
export function passing(axes, brushes, count) {
  const active = axes.filter(({ key }) => brushes[key]);
  return Array.from({ length: count }, (_, i) => active.every(axis => {
    const place = placeOn(axis, axis.values[i]), [from, to] = brushes[axis.key];
    return place >= from - 1e-9 && place <= to + 1e-9;
  }));
}

/** Rows that pass, the nearest to the middles of the brushes first. */
export function best(axes, brushes, passes) {
  const active = axes.filter(({ key }) => brushes[key]);
  const away = i => active.reduce((sum, axis) => sum + (placeOn(axis, axis.values[i]) - (brushes[axis.key][0] + brushes[axis.key][1]) / 2) ** 2, 0);
  return passes.flatMap((does, i) => does ? [[away(i), i]] : []).sort((a, b) => a[0] - b[0]).map(([, i]) => i);
}
