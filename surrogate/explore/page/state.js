// Everything that a tab shows, as one plain object, and the address that holds all of it.
//
// { mode, settings: [A, B], active, against, orbit, background, full, sweep }
// A setting: { parameters: {name: value}, kind, isovalue, points: {c1_value, ...}, colorMap, appearance }

export const MODES = ["view", "compare", "sweep"];
export const POINTS = ["c1_value", "c1_opacity", "c2_value", "c2_opacity"];
export const FULL_SIZES = [256, 384, 512, 768, 1024];
export const BACKGROUNDS = { dark: "#101216", black: "#000000", white: "#ffffff", gray: "#808080" };
const BEYOND = 0.9; // how far the address may ask beyond the bounds, in widths; the server refuses more than 1

const middle = p => (p.low + p.high) / 2;
export const variation = (facts, kind) => facts.variations.find(v => v.kind === kind);

export function firstSetting(facts) {
  const isovalue = variation(facts, "isovalue"), field = variation(facts, "field");
  return {
    parameters: Object.fromEntries(facts.parameters.map(p => [p.name, middle(p)])),
    kind: "base",
    isovalue: isovalue ? middle(isovalue) : 0,
    points: Object.fromEntries(POINTS.map(name => [name, 0])),
    colorMap: "",
    appearance: field ? field.names[0] : "",
  };
}

export function firstState(facts) {
  const first = facts.parameters[0];
  return {
    mode: "view",
    settings: [firstSetting(facts), firstSetting(facts)],
    active: 0,
    against: "setting",
    orbit: facts.camera,
    background: facts.background ?? BACKGROUNDS.dark,
    full: 512,
    sweep: { name: first?.name ?? "", low: "", high: "", count: 7, second: "", secondCount: 4 }, // "" is the bound
  };
}

/** A setting as the server takes it. */
export function messageOf(setting) {
  const visualization = {
    base: () => ({}),
    isovalue: () => ({ isovalue: setting.isovalue }),
    transfer_function: () => ({ ...setting.points }),
    field: () => ({ appearance: setting.appearance }),
  }[setting.kind]();
  const color_map = setting.kind === "transfer_function" ? setting.colorMap : "";
  return { parameters: { ...setting.parameters }, visualization, color_map };
}

/** What can be swept or slid: simulation parameters, and those of the setting's visualization. */
export function sweepable(facts, setting) {
  const isovalue = variation(facts, "isovalue"), functions = variation(facts, "transfer_function");
  const more = setting.kind === "isovalue" ? [{ name: "isovalue", ...isovalue }]
    : setting.kind === "transfer_function" ? POINTS.map(name => ({ name, ...functions.bounds[name] })) : [];
  return [...facts.parameters, ...more];
}

/** The same setting with one value set, whatever kind of parameter it is. */
export function withValue(setting, name, value) {
  if (name in setting.parameters) return { ...setting, parameters: { ...setting.parameters, [name]: value } };
  if (name === "isovalue") return { ...setting, isovalue: value };
  return { ...setting, points: { ...setting.points, [name]: value } };
}

// ---- the address

const numbers = values => values.map(value => String(+value.toPrecision(9))).join(",");

export function addressOf(state, facts) {
  const fields = new URLSearchParams();
  if (state.mode !== "view") fields.set("mode", state.mode);
  const count = state.mode === "compare" ? 2 : 1;
  state.settings.slice(0, count).forEach((setting, i) => writeSetting(fields, "ab"[i], setting));
  const { direction, up, distance, target, field } = state.orbit;
  fields.set("camera", numbers([...direction, ...up, distance, ...target, field]));
  if (state.against !== "setting") fields.set("against", state.against);
  if (state.background !== (facts.background ?? BACKGROUNDS.dark)) fields.set("background", state.background);
  if (state.full !== 512) fields.set("full", state.full);
  if (state.mode === "sweep") for (const [name, value] of Object.entries(state.sweep)) if (value !== "") fields.set(`sweep.${name}`, value);
  return `#${fields}`;
}

function writeSetting(fields, prefix, setting) {
  for (const [name, value] of Object.entries(setting.parameters)) fields.set(`${prefix}.p.${name}`, String(+value.toPrecision(9)));
  if (setting.kind === "base") return;
  fields.set(`${prefix}.show`, setting.kind);
  if (setting.kind === "isovalue") fields.set(`${prefix}.isovalue`, String(+setting.isovalue.toPrecision(9)));
  if (setting.kind === "field") fields.set(`${prefix}.appearance`, setting.appearance);
  if (setting.kind !== "transfer_function") return;
  for (const name of POINTS) if (setting.points[name]) fields.set(`${prefix}.${name}`, String(+setting.points[name].toPrecision(9)));
  if (setting.colorMap) fields.set(`${prefix}.colors`, setting.colorMap);
}

/** The state that an address holds; what it lacks or gets wrong is as at first. */
export function stateOf(address, facts) {
  const fields = new URLSearchParams(address.replace(/^#/, "")), state = firstState(facts);
  const choice = (name, known, otherwise) => known.includes(fields.get(name)) ? fields.get(name) : otherwise;
  state.mode = choice("mode", MODES, state.mode);
  state.against = choice("against", facts.truth ? ["setting", "truth"] : ["setting"], state.against);
  state.settings = [readSetting(fields, "a", facts), readSetting(fields, fields.has("b.p." + facts.parameters[0]?.name) ? "b" : "a", facts)];
  state.orbit = readOrbit(fields.get("camera"), facts.camera);
  if (/^#[0-9a-f]{6}$/i.test(fields.get("background") ?? "")) state.background = fields.get("background").toLowerCase();
  if (FULL_SIZES.includes(Number(fields.get("full")))) state.full = Number(fields.get("full"));
  const names = sweepable(facts, state.settings[0]).map(p => p.name);
  state.sweep.name = choice("sweep.name", names, state.sweep.name);
  state.sweep.second = choice("sweep.second", names.filter(name => name !== state.sweep.name), "");
  const swept = sweepable(facts, state.settings[0]).find(p => p.name === state.sweep.name);
  for (const name of ["low", "high"]) state.sweep[name] = limited(fields.get(`sweep.${name}`), swept, "");
  if (rangeOf(state.sweep, swept).low >= rangeOf(state.sweep, swept).high) state.sweep.low = state.sweep.high = "";
  for (const name of ["count", "secondCount"]) {
    const count = Number(fields.get(`sweep.${name}`));
    if (Number.isInteger(count) && count >= 2 && count <= 24) state.sweep[name] = count;
  }
  return state;
}

/** A number from the address, not farther from the bounds than the server allows. */
function limited(text, { low, high }, otherwise) {
  const value = Number(text), width = high - low;
  if (text === null || text === "" || !Number.isFinite(value)) return otherwise;
  return Math.max(low - BEYOND * width, Math.min(high + BEYOND * width, value));
}

/** From where to where a parameter is swept. */
export const rangeOf = (sweep, p) => ({ low: sweep.low === "" ? p.low : sweep.low, high: sweep.high === "" ? p.high : sweep.high });

function readSetting(fields, prefix, facts) {
  const setting = firstSetting(facts);
  const read = (key, bounds, otherwise) => limited(fields.get(`${prefix}.${key}`), bounds, otherwise);
  for (const p of facts.parameters) setting.parameters[p.name] = read(`p.${p.name}`, p, setting.parameters[p.name]);
  const kind = fields.get(`${prefix}.show`), of = variation(facts, kind);
  if (!of) return setting;
  setting.kind = kind;
  if (kind === "isovalue") setting.isovalue = read("isovalue", of, setting.isovalue);
  if (kind === "field" && of.names.includes(fields.get(`${prefix}.appearance`))) setting.appearance = fields.get(`${prefix}.appearance`);
  if (kind !== "transfer_function") return setting;
  for (const name of POINTS) {
    const { low, high } = of.bounds[name];
    setting.points[name] = Math.max(low, Math.min(high, read(name, of.bounds[name], 0)));
  }
  const maps = of.color_maps.map(map => map.name);
  if (maps.includes(fields.get(`${prefix}.colors`))) setting.colorMap = fields.get(`${prefix}.colors`);
  return setting;
}

function readOrbit(text, otherwise) {
  const values = (text ?? "").split(",").map(Number);
  if (values.length !== 11 || !values.every(Number.isFinite)) return otherwise;
  const direction = values.slice(0, 3), up = values.slice(3, 6), [distance] = values.slice(6), field = values[10];
  const upright = Math.hypot(...direction) > 0.5 && Math.hypot(...up) > 0.5 && distance > 0 && field >= 1 && field <= 150;
  return upright ? { direction, up, distance, target: values.slice(7, 10), field } : otherwise;
}
