// The explorer's page: one state, controls that change it, and a stream of frames that show it.

import { addressOf, stateOf } from "./address.js";
import { askPanel } from "./ask.js";
import * as connection from "./connection.js";
import { cutPanel } from "./cutting.js";
import { button, digits, element, markTab, tabs } from "../web/elements.js";
import { Drawing } from "./drawing.js";
import { exportPanel } from "./exports.js";
import { listen } from "./hands.js";
import { Here } from "./here.js";
import { link } from "./link.js";
import { firstFacts, Lost } from "./lost.js";
import { Making } from "./making.js";
import { cameraOf, rounded, seenAlong } from "./orbit.js";
import { overlay, saidOf } from "./overlay.js";
import { build, plan } from "./panes.js";
import { Predictions } from "./predictions.js";
import { Probe } from "./probe.js";
import { comparePanel, displayPanel, modelPanel, parameterPanel, sweepPanel, viewPanel, visualizationPanel } from "./panels.js";
import { decoded, paint, sideOf, sizeFor, squareOf } from "./pictures.js";
import { runsPanel } from "./runs.js";
import { current, messageOf, pointsOf, possibleSweep } from "./state.js";
import { Room } from "./room.js";
import { snapshotsPanel } from "./snapshots.js";
import { Steps } from "./steps.js";
import { Stream } from "./stream.js";
import { firstBackground } from "./theme.js";
import { Trust } from "./trust.js";
import { described } from "./words.js";

const LEAST_EXPORT = 256; // pixels of the shorter side of films and sheets
const MOST_SIDE = 2048; // what the program draws
const ADDRESSED = 350; // milliseconds between changes of the address: browsers refuse more than a hundred in half a minute
const GESTURE = 1000; // milliseconds without a change after which the next is a step of its own, to be undone
const MOST_NOTES = 6;
const MODE_NAMES = { view: "Explore", compare: "Compare", sweep: "Sweep" };

class Explorer {
  constructor(facts) {
    this.facts = facts;
    this.panes = [];
    this.times = []; // of frames on the screen in the last second
    this.counted = { moving: 0, whole: 0 };
    this.drawing = new Drawing(() => this.state.drawn, sentence => this.say(sentence));
    this.stream = new Stream(moving => this.request(moving), request => this.drawing.frame(request), (...shown) => this.show(...shown), error => this.fail(error));
    this.steps = new Steps();
    this.making = new Making(sentence => this.say(sentence));
    this.layOut();
    this.readAddress();
    listen(this.stage, () => this.state.orbit, orbit => this.look(orbit), facts.camera, () => this.stream.settle());
    this.probe.listen(this.stage);
    new ResizeObserver(() => this.resized()).observe(this.stage);
    window.addEventListener("hashchange", () => { if (location.hash !== this.written) this.readAddress(); });
    this.lost.listen();
  }

  // ---- the page

  layOut() {
    const { facts } = this;
    this.stage = element("div", {
      id: "stage", tabindex: 0, role: "application", "aria-label":
        "The ensemble: drag or use the arrow keys to turn it, with Shift to move it, wheel or + and − to come nearer, Home to reset",
    });
    this.tabs = tabs("View mode", "mode", "stage-tab", "view", Object.entries(MODE_NAMES), mode => this.set({ mode }));
    this.alert = element("p", { id: "alert", role: "alert", hidden: true });
    this.lost = new Lost(this);
    this.note = element("div", { id: "note", role: "status", hidden: true });
    this.status = element("p", { id: "status" });
    this.trust = new Trust(this);
    this.probe = new Probe(this);
    this.here = new Here(this);
    this.predictions = connection.predictions && new Predictions(this);
    this.room = new Room(before => { if (this.state.background === before) this.set({ background: firstBackground() }); });
    this.colorbar = element("div", { id: "colorbar", hidden: true },
      element("span", {}, "0"), element("i", { "aria-hidden": "true" }), element("span", { id: "colorbar-high" }), element("span", { id: "compared", role: "status" }));
    this.side = element("aside", { "aria-label": "Controls" });
    document.body.replaceChildren(
      element("header", { id: "top" }, element("h1", {}, facts.title), this.tabs, this.steps.box, this.probe.tool, this.room.tools),
      element("main", { id: "stage-panel" }, element("div", { id: "stage-tab", role: "tabpanel" }, this.note, this.stage, this.probe.cross, this.probe.reading, this.alert, this.lost.box, this.colorbar)),
      this.side, this.room.keys,
    );
  }

  /** Show what the address says, and what of it can't be. */
  readAddress() {
    const address = location.hash;
    document.activeElement?.blur(); // what is half typed belongs to the state before
    clearTimeout(this.addressing);
    [this.addressing, this.written] = [0, address];
    const { state, notes } = stateOf(address, this.facts);
    this.state = state;
    const more = notes.length - MOST_NOTES;
    const lines = [...notes.slice(0, MOST_NOTES), more > 0 && `and ${more} more`].filter(Boolean).map(text => element("li", {}, text));
    this.note.replaceChildren(element("div", {}, element("strong", {}, "Parts of this link could not be applied:"), element("ul", {}, ...lines)),
      button("Close", () => { this.note.hidden = true; }));
    this.note.hidden = !notes.length;
    this.arrange();
    this.refresh();
    this.predictions?.read();
    this.stream.settle();
  }

  /** Build what depends on the mode and on which kind of visualization is shown. */
  arrange() {
    const { state } = this, swept = state.mode === "sweep" ? [state.sweep.name, state.sweep.second] : [];
    markTab(this.tabs, `mode-${state.mode}`);
    document.getElementById("stage-tab").setAttribute("aria-labelledby", `mode-${state.mode}`);
    document.body.dataset.mode = state.mode;
    const parameters = parameterPanel(this, swept), runs = runsPanel(this);
    this.ofParameters = [parameters, runs].filter(Boolean);
    this.controls = [parameters, visualizationPanel(this, swept), cutPanel(this), runs].filter(Boolean);
    this.ask = askPanel(this);
    const parts = [
      this.trust.box, state.mode === "compare" && comparePanel(this), state.mode === "sweep" && sweepPanel(this),
      ...this.controls.map(panel => panel.box), this.predictions?.box, this.ask?.box, this.probe.box, snapshotsPanel(this), viewPanel(this), displayPanel(this), exportPanel(this), modelPanel(this), this.status,
    ];
    const { id } = document.activeElement ?? {};
    this.side.replaceChildren(...parts.filter(Boolean));
    if (id) document.getElementById(id)?.focus({ preventScroll: true });
    this.arrangement = arrangementOf(state);
    this.colorbar.hidden = state.mode !== "compare" || state.against === "three"; // now, so that the first picture has the room that the others have
    this.built = "";
  }

  // ---- changing

  /** Whether the newest wish is on the screen, whole, in the room there is. */
  get resting() { return this.stream.resting && !this.resizing; }

  /** Draw anew for the room there is: only a whole frame, whose words take as much room as before. */
  resized() {
    clearTimeout(this.resizing);
    this.resizing = setTimeout(() => {
      this.resizing = 0;
      this.stream.settle();
    }, 100);
  }

  /** Change the state, and show it in the controls and on the stage. */
  set(values) {
    Object.assign(this.state, values);
    this.state.sweep = possibleSweep(this.state, this.facts);
    if (this.arrangement !== arrangementOf(this.state)) this.arrange();
    this.refresh();
    this.changed();
  }

  /** Show a state on the way to another. */
  travel(state) {
    const { active, sweep } = this.state;
    this.set({ ...state, mode: "view", active, sweep });
  }

  /** A control has changed parameters: the others of these follow. */
  moved() {
    for (const panel of this.ofParameters) panel.set(current(this.state));
    this.changed();
  }

  look(orbit) {
    this.state.orbit = rounded(orbit);
    this.cameraShown?.(this.state.orbit);
    this.changed();
  }

  /** Controls show the state. */
  refresh() {
    for (const panel of this.controls) panel.set(current(this.state));
    this.cameraShown?.(this.state.orbit);
    this.probe.refresh();
    document.getElementById("stage-panel").style.setProperty("--behind", this.state.background);
  }

  /** The state has changed, and with it what `isSeen`. */
  changed(isSeen = true) {
    const now = performance.now(), due = (this.addressed ?? -Infinity) + ADDRESSED;
    clearTimeout(this.addressing);
    this.isNext ||= now > (this.changedAt ?? -Infinity) + GESTURE;
    this.changedAt = now;
    if (now >= due) this.writeAddress();
    else this.addressing = setTimeout(() => this.writeAddress(), due - now);
    if (isSeen) this.stream.change();
  }

  writeAddress() {
    clearTimeout(this.addressing);
    this.addressing = 0;
    this.addressed = performance.now();
    this.written = addressOf(this.state, this.facts);
    if (this.isNext && this.written !== location.hash) this.steps.add(this.written);
    else this.steps.replace(this.written);
    this.isNext = false;
  }

  /** Ask for the stored picture nearest to what is shown, and let `take` use it. */
  async goToStored(take) {
    try {
      const request = { ...this.request(false), settings: [messageOf(current(this.state), this.facts)], difference: false, truth: false };
      const found = await connection.nearest(request);
      if (!found) return;
      take(found);
      this.set({});
    } catch (error) {
      this.say(error.message);
    }
  }

  /** Show what a stored picture shows. */
  takeStored({ parameters, visualization, orbit }) {
    const setting = Object.assign(current(this.state), { clip: null, slice: null });
    Object.assign(setting.parameters, parameters);
    this.state.orbit = rounded(orbit);
    if ("isovalue" in visualization) setting.isovalue = visualization.isovalue;
    else if ("appearance" in visualization) setting.appearance = visualization.appearance;
    else if (setting.kind === "transfer_function") {
      setting.points = Object.fromEntries(pointsOf(this.facts).map(p => [p.name, p.origin + (visualization[p.name] ?? 0)]));
      Object.assign(setting, { colorMap: "", free: null });
    }
  }

  /** Explore the setting of a cell of the sweep. */
  openCell(number) {
    const { state, planned } = this;
    state.settings[state.active] = structuredClone(planned.cells[number]);
    this.set({ mode: "view" });
    this.stage.focus();
  }

  // ---- files

  /** Width and height of a file: what is seen, of several pictures the stored size, of a stored one exactly that. */
  exportSize(kind, scale) {
    const stored = this.facts.size ?? [512, 512], { mode, against } = this.state;
    if (kind === "comparison" && against === "truth") return stored;
    const times = Math.ceil(LEAST_EXPORT / Math.min(...stored));
    const size = mode === "view" ? this.request(false).size : stored.map(side => times * side);
    const most = Math.min(scale, MOST_SIDE / Math.max(...size));
    return size.map(side => 2 * Math.round(side * most / 2));
  }

  /** The message of what is shown, for a file: of a sweep what it is around, of two settings that which the controls change. */
  exportable(kind, scale) {
    const { state, facts } = this, size = this.exportSize(kind, scale), both = kind === "comparison" && state.against === "setting";
    const settings = (both ? state.settings.slice(0, 2) : [current(state)]).map(setting => messageOf(setting, facts));
    const origins = Object.fromEntries(pointsOf(facts).map(p => [p.name, p.origin]));
    const moved = (name, end) => end === "" ? "" : end - (origins[name] ?? 0);
    const { sweep } = state, { name, second } = sweep;
    const ends = { low: moved(name, sweep.low), high: moved(name, sweep.high), secondLow: moved(second, sweep.secondLow), secondHigh: moved(second, sweep.secondHigh) };
    return {
      kind, settings, size, camera: cameraOf(state.orbit, size), background: state.background, form: "png",
      difference: false, truth: kind === "comparison" && !both, annotations: { ...saidOf(current(state), state, facts), pins: this.probe.marked() }, sweep: state.mode === "sweep" ? { ...sweep, ...ends } : null,
    };
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
    const planned = plan(this.state, this.facts), key = `${planned.kind} ${planned.labels.length} ${planned.columns} ${planned.isSwipe} ${JSON.stringify(planned.heads)}`;
    if (key !== this.built) {
      this.built = key;
      this.panes = build(this.stage, planned);
      if (planned.cells) this.panes.forEach((p, i) => p.open(() => this.openCell(i)));
    }
    this.panes.forEach((p, i) => {
      p.name.textContent = planned.labels[i];
      if (planned.words[i] !== null) p.words.textContent = planned.words[i] ?? ""; // null: the answer tells
      if (moving) p.expected.textContent = "";
    });
    this.planned = planned;
    const share = planned.kind === "sweep" ? 1 / Math.sqrt(Math.max(2, planned.settings.length / 2)) : { compare: 0.7, four: 0.5 }[planned.kind] ?? 1;
    const side = sideOf(this.panes[0].canvas, this.state.full, { moving, isFast: this.drawing.isFast, share });
    const size = { truth: this.facts.size, compare: squareOf(side) }[planned.kind] ?? sizeFor(this.panes[0].canvas, side);
    return {
      settings: planned.settings, camera: cameraOf(this.state.orbit, size), size,
      background: this.state.background, form: moving ? "jpeg" : "png",
      difference: Boolean(planned.difference), truth: Boolean(planned.truth),
    };
  }

  async show(answer, moving, request, isNewest) {
    const bitmaps = await Promise.all(answer.pictures.map(bytes => decoded(bytes, answer.form)));
    if (!isNewest()) return bitmaps.forEach(bitmap => bitmap.close()); // they are decoded side by side
    paint(this.panes.map(p => p.canvas), bitmaps);
    this.annotate(request);
    await new Promise(requestAnimationFrame);
    const now = performance.now();
    this.times = [...this.times.filter(t => t > now - 1000), now];
    this.counted[moving ? "moving" : "whole"] += 1;
    this.alert.hidden ||= this.failed;
    this.failed = false;
    this.describe(answer, moving);
    document.documentElement.dataset.shown = `${this.counted.moving} ${this.counted.whole}`;
  }

  /** Draw what pictures say of themselves over them: of a comparison the box alone. */
  annotate({ camera, size }) {
    const { state, facts, planned } = this, alone = planned.kind === "view";
    this.probe.annotate({ camera, size });
    if (planned.kind === "sweep") return;
    this.panes.slice(0, alone ? 1 : planned.shown?.length ?? 2).forEach(({ canvas, marks }, i) => {
      const said = saidOf(planned.shown?.[i] ?? current(state), state, facts), shown = alone ? said.shown : said.shown.filter(part => part === "box");
      const scale = Math.min(canvas.clientWidth / size[0], canvas.clientHeight / size[1]);
      overlay(marks, { ...said, shown, camera, size: size.map(side => side * scale) }, axis => this.look(seenAlong(state.orbit, axis)));
    });
  }

  describe(answer, moving) {
    const [width, height] = answer.size, rate = this.times.length;
    this.status.textContent = moving
      ? `${answer.drawn.toFixed(0)} ms · ${rate} pictures/s`
      : `${width}×${height} in ${answer.drawn.toFixed(0)} ms by the ${[...new Set(answer.by)].join(", ")}`;
    this.compared(answer, moving);
    if (moving) {
      this.ask?.clear();
      this.trust.clear();
      return;
    }
    this.expect(answer.expected);
    this.ask?.follow();
    this.probe.follow();
    this.here.follow();
    this.predictions?.follow();
    this.panes.forEach((p, i) => p.canvas.setAttribute("aria-label", this.spoken(i)));
  }

  /** Say what error to expect; what is being measured is asked for again. */
  expect(expected) {
    this.trust.say(expected, this.planned.kind, this.panes);
    if (!expected && this.facts.truth) setTimeout(() => this.stream.settle(), 2000);
  }

  compared(answer, moving) {
    const { kind } = this.planned, found = answer.difference;
    if (kind !== "compare" && kind !== "truth") return;
    const missing = kind === "truth" && !answer.truth;
    if (missing && moving) return; // it is looked for where the movement ends
    this.searching = missing && !this.searching;
    if (this.searching) this.goToStored(stored => this.takeStored(stored));
    this.panes.forEach((p, i) => { p.box.classList.toggle("is-missing", missing && i > 0); });
    if (kind === "truth") this.panes[1].words.textContent = answer.truth?.sentence ?? "";
    document.getElementById("colorbar-high").textContent = found ? digits(found.high) : "";
    document.getElementById("compared").textContent = moving || this.searching ? "" : missing ? "The catalog has no picture of this." : found ? differing(found) : "";
  }

  spoken(i) {
    const { state, planned, facts } = this, setting = planned.shown?.[i] ?? current(state);
    return [planned.labels[i], described(setting, facts)].filter(Boolean).join(": ");
  }

  fail(error) {
    if (error instanceof connection.Gone) return; // it is said where it happens
    this.failed = true;
    this.say(error.message);
  }
}

/** What the controls are built for, as text: other values of the same controls move them only. */
const arrangementOf = ({ mode, active, against, sweep, settings }) =>
  JSON.stringify([mode, active, against, sweep, settings[active].kind, settings[active].using]);

/** How far two pictures are from each other, in words. */
function differing({ psnr, maximum }) {
  if (maximum === 0) return "The pictures are bitwise the same.";
  if (maximum < 0.5 / 255) return "The pictures differ by less than the rounding to 8 bits.";
  return `PSNR ${psnr.toFixed(2)} dB (higher is better), largest difference ${digits(+maximum.toPrecision(2))}`;
}

const facts = await firstFacts();
document.title = `${facts.title} · gs-surrogate`;
window.explorer = new Explorer(facts);
if (facts.linked) link(window.explorer);
