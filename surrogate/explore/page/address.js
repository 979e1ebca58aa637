// The address holds the whole state: what is not there is as at first.  What is there and can't be is named in notes.

import { digits, digitsOf } from "../web/elements.js";
import { PARTS } from "./annotations.js";
import { canCut, cutIn } from "./cuts.js";
import { BACKGROUNDS } from "./theme.js";
import { ofWord, settled, wordOf } from "./functions.js";
import { rounded as roundedOrbit } from "./orbit.js";
import {
  current, endsOf, firstSetting, kindsOf, firstState, firstSweep, FULL_SIZES, MODES, MOST_COUNT, MOST_PINS, OUTCOMES, pointsOf, possibleSweep, rangeOf,
  sweepable, variation,
} from "./state.js";

const SIDES = ["a", "b", "c", "d"], POINTS = ["c1", "c2"];
const LONGEST = 40; // letters of what a note repeats

export function addressOf(state, facts) {
  const fields = new URLSearchParams(), first = firstState(facts);
  const put = (name, value, otherwise) => { if (value !== otherwise) fields.set(name, value); };
  put("mode", state.mode, first.mode);
  const alike = JSON.stringify(state.settings[0]) === JSON.stringify(state.settings[1]);
  state.settings.slice(0, state.against === "three" || state.active > 1 ? 4 : alike ? 1 : 2).forEach((setting, i) => writeSetting(fields, SIDES[i], setting, facts));
  put("active", SIDES[state.active], "a");
  const { direction, up, distance, target, field } = state.orbit;
  fields.set("camera", [...direction, ...up, distance, ...target, field].join(","));
  put("against", state.against, first.against);
  put("background", state.background, facts.background ?? BACKGROUNDS.dark); // whatever theme reads it
  put("full", state.full, first.full);
  put("hide", state.hidden.join(","), "");
  put("drawn", state.drawn, first.drawn);
  put("over", state.over, first.over);
  put("probe", state.probe ? "on" : "", "");
  put("pins", state.pins.map(place => place.join(",")).join(";"), "");
  for (const [axis, ends] of Object.entries(state.brushes)) fields.set(`brush.${axis}`, ends.map(end => +end.toFixed(4)).join(","));
  put("level", state.level, "");
  put("layout", state.layout, first.layout);
  for (const [name, value] of Object.entries(state.sweep)) put(`sweep.${name}`, value, first.sweep[name]);
  return `#${fields}`;
}

function writeSetting(fields, side, setting, facts) {
  const first = firstSetting(facts), put = (name, value, otherwise) => { if (value !== otherwise) fields.set(`${side}.${name}`, value); };
  for (const [name, value] of Object.entries(setting.parameters)) fields.set(`${side}.p.${name}`, value);
  put("show", setting.kind, first.kind);
  put("isovalue", setting.isovalue, first.isovalue);
  put("appearance", setting.appearance, first.appearance);
  put("colors", setting.colorMap, "");
  put("using", setting.using, "");
  for (const name of ["clip", "slice"]) if (setting[name]) fields.set(`${side}.${name}`, setting[name].join(","));
  if (setting.free) fields.set(`${side}.function`, wordOf(setting.free));
  for (const point of POINTS) put(point, placeOf(setting.points, point), placeOf(first.points, point));
}

const placeOf = (points, point) => `${points[`${point}_value`]},${points[`${point}_opacity`]}`;

/** { state, notes }: what an address holds, and sentences about what of it can't be. */
export function stateOf(address, facts) {
  const reading = new Reading(address), state = firstState(facts);
  state.mode = reading.choice("mode", MODES, state.mode);
  const a = readSetting(reading, "a", facts, firstSetting(facts));
  state.against = reading.choice("against", ["setting", "three", ...facts.truth ? ["truth"] : []], state.against);
  const others = SIDES.slice(1, state.against === "three" || reading.has("c.") ? 4 : 2);
  state.settings = [a, ...others.map(side => reading.has(`${side}.`) ? readSetting(reading, side, facts, firstSetting(facts)) : structuredClone(a))];
  const sides = SIDES.slice(0, state.against === "setting" && state.mode === "compare" ? 2 : state.settings.length);
  state.active = SIDES.indexOf(reading.choice("active", sides, "a"));
  state.orbit = readOrbit(reading, state.orbit);
  state.background = readBackground(reading, reading.fields.size ? facts.background ?? BACKGROUNDS.dark : state.background, facts);
  state.full = Number(reading.choice("full", FULL_SIZES.map(String), String(state.full)));
  state.hidden = readHidden(reading);
  state.drawn = reading.choice("drawn", ["browser", "program"], "");
  state.layout = reading.choice("layout", ["side", "swipe"], "side");
  state.over = reading.choice("over", ["error", ...facts.parameters.map(({ name }) => name)], "");
  state.probe = reading.choice("probe", ["on"], "") === "on";
  state.pins = readPins(reading);
  state.brushes = readBrushes(reading, facts);
  state.level = readLevel(reading);
  state.sweep = readSweep(reading, state, facts);
  reading.rest();
  return { state, notes: reading.notes };
}

/** The parts of an address, each taken once; what can't be is noted. */
class Reading {
  constructor(address) {
    this.fields = new URLSearchParams(address.replace(/^#/, ""));
    this.left = new Set([...this.fields.keys()].filter(Boolean));
    this.notes = [];
  }

  has(start) { return [...this.fields.keys()].some(name => name.startsWith(start)); }

  text(name) {
    this.left.delete(name);
    return this.fields.get(name);
  }

  note(name, why, instead) { this.notes.push(`${spoken(name)} = ${short(this.fields.get(name))} ${why}${instead === undefined ? "" : `: ${instead} instead`}`); }

  choice(name, known, otherwise) {
    const text = this.text(name);
    if (text === null || known.includes(text)) return text ?? otherwise;
    this.note(name, "is unknown here", otherwise || "nothing");
    return otherwise;
  }

  /** A number from `least` to `most` of the parameter; for another one the nearest that was trained. */
  number(name, p, otherwise) {
    const text = this.text(name);
    return text === null ? otherwise : this.checked(name, text, p, otherwise);
  }

  checked(name, text, p, otherwise) {
    const value = Number(text);
    if (text.trim() === "" || !Number.isFinite(value)) {
      this.note(name, "is not a number", otherwise === "" ? "the bound" : digits(otherwise));
      return otherwise;
    }
    if (p.least <= value && value <= p.most) return value;
    const nearest = Math.max(p.low, Math.min(p.high, value));
    this.note(name, `can't be drawn, only ${digitsOf(p, p.least)} to ${digitsOf(p, p.most)}`, digitsOf(p, nearest));
    return nearest;
  }

  rest() { for (const name of this.left) this.notes.push(`${short(name)} is not part of a link: left out`); }
}

/** The name of a part for people: "A: Re" of "a.p.Re". */
const spoken = name => short(name.replace(/^([a-d])\.(p\.)?/, (_, side) => `${side.toUpperCase()}: `));
const short = text => text.length > LONGEST ? `${text.slice(0, LONGEST)}…` : text;

function readSetting(reading, side, facts, setting) {
  for (const p of facts.parameters) setting.parameters[p.name] = reading.number(`${side}.p.${p.name}`, p, setting.parameters[p.name]);
  setting.kind = reading.choice(`${side}.show`, kindsOf(facts), setting.kind);
  setting.using = reading.choice(`${side}.using`, ["", ...facts.model.representations.map(one => one.name)], "");
  const isovalue = variation(facts, "isovalue"), field = variation(facts, "field"), functions = variation(facts, "transfer_function");
  if (isovalue) setting.isovalue = reading.number(`${side}.isovalue`, isovalue, setting.isovalue);
  if (field) setting.appearance = reading.choice(`${side}.appearance`, field.names, setting.appearance);
  if (functions) {
    setting.colorMap = reading.choice(`${side}.colors`, ["", ...functions.color_maps.map(map => map.name)], "");
    readPoints(reading, side, setting, facts);
    if (functions.free) readFunction(reading, `${side}.function`, setting, functions);
  }
  const [clip, slice] = ["clip", "slice"].map(name => reading.text(`${side}.${name}`)), able = canCut(facts) || "can't be drawn: there is no emulated field here";
  const cut = cutIn(clip, slice, (name, why) => reading.note(`${side}.${name}`, why, "nothing"));
  for (const name of ["clip", "slice"]) {
    if (cut[name] && able === true) setting[name] = cut[name];
    else if (cut[name]) reading.note(`${side}.${name}`, able);
  }
  return setting;
}

function readPoints(reading, side, setting, facts) {
  const first = { ...setting.points };
  for (const point of POINTS) {
    const name = `${side}.${point}`, text = reading.text(name), parts = (text ?? "").split(",");
    if (text !== null && parts.length !== 2) reading.note(name, "is not a value and opacity", placeOf(first, point));
    if (parts.length !== 2) continue;
    ["value", "opacity"].forEach((axis, i) => {
      const p = pointsOf(facts).find(one => one.name === `${point}_${axis}`);
      setting.points[p.name] = reading.checked(name, parts[i], p, setting.points[p.name]);
    });
  }
  if (first.c1_value !== undefined && setting.points.c1_value >= setting.points.c2_value) {
    reading.notes.push("the control points cross: they stand where they were at first");
    setting.points = first;
  }
}

function readFunction(reading, name, setting, functions) {
  const word = reading.text(name);
  if (word === null) return;
  try {
    Object.assign(setting, settled(ofWord(word), functions));
  } catch (error) {
    reading.note(name, error.message, "the base");
  }
}

function readOrbit(reading, otherwise) {
  const text = reading.text("camera"), values = (text ?? "").split(",").map(Number);
  if (text === null) return otherwise;
  const direction = values.slice(0, 3), up = values.slice(3, 6), [distance] = values.slice(6), field = values[10];
  const proper = [6, 11].includes(values.length) && values.every(Number.isFinite) && text.split(",").every(part => part.trim());
  const upright = Math.hypot(...direction) > 0.5 && Math.hypot(...up) > 0.5;
  if (proper && upright && values.length === 6) return roundedOrbit({ ...otherwise, direction, up }); // as a catalog's page links to it
  if (proper && upright && distance > 0 && field >= 1 && field <= 150) return roundedOrbit({ direction, up, distance, target: values.slice(7, 10), field });
  reading.note("camera", "is not a camera", "the first view");
  return otherwise;
}

function readBackground(reading, otherwise, facts) {
  const known = [...Object.values(BACKGROUNDS), facts.background].filter(Boolean), text = reading.text("background");
  if (text === null || known.includes(text.toLowerCase())) return text?.toLowerCase() ?? otherwise;
  if (/^#[0-9a-f]{6}$/i.test(text)) return text.toLowerCase();
  reading.note("background", "is not a colour #rrggbb", otherwise);
  return otherwise;
}

function readHidden(reading) {
  const names = (reading.text("hide") ?? "").split(",").filter(Boolean), known = Object.keys(PARTS);
  if (names.some(name => !known.includes(name))) reading.note("hide", `names other parts than ${known.join(", ")}`, "those");
  return known.filter(part => names.includes(part));
}

function readPins(reading) {
  const text = reading.text("pins"), places = text ? text.split(";").map(place => place.split(",").map(part => part.trim() ? Number(part) : NaN)) : [];
  if (places.length <= MOST_PINS && places.every(place => place.length === 3 && place.every(Number.isFinite))) return places;
  reading.note("pins", `is not a list of ${MOST_PINS} places at most`, "none");
  return [];
}

function readLevel(reading) {
  const text = reading.text("level"), level = text?.trim() ? Number(text) : NaN;
  if (text === null || Number.isFinite(level)) return text === null ? "" : level;
  reading.note("level", "is not a number", "a usual one");
  return "";
}

function readBrushes(reading, facts) {
  const brushes = {};
  for (const axis of [...facts.parameters.map(({ name }) => name), ...OUTCOMES]) {
    const text = reading.text(`brush.${axis}`), ends = (text ?? "").split(",").map(part => part.trim() ? Number(part) : NaN);
    if (ends.length === 2 && 0 <= ends[0] && ends[0] <= ends[1] && ends[1] <= 1) brushes[axis] = ends;
    else if (text !== null) reading.note(`brush.${axis}`, "is not a part of an axis, from 0 to 1", "none");
  }
  return brushes;
}

function readSweep(reading, state, facts) {
  const sweep = firstSweep(facts), known = sweepable(facts, current(state));
  sweep.name = reading.choice("sweep.name", known.map(p => p.name), sweep.name);
  sweep.second = reading.choice("sweep.second", ["", ...known.map(p => p.name).filter(name => name !== sweep.name)], "");
  for (const [name, ...ends] of [["name", "low", "high"], ["second", "secondLow", "secondHigh"]]) {
    const p = known.find(one => one.name === sweep[name]);
    if (!p) continue;
    for (const end of ends) sweep[end] = reading.number(`sweep.${end}`, p, "");
    const range = rangeOf(endsOf(sweep, name === "second"), p);
    if (range.low < range.high) continue;
    reading.notes.push(`a sweep goes from a value to a larger one, not from ${digits(range.low)} to ${digits(range.high)}: over the bounds instead`);
    for (const end of ends) sweep[end] = "";
  }
  for (const name of ["count", "secondCount"]) {
    const text = reading.text(`sweep.${name}`), count = Number(text);
    if (text === null) continue;
    if (Number.isInteger(count) && count >= 2 && count <= MOST_COUNT) sweep[name] = count;
    else reading.note(`sweep.${name}`, `is not 2 to ${MOST_COUNT}`, sweep[name]);
  }
  const possible = possibleSweep({ ...state, sweep }, facts);
  if (possible.secondCount !== sweep.secondCount) reading.notes.push(`too many images: ${possible.secondCount} rows instead of ${sweep.secondCount}`);
  return possible;
}
