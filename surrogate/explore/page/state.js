// Everything that a tab shows, as one plain object; `address.js` writes it into the address, whole.
//
// { mode, settings: [A, B] or [A, B, C, D], active, against, orbit, background, full, hidden, drawn, over, sweep }; `hidden` names PARTS of annotations.js,
// `drawn` what draws: the browser or the program, "" for the faster; `over` what lies over the picture, see ask.js;
// `probe` says that the value under the pointer is shown, `pins` are places in the world;
// `brushes` are { axis: [from, to] } of the predictions, shares of axes, and `level` is the one of their share, "" for a usual one; `layout` how two pictures are shown, "side" by side or one under the other to "swipe".
// A setting: { parameters: {name: value}, kind, isovalue, points: {c1_value, ...}, free, colorMap, appearance, using }; `points` are the
// places of the transfer function's control points, `free` is another function instead (functions.js) or null, `using` names what draws it, "" for the best; `clip` and `slice` are those of cuts.js or null.  A sweep: { name, low, high, count, second, secondLow, secondHigh, secondCount }, where
// "" for an end is the bound.

import { cutOf, usedBy } from "./cuts.js";
import { recordOf } from "./functions.js";
import { rounded as roundedOrbit } from "./orbit.js";
import { firstBackground } from "./theme.js";

export const MODES = ["view", "compare", "sweep"];
export const AUTOMATIC = 0, EVERY_PIXEL = 1; // every pixel where a graphics card draws, else a usual size; every pixel
export const FULL_SIZES = [AUTOMATIC, 256, 384, 512, 768, 1024, EVERY_PIXEL];
export const COUNTS = [2, 3, 4, 5, 6, 7, 8, 10, 12];
export const MOST_COUNT = 24, MOST_PINS = 20;
export const OUTCOMES = ["mean", "minimum", "maximum", "share", "opacity"].map(name => `field.${name}`); // axes of predictions beside parameters
export const CELLS = 60; // pictures of a sweep at most

export const variation = (facts, kind) => facts.variations.find(v => v.kind === kind);
export const current = state => state.settings[state.active];

/** Where a value lies between a parameter's bounds, 0 to 1 and beyond, on its scale; and the value there. */
export const shareOf = (p, value) => p.scale === "log" ? Math.log(value / p.low) / Math.log(p.high / p.low) : (value - p.low) / (p.high - p.low);
export const valueAt = (p, share) => p.scale === "log" ? p.low * (p.high / p.low) ** share : p.low + (p.high - p.low) * share;

const middle = p => p.scale === "log" ? Math.sqrt(p.low * p.high) : (p.low + p.high) / 2;

/** The parameters of the control points: [{ name, unit, origin, low, high, least, most }], none without a transfer function. */
export const pointsOf = facts => variation(facts, "transfer_function")?.points ?? [];

/** What can be chosen to be shown, the first at first: transfer functions hold the base appearance. */
export function kindsOf(facts) {
  const kinds = facts.variations.map(v => v.kind), functions = "transfer_function";
  return kinds.includes(functions) ? [functions, ...kinds.filter(kind => kind !== functions)] : ["base", ...kinds];
}

export function firstSetting(facts) {
  const isovalue = variation(facts, "isovalue"), field = variation(facts, "field");
  return {
    parameters: Object.fromEntries(facts.parameters.map(p => [p.name, middle(p)])),
    kind: kindsOf(facts)[0],
    isovalue: isovalue ? middle(isovalue) : 0,
    points: Object.fromEntries(pointsOf(facts).map(p => [p.name, p.origin])),
    free: null,
    colorMap: "",
    appearance: field ? field.names[0] : "",
    using: "",
    clip: null,
    slice: null,
  };
}

export const firstSweep = facts =>
  ({ name: facts.parameters[0]?.name ?? "", low: "", high: "", count: 7, second: "", secondLow: "", secondHigh: "", secondCount: 4 });

export function firstState(facts) {
  return {
    mode: "view",
    settings: [firstSetting(facts), firstSetting(facts)],
    active: 0,
    against: "setting",
    orbit: roundedOrbit(facts.camera),
    background: facts.background ?? firstBackground(),
    full: AUTOMATIC,
    hidden: [],
    drawn: "",
    over: "",
    probe: false,
    pins: [],
    brushes: {},
    level: "",
    layout: "side",
    sweep: firstSweep(facts),
  };
}

/** A setting as the server takes it: control points by their displacements, other functions whole. */
export function messageOf(setting, facts) {
  const functions = setting.kind === "transfer_function", free = functions && setting.free;
  const visualization = {
    base: () => ({}),
    isovalue: () => ({ isovalue: setting.isovalue }),
    transfer_function: () => displacements(setting, facts),
    field: () => ({ appearance: setting.appearance }),
  }[setting.kind]();
  return {
    parameters: { ...setting.parameters }, visualization, color_map: functions ? setting.colorMap : "",
    ...(usedBy(setting) && { using: usedBy(setting) }), ...(free && { function: recordOf(free) }), ...cutOf(setting),
  };
}

/** Displacements of the base's control points: none where none is moved, or where another function is shown. */
function displacements({ points, free }, facts) {
  const moved = pointsOf(facts).map(p => [p.name, points[p.name] - p.origin]);
  return free || moved.every(([, by]) => !by) ? {} : Object.fromEntries(moved);
}

/** What can be swept or slid: simulation parameters, and those of the setting's visualization. */
export function sweepable(facts, setting) {
  const more = setting.kind === "isovalue" ? [{ name: "isovalue", ...variation(facts, "isovalue") }]
    : setting.kind === "transfer_function" && !setting.free ? pointsOf(facts) : [];
  return [...facts.parameters, ...more];
}

/** The swept parameters: { first, second }, the latter undefined without. */
export function sweptOf(state, facts) {
  const known = sweepable(facts, current(state)), first = known.find(p => p.name === state.sweep.name) ?? known[0];
  return { first, second: known.find(p => p.name === state.sweep.second && p !== first) };
}

/** The same setting with one value set, whatever kind of parameter it is. */
export function withValue(setting, name, value) {
  if (name in setting.parameters) return { ...setting, parameters: { ...setting.parameters, [name]: value } };
  if (name === "isovalue") return { ...setting, isovalue: value };
  return { ...setting, points: { ...setting.points, [name]: value } };
}

/** From where to where a parameter is swept; `ends` are two of a sweep's. */
export const rangeOf = ([low, high], p) => ({ low: low === "" ? p.low : low, high: high === "" ? p.high : high });
export const endsOf = (sweep, second) => second ? [sweep.secondLow, sweep.secondHigh] : [sweep.low, sweep.high];

/** How many rows a sweep over two parameters can have. */
export const mostRows = columns => Math.floor(CELLS / columns);

/** The sweep as it can be shown beside the state's setting: what that does not have is not swept. */
export function possibleSweep(state, facts) {
  const sweep = { ...state.sweep }, names = sweepable(facts, current(state)).map(p => p.name);
  if (!names.includes(sweep.name)) Object.assign(sweep, { name: names[0] ?? "", low: "", high: "" });
  if (sweep.second && (!names.includes(sweep.second) || sweep.second === sweep.name)) Object.assign(sweep, { second: "", secondLow: "", secondHigh: "" });
  if (sweep.second) sweep.secondCount = Math.min(sweep.secondCount, mostRows(sweep.count));
  return sweep;
}

/** What a hand on a slider means: no more digits than it can tell apart. */
export function tidy(value, { low, high, scale }) {
  if (scale === "log") return +value.toPrecision(6);
  return +value.toFixed(Math.min(100, Math.max(0, 5 - Math.floor(Math.log10(high - low)))));
}
