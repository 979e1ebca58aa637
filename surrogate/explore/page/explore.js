// The explorer's page: one state, controls that change it, and a stream of frames that show it.

import * as connection from "./connection.js";
import { button, digits, element, field, menu, section, tabs } from "./elements.js";
import { exportPanel } from "./exports.js";
import { listen } from "./hands.js";
import { cameraOf, PRESETS, seenFrom } from "./orbit.js";
import { build, plan } from "./panes.js";
import { decoded, paint, sizeFor } from "./pictures.js";
import { slider } from "./sliders.js";
import { addressOf, BACKGROUNDS, firstSetting, FULL_SIZES, messageOf, rangeOf, sweepable, stateOf, variation } from "./state.js";
import { Stream } from "./stream.js";
import { transferEditor } from "./transfer.js";

const MOVING = 256; // pictures of about so many pixels squared while something moves
const MOST_DECIBELS = 60; // what the program says of equal pictures
const MODE_NAMES = { view: "Explore", compare: "Compare", sweep: "Sweep" };
const KIND_NAMES = { base: "Volume", isovalue: "Isovalue", transfer_function: "Transfer function", field: "Field" };

class Explorer {
  constructor(facts) {
    this.facts = facts;
    this.state = stateOf(location.hash, facts);
    this.panes = [];
    this.times = []; // of frames on the screen in the last second
    this.counted = { moving: 0, whole: 0 };
    this.stream = new Stream(moving => this.request(moving), (...shown) => this.show(...shown), error => this.fail(error));
    this.layOut();
    this.arrange();
    this.refresh();
    listen(this.stage, () => this.state.orbit, orbit => this.look(orbit), facts.camera, () => this.stream.settle());
    new ResizeObserver(() => this.resized()).observe(this.stage);
    window.addEventListener("hashchange", () => {
      if (location.hash === this.written) return;
      this.state = stateOf(location.hash, facts);
      this.arrange();
      this.refresh();
      this.stream.settle();
    });
    this.stream.settle();
  }

  get setting() { return this.state.settings[this.state.active]; }

  /** Names of the parameters that a sweep varies, which no slider sets. */
  get swept() { return this.state.mode === "sweep" ? [this.state.sweep.name, this.state.sweep.second] : []; }

  // ---- the page

  layOut() {
    const { facts } = this;
    this.stage = element("div", {
      id: "stage", tabindex: 0, role: "application", "aria-label":
        "The ensemble: drag or use the arrow keys to turn it, with Shift to move it, wheel or + and − to come nearer, Home to reset",
    });
    this.tabs = tabs("What the window shows", "mode", "stage-panel", this.state.mode, Object.entries(MODE_NAMES), mode => this.set({ mode }));
    this.alert = element("p", { id: "alert", role: "alert", hidden: true });
    this.status = element("p", { id: "status" });
    this.expected = element("p", { id: "expected", role: "status" });
    this.colorbar = element("div", { id: "colorbar", hidden: true },
      element("span", {}, "0"), element("i", { "aria-hidden": "true" }), element("span", { id: "colorbar-high" }), element("span", { id: "compared", role: "status" }));
    this.side = element("aside", { "aria-label": "Controls" });
    document.body.replaceChildren(
      element("header", { id: "top" }, element("h1", {}, facts.title), this.tabs),
      element("main", { id: "stage-panel", role: "tabpanel" }, this.stage, this.alert, this.colorbar,
        element("footer", { id: "caption" }, this.expected, this.status)),
      this.side,
    );
  }

  /** Build what depends on the mode and on which kind of visualization is shown. */
  arrange() {
    const { state } = this;
    for (const tab of this.tabs.children) {
      const chosen = tab.id === `mode-${state.mode}`;
      tab.setAttribute("aria-selected", chosen);
      tab.tabIndex = chosen ? 0 : -1;
    }
    document.getElementById("stage-panel").setAttribute("aria-labelledby", `mode-${state.mode}`);
    const parts = [
      state.mode === "compare" && this.comparePanel(), state.mode === "sweep" && this.sweepPanel(),
      this.parameterPanel(), this.visualizationPanel(), this.viewPanel(), this.displayPanel(), exportPanel(this), this.modelPanel(),
    ];
    this.side.replaceChildren(...parts.filter(Boolean));
    this.built = "";
  }

  parameterPanel() {
    const { facts, swept } = this;
    this.sliders = facts.parameters.map((p, i) => slider(p, `parameter-${i}`, value => {
      this.setting.parameters[p.name] = value;
      this.changed();
    }));
    this.sliders.forEach(({ box }, i) => { box.hidden = swept.includes(facts.parameters[i].name); });
    const alone = facts.parameters.every(p => swept.includes(p.name));
    const legend = element("p", { class: "legend", hidden: alone }, element("i", { class: "train" }), "trained", element("i", { class: "validation" }), "validated");
    return section("Simulation parameters", ...this.sliders.map(s => s.box), legend, this.memberMenu());
  }

  memberMenu() {
    const { members } = this.facts;
    if (!members.length) return null;
    const choice = element("select", { id: "member", onchange: event => {
      const member = members[+event.target.value];
      this.facts.parameters.forEach((p, i) => { this.setting.parameters[p.name] = member.values[i]; });
      this.refresh();
      this.changed();
    } }, element("option", { value: "", disabled: true, selected: true }, "choose…"));
    for (const split of ["train", "validation", "test"]) {
      const group = element("optgroup", { label: split });
      members.forEach((m, i) => { if (m.split === split) group.append(element("option", { value: i }, `${m.name}: ${m.values.map(digits).join(", ")}`)); });
      if (group.children.length) choice.append(group);
    }
    return field("Go to member", choice);
  }

  visualizationPanel() {
    const { facts, setting } = this, kinds = ["base", ...facts.variations.map(v => v.kind)];
    if (kinds.length === 1) return null;
    const choose = kind => { setting.kind = kind; this.set({}); document.getElementById(`kind-${kind}`).focus(); };
    const chooser = tabs("How the field is shown", "kind", "visualization-panel", setting.kind, kinds.map(kind => [kind, KIND_NAMES[kind]]), choose);
    return section("Visualization", chooser, element("div", { id: "visualization-panel", role: "tabpanel", "aria-labelledby": `kind-${setting.kind}` }, this.kindPanel(setting.kind)));
  }

  kindPanel(kind) {
    const { facts } = this, of = variation(facts, kind);
    this.editor = this.isovalue = null;
    if (kind === "isovalue") {
      this.isovalue = slider({ name: "isovalue", ...of }, "isovalue", value => { this.setting.isovalue = value; this.changed(); });
      this.isovalue.box.hidden = this.swept.includes("isovalue");
      return this.isovalue.box;
    }
    if (kind === "transfer_function") {
      this.editor = transferEditor(of, facts.histogram, of.unit,
        points => { this.setting.points = points; this.changed(); },
        name => { this.setting.colorMap = name; this.changed(); });
      return this.editor.box;
    }
    if (kind === "field")
      return menu("Appearance", "appearance", this.setting.appearance, of.names.map(name => [name, name]), name => { this.setting.appearance = name; this.changed(); });
    return element("p", { class: "hint" }, "The base appearance, as it was rendered.");
  }

  viewPanel() {
    const { facts } = this;
    const presets = element("div", { class: "buttons", role: "group", "aria-label": "Look from" }, ...Object.entries(PRESETS).map(([name, direction]) =>
      button(name, () => this.look(seenFrom(this.state.orbit, direction)), { "aria-label": `Look from ${name.replace("−", "minus ").replace("+", "plus ")}` })));
    return section("View", presets, element("div", { class: "buttons" },
      button("Reset", () => this.look(facts.camera), { id: "reset-view" }),
      facts.truth && button("Nearest stored view", () => this.goToStored(found => { this.state.orbit = found.orbit; })),
      button("Copy camera", () => this.copy(JSON.stringify(this.request(false).camera), "camera"))));
  }

  displayPanel() {
    const behind = { ...BACKGROUNDS };
    if (this.facts.background) behind.trained = this.facts.background;
    return section("Display",
      menu("Background", "background", this.state.background, Object.entries(behind).map(([name, color]) => [color, name]), background => this.set({ background })),
      menu("Pixels at rest", "full", this.state.full, FULL_SIZES.map(size => [size, `${size}²`]), size => this.set({ full: +size })));
  }

  comparePanel() {
    const { state, facts } = this;
    const against = menu("With", "against", state.against, [["setting", "another setting"], ["truth", "the stored picture", !facts.truth]], chosen => this.set({ against: chosen }));
    if (state.against === "truth")
      return section("Compare", against,
        element("p", { class: "hint" }, "The catalog holds pictures of its own members from its own views, and no others."),
        button("Nearest stored picture", () => this.goToStored(found => this.takeStored(found)), { id: "nearest-picture" }));
    const edit = element("div", { class: "buttons", role: "group", "aria-label": "Which setting the controls change" }, ...["A", "B"].map((name, i) =>
      button(`Change ${name}`, () => this.set({ active: i }), { id: `edit-${name}`, "aria-pressed": state.active === i })));
    const copy = () => { state.settings[1 - state.active] = structuredClone(this.setting); this.changed(); };
    return section("Compare", against, edit, element("div", { class: "buttons" },
      button(`Copy ${"AB"[state.active]} to ${"BA"[state.active]}`, copy), button("Swap", () => this.set({ settings: [...state.settings].reverse() }))));
  }

  sweepPanel() {
    const { state, facts } = this, known = sweepable(facts, state.settings[0]);
    const change = values => this.set({ sweep: { ...state.sweep, ...values } });
    const names = known.map(p => [p.name, p.name]);
    const swept = known.find(p => p.name === state.sweep.name) ?? known[0], width = swept.high - swept.low;
    const limit = (which, label) => element("label", {}, element("span", {}, label), element("input", {
      type: "number", step: "any", id: `sweep-${which}`, value: +rangeOf(state.sweep, swept)[which].toPrecision(6),
      onchange: event => {
        const value = +event.target.value, range = { ...rangeOf(state.sweep, swept), [which]: value };
        const proper = event.target.value !== "" && range.low < range.high && value > swept.low - width && value < swept.high + width;
        if (!proper) this.say(`A sweep goes from a value to a larger one, near ${digits(swept.low)} to ${digits(swept.high)}.`);
        change(proper ? { [which]: value === swept[which] ? "" : value } : {});
      },
    }));
    const counts = [2, 3, 4, 5, 6, 7, 8, 10, 12].map(n => [n, String(n)]), { name, count, second, secondCount } = state.sweep;
    state.active = 0;
    return section("Sweep",
      menu("Across", "sweep-first", name, names, chosen => change({ name: chosen, low: "", high: "", second: second === chosen ? "" : second })),
      element("div", { class: "numbers" }, limit("low", "From"), limit("high", "To")),
      menu("Pictures", "sweep-count", count, counts, chosen => change({ count: +chosen })),
      menu("Down", "sweep-second", second, [["", "nothing"], ...names.filter(([other]) => other !== name)], chosen => change({ second: chosen })),
      second && menu("Rows", "sweep-rows", secondCount, counts.slice(0, 7), chosen => change({ secondCount: +chosen })));
  }

  modelPanel() {
    const { model } = this.facts;
    return section("Model", element("p", { class: "hint" },
      [`${model.gaussians.toLocaleString("en")} Gaussians`, `${digits(+model.megabytes.toPrecision(2))} MB`, model.seconds ? `trained in ${Math.round(model.seconds)} s` : ""].filter(Boolean).join(", ")));
  }

  // ---- changing

  /** Draw anew for the room there is: only a whole frame, whose words take as much room as before. */
  resized() {
    clearTimeout(this.resizing);
    this.resizing = setTimeout(() => this.stream.settle(), 100);
  }

  /** Change the state, and show it in the controls and on the stage. */
  set(values) {
    Object.assign(this.state, values);
    this.arrange();
    this.refresh();
    this.changed();
  }

  look(orbit) {
    this.state.orbit = orbit;
    this.changed();
  }

  /** Controls show the state. */
  refresh() {
    const { setting, facts } = this;
    facts.parameters.forEach((p, i) => this.sliders[i].set(setting.parameters[p.name]));
    this.isovalue?.set(setting.isovalue);
    this.editor?.set(setting.points, setting.colorMap);
    document.getElementById("stage-panel").style.setProperty("--behind", this.state.background);
  }

  changed() {
    clearTimeout(this.addressing);
    this.addressing = setTimeout(() => this.writeAddress(), 150); // browsers refuse more than a hundred in half a minute
    this.stream.change();
  }

  writeAddress() {
    this.written = addressOf(this.state, this.facts);
    history.replaceState(null, "", this.written);
  }

  /** Ask for the stored picture nearest to what is shown, and let `take` use it. */
  async goToStored(take) {
    try {
      const { settings, ...request } = this.request(false);
      const found = await connection.nearest({ ...request, settings: settings.slice(0, 1), difference: false, truth: false });
      if (!found) return;
      take(found);
      this.set({});
    } catch (error) {
      this.say(error.message);
    }
  }

  /** Show what a stored picture shows. */
  takeStored({ parameters, visualization, orbit }) {
    const { setting } = this;
    Object.assign(setting.parameters, parameters);
    this.state.orbit = orbit;
    if ("isovalue" in visualization) setting.isovalue = visualization.isovalue;
    else if ("appearance" in visualization) setting.appearance = visualization.appearance;
    else if (setting.kind === "transfer_function") {
      setting.points = { ...firstSetting(this.facts).points, ...visualization };
      setting.colorMap = "";
    }
  }

  /** The message of what is shown, for a file: of a sweep what it is around, of two settings that which the controls change. */
  exportable() {
    return { ...this.request(false), settings: [messageOf(this.setting)], difference: false, truth: false };
  }

  async copy(text, what) {
    try {
      await navigator.clipboard.writeText(text);
      this.say(`The ${what} is on the clipboard.`);
    } catch {
      this.say(text);
    }
  }

  say(text) {
    this.alert.textContent = text;
    this.alert.hidden = !text;
    clearTimeout(this.saying);
    this.saying = setTimeout(() => { this.alert.hidden = true; }, 8000);
  }

  // ---- frames

  request(moving) {
    const planned = plan(this.state, this.facts), key = `${planned.kind} ${planned.labels.length} ${planned.columns}`;
    if (key !== this.built) {
      this.built = key;
      this.panes = build(this.stage, planned);
    }
    planned.labels.forEach((label, i) => { this.panes[i].words.textContent = label; });
    this.planned = planned;
    const share = planned.kind === "sweep" ? 1 / Math.sqrt(Math.max(2, planned.settings.length / 2)) : planned.kind === "compare" ? 0.7 : 1;
    const side = share * (moving ? MOVING : this.state.full);
    const size = planned.kind === "truth" ? this.facts.size : sizeFor(this.panes[0].canvas, side);
    return {
      settings: planned.settings, camera: cameraOf(this.state.orbit, size), size,
      background: this.state.background, form: moving ? "jpeg" : "png",
      difference: Boolean(planned.difference), truth: Boolean(planned.truth),
    };
  }

  async show(answer, moving) {
    const bitmaps = await Promise.all(answer.pictures.map(bytes => decoded(bytes, answer.form)));
    paint(this.panes.map(p => p.canvas), bitmaps);
    await new Promise(requestAnimationFrame);
    const now = performance.now();
    this.times = [...this.times.filter(t => t > now - 1000), now];
    this.counted[moving ? "moving" : "whole"] += 1;
    this.alert.hidden ||= this.failed;
    this.failed = false;
    this.describe(answer, moving);
    document.documentElement.dataset.shown = `${this.counted.moving} ${this.counted.whole}`;
  }

  describe(answer, moving) {
    const [width, height] = answer.size, rate = this.times.length;
    this.status.textContent = moving
      ? `${answer.drawn.toFixed(0)} ms · ${rate} pictures/s`
      : `${width}×${height} in ${answer.drawn.toFixed(0)} ms`;
    this.compared(answer);
    if (moving) return;
    const said = answer.expected;
    this.expected.textContent = said ? said.sentence : "Measuring what to expect here…";
    this.expected.classList.toggle("warning", Boolean(said?.warning));
    if (!said && this.facts.truth) setTimeout(() => this.stream.settle(), 2000);
    this.panes.forEach((p, i) => p.canvas.setAttribute("aria-label", this.spoken(i)));
  }

  compared(answer) {
    const { kind } = this.planned, found = answer.difference;
    this.colorbar.hidden = kind !== "compare" && kind !== "truth";
    if (this.colorbar.hidden) return;
    const missing = kind === "truth" && !answer.truth;
    this.panes.forEach((p, i) => { p.box.classList.toggle("is-missing", missing && i > 0); });
    document.getElementById("colorbar-high").textContent = found ? digits(found.high) : "";
    const psnr = found && (found.psnr >= MOST_DECIBELS ? `${MOST_DECIBELS} dB or more` : `${found.psnr.toFixed(2)} dB`);
    document.getElementById("compared").textContent = missing
      ? "The catalog has no picture of this."
      : found ? `${kind === "truth" ? `${answer.truth.split} member ${answer.truth.member}, view ${answer.truth.view}: ` : ""}PSNR ${psnr}, largest difference ${digits(+found.maximum.toPrecision(2))}` : "";
  }

  spoken(i) {
    const { setting } = this, label = this.planned.labels[i];
    const at = Object.entries(setting.parameters).map(([name, value]) => `${name} ${digits(value)}`).join(", ");
    return [label, at, setting.kind === "base" ? "" : KIND_NAMES[setting.kind]].filter(Boolean).join(": ");
  }

  fail(error) {
    this.failed = true;
    this.say(error.message);
  }
}

connection.stopped.then(() => document.body.replaceChildren(element("main", { class: "stopped", role: "alert" },
  element("h1", {}, "The explorer has stopped"),
  element("p", {}, "Start it again on its machine and reload this page: the address keeps what you saw."))));
const facts = await connection.facts();
document.title = `${facts.title} · gs-surrogate`;
window.explorer = new Explorer(facts);
