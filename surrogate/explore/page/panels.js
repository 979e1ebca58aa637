// The controls beside the picture, a section each.  `explorer` holds the state and hears what is changed.

import { button, digits, digitsOf, element, field, menu, tabs } from "../web/elements.js";
import { stateOf } from "./address.js";
import { PARTS } from "./annotations.js";
import { group } from "./groups.js";
import { numberInput } from "./numbers.js";
import { anglesOf, placedAt, PRESETS, seenFrom, widened, zoomed } from "./orbit.js";
import { orthographicSwitch } from "./orthographic.js";
import { slider } from "./sliders.js";
import { AUTOMATIC, COUNTS, current, endsOf, EVERY_PIXEL, FULL_SIZES, kindsOf, mostRows, rangeOf, sweepable, sweptOf, variation } from "./state.js";
import { BACKGROUNDS } from "./theme.js";
import { transferEditor } from "./transfer.js";
import { extrapolation, KIND_NAMES } from "./words.js";

/** Sliders of the simulation parameters: { box, set(setting) }; those of the names in `swept` are hidden. */
export function parameterPanel(explorer, swept) {
  const { facts } = explorer;
  const sliders = facts.parameters.map((p, i) => slider(p, `parameter-${i}`, value => {
    current(explorer.state).parameters[p.name] = value;
    explorer.moved();
  }));
  sliders.forEach(({ box }, i) => { box.hidden = swept.includes(facts.parameters[i].name); });
  const alone = facts.parameters.every(p => swept.includes(p.name));
  const legend = element("p", { class: "legend", hidden: alone }, element("i", { class: "train" }), "trained", element("i", { class: "validation" }), "validated");
  const members = memberMenu(explorer);
  const box = group("Simulation parameters", ...sliders.map(s => s.box), legend, members?.box);
  const set = setting => {
    facts.parameters.forEach((p, i) => sliders[i].set(setting.parameters[p.name]));
    members?.set(setting);
  };
  return { box, set };
}

/** Members to go to: { box, set(setting) }, where the one is named that a setting shows; null without any. */
function memberMenu(explorer) {
  const { members, parameters } = explorer.facts;
  if (!members.length) return null;
  const choice = element("select", { id: "member", onchange: event => {
    const member = members[+event.target.value];
    parameters.forEach((p, i) => { current(explorer.state).parameters[p.name] = member.values[i]; });
    explorer.refresh();
    explorer.changed();
  } }, element("option", { value: "", disabled: true, selected: true }, "choose…"));
  for (const split of ["train", "validation", "test"]) {
    const group = element("optgroup", { label: split });
    members.forEach((m, i) => { if (m.split === split) group.append(element("option", { value: i }, `${m.name}: ${m.values.map((value, k) => digitsOf(parameters[k], value)).join(", ")}`)); });
    if (group.children.length) choice.append(group);
  }
  const set = setting => {
    const number = members.findIndex(m => parameters.every((p, i) => setting.parameters[p.name] === m.values[i]));
    choice.value = number < 0 ? "" : number;
  };
  return { box: field("Go to member", choice), set };
}

/** The visualization: { box, set(setting) }; null where there is one kind only. */
export function visualizationPanel(explorer, swept) {
  const { facts } = explorer, setting = current(explorer.state), kinds = kindsOf(facts);
  if (kinds.length === 1 && kinds[0] === "base") return null;
  const choose = kind => { current(explorer.state).kind = kind; explorer.set({}); document.getElementById(`kind-${kind}`).focus(); };
  const chooser = tabs("How the field is shown", "kind", "visualization-panel", setting.kind, kinds.map(kind => [kind, KIND_NAMES[kind]]), choose);
  const shown = kindPanel(explorer, setting.kind, swept);
  if (kinds.length === 1) return { box: group("Visualization", shown.box), set: shown.set };
  const panel = element("div", { id: "visualization-panel", role: "tabpanel", "aria-labelledby": `kind-${setting.kind}` }, shown.box);
  return { box: group("Visualization", chooser, panel), set: shown.set };
}

function kindPanel(explorer, kind, swept) {
  const { facts } = explorer, of = variation(facts, kind);
  const change = values => { Object.assign(current(explorer.state), values); explorer.changed(); };
  if (kind === "isovalue") {
    const made = slider({ name: "isovalue", ...of }, "isovalue", isovalue => change({ isovalue }));
    made.box.hidden = swept.includes("isovalue");
    return { box: made.box, set: setting => made.set(setting.isovalue) };
  }
  if (kind === "transfer_function") {
    return transferEditor(of, facts.histogram, change, explorer);
  }
  if (kind === "field") {
    const box = menu("Appearance", "appearance", "", of.names.map(name => [name, name]), appearance => change({ appearance }));
    return { box, set: setting => { box.querySelector("select").value = setting.appearance; } };
  }
  return { box: element("p", { class: "hint" }, "The base appearance, as it was rendered."), set: () => {} };
}

export function viewPanel(explorer) {
  const { facts } = explorer;
  const presets = element("div", { class: "buttons", role: "group", "aria-label": "Look from" }, ...Object.entries(PRESETS).map(([name, direction]) =>
    button(name, () => explorer.look(seenFrom(explorer.state.orbit, direction)), { "aria-label": `Look from ${name.replace("−", "minus ").replace("+", "plus ")}` })));
  const flat = orthographicSwitch(explorer);
  return group("View", presets, cameraNumbers(explorer, flat), element("div", { class: "buttons" }, flat.box,
    button("Reset", () => explorer.look(facts.camera), { id: "reset-view" }),
    facts.truth && button("Nearest stored view", () => explorer.goToStored(found => explorer.look(found.orbit))),
    button("Copy camera", () => explorer.copy(JSON.stringify(explorer.request(false).camera), "camera"))));
}

/** The camera as numbers, which follow what hands do. */
function cameraNumbers(explorer, flat) {
  const { facts } = explorer, orbit = () => explorer.state.orbit, home = facts.camera;
  const far = 50 * home.distance;
  const offered = [ // name, unit, from, to, value of an orbit, orbit of a value
    ["Azimuth", "°", -180, 360, o => anglesOf(o).azimuth, azimuth => placedAt(orbit(), { ...anglesOf(orbit()), azimuth })],
    ["Elevation", "°", -90, 90, o => anglesOf(o).elevation, elevation => placedAt(orbit(), { ...anglesOf(orbit()), elevation })],
    ["Distance", "", far / 1000, far, o => o.distance, distance => zoomed(orbit(), distance / orbit().distance, home)],
    ["Field of view", "°", 1, 120, o => o.field, angle => widened(orbit(), angle, home)],
  ];
  const inputs = offered.map(([name, , least, most, , place]) =>
    numberInput(name.toLowerCase(), () => ({ least, most }), value => explorer.look(place(value)), { id: `camera-${name.toLowerCase().replaceAll(" ", "-")}` }));
  explorer.cameraShown = now => {
    flat.set(now);
    inputs.forEach((input, i) => input.set(+offered[i][4](now).toPrecision(7)));
  };
  explorer.cameraShown(orbit());
  return element("details", { class: "camera" }, element("summary", {}, "Camera as numbers"),
    element("div", { class: "numbers" }, ...inputs.map(({ input }, i) =>
      element("label", {}, element("span", {}, [offered[i][0], offered[i][1] && `(${offered[i][1]})`].filter(Boolean).join(" ")), input))),
    ...inputs.map(({ note }) => note));
}

export function displayPanel(explorer) {
  const { facts, state } = explorer, behind = Object.entries(BACKGROUNDS).map(([name, color]) => [color, name]);
  const hide = (part, isHidden) => explorer.set({ hidden: Object.keys(PARTS).filter(one => one === part ? isHidden : explorer.state.hidden.includes(one)) });
  if (facts.background) behind.push([facts.background, "trained"]);
  if (!behind.some(([color]) => color === state.background)) behind.push([state.background, state.background]);
  return group("Display",
    menu("Background", "background", state.background, behind, background => explorer.set({ background })),
    element("fieldset", { class: "checks" }, element("legend", {}, "In the picture"), ...Object.entries(PARTS).map(([part, name]) =>
      element("label", {}, element("input", { type: "checkbox", id: `show-${part}`, checked: !state.hidden.includes(part), onchange: event => hide(part, !event.target.checked) }), name))),
    explorer.drawing.isOffered && menu("Drawn in", "drawn", state.drawn, [["", `the faster: ${explorer.drawing.card ? "this browser" : "the program"}`],
      ["browser", `this browser (${explorer.drawing.card || "no graphics card"})`], ["program", "the explorer's program"]], drawn => explorer.set({ drawn })),
    menu("Resolution when idle", "full", state.full, FULL_SIZES.map(size => [size, { [AUTOMATIC]: "automatic", [EVERY_PIXEL]: "every pixel" }[size] ?? `${size}²`]), size => explorer.set({ full: +size })));
}

export function comparePanel(explorer) {
  const { state, facts } = explorer;
  const against = menu("With", "against", state.against, [["setting", "another setting"], ["three", "three others, 2×2"], ["truth", "the stored picture", !facts.truth]], chosen => {
    const more = chosen === "three" && state.settings.length < 4 ? [current(state), current(state)].map(one => structuredClone(one)) : [];
    explorer.set({ against: chosen, active: chosen === "setting" ? Math.min(state.active, 1) : state.active, settings: [...state.settings, ...more] });
  });
  const layout = menu("Shown", "layout", state.layout, [["side", "side by side"], ["swipe", "swipe: one over the other"]], chosen => explorer.set({ layout: chosen }));
  if (state.against === "truth")
    return group("Compare", against, layout,
      element("p", { class: "hint" }, "The catalog holds pictures of its own members from its own views, and no others."),
      button("Nearest stored picture", () => explorer.goToStored(found => explorer.takeStored(found)), { id: "nearest-picture" }));
  const names = state.against === "three" ? "ABCD" : "AB", own = names[state.active];
  const edit = element("div", { class: "buttons", role: "group", "aria-label": "Which setting the controls change" }, ...[...names].map((name, i) =>
    button(`Change ${name}`, () => explorer.set({ active: i }), { id: `edit-${name}`, "aria-pressed": state.active === i })));
  const put = settings => explorer.set({ settings }), copied = () => state.settings.map((one, i) => i < names.length ? structuredClone(current(state)) : one);
  if (state.against === "three")
    return group("Compare", against, edit, element("div", { class: "buttons" },
      button(`Copy ${own} to the others`, () => put(copied())), button("Take the snapshots", () => put(snapped(explorer)), { id: "take-snapshots" })));
  return group("Compare", against, layout, edit, element("div", { class: "buttons" },
    button(`Copy ${own} to ${"BA"[state.active]}`, () => put(copied())), button("Swap", () => put([state.settings[1], state.settings[0], ...state.settings.slice(2)]))));
}

/** Settings with those of the first snapshots instead, as far as there are any. */
function snapped({ state, facts, snapshots = [] }) {
  const taken = snapshots.slice(0, state.settings.length).map(({ address }) => current(stateOf(address, facts).state));
  return state.settings.map((own, i) => taken[i] ?? own);
}

export function sweepPanel(explorer) {
  const { state, facts } = explorer, { sweep } = state, known = sweepable(facts, current(state)), { first, second } = sweptOf(state, facts);
  const change = values => explorer.set({ sweep: { ...explorer.state.sweep, ...values } });
  const names = known.map(p => [p.name, p.name]), others = names.filter(([other]) => other !== first.name);
  const counted = (most, now) => [...new Set([...COUNTS.filter(n => n <= most), now])].sort((a, b) => a - b).map(n => [n, String(n)]);
  return group("Sweep",
    menu("Columns", "sweep-first", first.name, names, name => change({ name, low: "", high: "", ...(sweep.second === name && { second: "", secondLow: "", secondHigh: "" }) })),
    limits(sweep, first, false, change),
    menu("Images", "sweep-count", sweep.count, counted(Infinity, sweep.count), count => change({ count: +count })),
    menu("Rows", "sweep-second", sweep.second, [["", "none"], ...others], name => change({ second: name, secondLow: "", secondHigh: "" })),
    second && limits(sweep, second, true, change),
    second && menu("Number of rows", "sweep-rows", sweep.secondCount, counted(mostRows(sweep.count), sweep.secondCount), count => change({ secondCount: +count })));
}

/** From where to where a parameter is swept. */
function limits(sweep, p, second, change) {
  const range = rangeOf(endsOf(sweep, second), p), [low, high] = second ? ["secondLow", "secondHigh"] : ["low", "high"];
  const title = p.name, apart = 1e-6 * (p.high - p.low);
  const from = numberInput(title, () => ({ least: p.least, most: range.high - apart }), value => change({ [low]: value === p.low ? "" : value }), { id: `sweep-${low}` });
  const to = numberInput(title, () => ({ least: range.low + apart, most: p.most }), value => change({ [high]: value === p.high ? "" : value }), { id: `sweep-${high}` });
  from.set(range.low);
  to.set(range.high);
  const labelled = (words, { input }) => element("label", {}, element("span", {}, p.unit ? `${words} (${p.unit})` : words), input);
  const warning = extrapolation(p, range.low, range.high);
  return element("div", {}, element("div", { class: "numbers" }, labelled("From", from), labelled("To", to)), from.note, to.note,
    warning && element("p", { class: "warning outside" }, warning));
}

/** What draws the picture, to be chosen where there are several, with its size and speed. */
export function modelPanel(explorer) {
  const { model } = explorer.facts, ways = model.representations, setting = current(explorer.state), rounded = number => digits(+number.toPrecision(2));
  const choose = using => { current(explorer.state).using = using; explorer.set({}); document.getElementById("using").focus(); };
  const facts = ({ name, words, megabytes, milliseconds }) => [name === "gaussians" ? `${model.gaussians.toLocaleString("en")} Gaussians` : words,
    `${rounded(megabytes)} MB`, milliseconds && `${rounded(milliseconds)} ms a picture`].filter(Boolean).join(", ");
  return group("Model",
    ways.length > 1 && menu("Drawn by", "using", setting.using, [["", model.best ?? "the best on validation"], ...ways.map(one => [one.name, one.words])], choose),
    element("p", { class: "hint" }, [...model.contents ?? ways.map(facts), model.seconds && `trained in ${Math.round(model.seconds)} s`].filter(Boolean).join("; ")));
}
