// The probe: the emulated field's value where the pointer is, with its error, and pins, places in the world whose values are kept in sight.

import { button, digits, drawn, element } from "../web/elements.js";
import { lensOf } from "./annotations.js";
import { Gone, probed } from "./connection.js";
import { group } from "./groups.js";
import { Newest } from "./newest.js";
import { inksOf } from "./overlay.js";
import { current, messageOf, MOST_PINS } from "./state.js";

const APART = 14, STILL = 4; // pixels of the reading from the pointer, and of a press that moves nothing
const RADIUS = 9, LETTER = 7; // pixels of a pin and of a letter beside it

export class Probe {
  constructor(explorer) {
    this.explorer = explorer;
    this.tool = button("⊕", () => this.turn(), { id: "toggle-probe", "aria-label": "Probe: values under the pointer (v)", title: "Probe: values under the pointer (v)" });
    this.reading = element("div", { id: "reading", role: "status", hidden: true });
    this.cross = element("div", { id: "cross", "aria-hidden": "true", hidden: true });
    this.words = element("p", { class: "hint", role: "status" });
    this.list = element("ol", { class: "pins" });
    this.box = group("Probe", this.words, this.list);
    this.under = new Newest(({ request, pixel }) => probed(request, pixel, []), (answer, asked) => this.read(answer, asked), error => this.fail(error));
    this.pinned = new Newest(({ request, pins }) => probed(request, null, pins), (answer, asked) => this.keep(answer, asked), error => this.fail(error));
    window.addEventListener("keydown", event => this.press(event));
  }

  /** Hear of the pointer on the stage. */
  listen(stage) {
    this.stage = stage;
    stage.addEventListener("pointerdown", event => { this.from = [event.clientX, event.clientY]; });
    stage.addEventListener("pointermove", event => event.buttons ? this.leave() : this.point(event));
    stage.addEventListener("pointerleave", () => this.leave());
    stage.addEventListener("click", event => this.click(event));
    stage.addEventListener("focusout", () => this.leave());
    stage.addEventListener("input", () => this.drawPins()); // the divider of two pictures
    stage.addEventListener("keydown", event => {
      if (!this.isOn || event.key !== "Enter" || event.target !== stage) return;
      event.preventDefault();
      this.ask(this.middle(), true);
    });
  }

  get isOn() { return this.explorer.state.probe; }

  turn() {
    this.explorer.state.probe = !this.isOn;
    this.explorer.changed(false);
    this.refresh();
    if (this.isOn) this.follow();
  }

  press(event) {
    if (event.key !== "v" || event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.("input, select, textarea, dialog")) return;
    event.preventDefault();
    this.turn();
  }

  /** Show the state. */
  refresh() {
    const { state } = this.explorer;
    this.tool.setAttribute("aria-pressed", state.probe);
    this.box.hidden = !state.probe && !state.pins.length;
    this.stage?.classList.toggle("is-probed", state.probe);
    if (!state.probe) this.leave();
    this.words.textContent = this.why ?? (state.probe ? "Point at the picture. A press pins the place; so does Enter, in the middle." : "");
    this.showPins();
  }

  // ---- the pointer

  point(event) {
    const at = this.isOn && this.placeOf(event);
    this.at = at || null;
    if (at) this.ask(at, false);
    else this.leave();
  }

  click(event) {
    const moved = this.from && Math.hypot(event.clientX - this.from[0], event.clientY - this.from[1]) > STILL;
    if (!this.isOn || moved || event.detail > 1 || event.target.closest("button, input, [role=button]")) return;
    const at = this.placeOf(event);
    if (at) this.ask({ ...at, isTouch: event.pointerType === "touch" }, true);
  }

  leave() {
    this.at = null;
    this.under.drop();
    this.reading.hidden = this.cross.hidden = true;
  }

  /** Where an event lies in a pane that shows a prediction: { pane, pixel, x, y }; null elsewhere. */
  placeOf({ clientX, clientY }) {
    const { panes, planned } = this.explorer, isIn = box => clientX >= box.left && clientX < box.right && clientY >= box.top && clientY < box.bottom;
    const within = panes.findIndex(one => isIn(one.box.getBoundingClientRect()));
    if (!this.frame || within < 0) return null;
    const box = panes[within].canvas.getBoundingClientRect(), pane = planned.isSwipe && clientX > box.left + this.divider * box.width ? 1 : within;
    if (pane >= planned.settings.length) return null;
    const { size } = this.frame, scale = Math.min(box.width / size[0], box.height / size[1]);
    const pixel = [clientX - box.left - (box.width - scale * size[0]) / 2, clientY - box.top - (box.height - scale * size[1]) / 2].map(x => x / scale);
    return pixel.every((x, k) => x >= 0 && x <= size[k]) ? { pane, pixel, x: clientX, y: clientY } : null;
  }

  /** The share of the width that the divider of two pictures stands at. */
  get divider() { return parseFloat(this.stage.style.getPropertyValue("--swipe")) / 100; }

  middle() {
    const box = this.explorer.panes[0].canvas.getBoundingClientRect();
    return { pane: 0, pixel: this.frame.size.map(side => side / 2), x: box.left + box.width / 2, y: box.top + box.height / 2, isMiddle: true };
  }

  ask(at, isPress) {
    const { planned } = this.explorer, { camera, size } = this.frame;
    this.under.wish({ request: this.about([planned.settings[at.pane]], camera, size), pixel: at.pixel, at, isPress });
  }

  about(settings, camera, size) {
    return { settings, camera, size, background: "#000000", form: "png", difference: false, truth: false };
  }

  /** Say what is seen at a place, and pin it where it was pressed. */
  read({ seen, unit }, { at, isPress }) {
    this.why = null;
    if (isPress) this.pin(seen);
    if (!this.isOn || at.isTouch || !isPress && !at.isMiddle && !this.at) return;
    const lines = !seen ? [["Nothing is seen here"]] : [seen.value === null ? ["no value beside holes"] : linesOf(seen, unit), [seen.place.map((x, k) => `${"xyz"[k]} ${digits(x, Infinity, 4)}`).join("  ")]].flat();
    this.reading.replaceChildren(...lines.flat().map((line, i) => element(i ? "span" : "strong", {}, line)));
    this.reading.hidden = false;
    this.cross.hidden = !at.isMiddle;
    const room = this.reading.offsetParent.getBoundingClientRect(), { offsetWidth: width, offsetHeight: height } = this.reading;
    const fits = at.x + APART + width < room.right - 4, left = fits ? at.x + APART : at.x - APART - width;
    this.reading.style.left = `${Math.max(4, left - room.left)}px`;
    this.reading.style.top = `${Math.max(4, Math.min(at.y - room.top + APART, room.height - height - 4))}px`;
    Object.assign(this.cross.style, { left: `${at.x - room.left}px`, top: `${at.y - room.top}px` });
  }

  fail(error) {
    this.leave();
    if (error instanceof Gone) return; // it is said where it happens
    this.why = error.message;
    this.refresh();
  }

  // ---- pins

  pin(seen) {
    const { state } = this.explorer;
    if (!seen) return;
    if (state.pins.length >= MOST_PINS) {
      this.explorer.say(`${MOST_PINS} pins are the most: remove one.`);
      return;
    }
    state.pins = [...state.pins, seen.place.map(x => +x.toPrecision(8))];
    this.explorer.changed(false);
    this.follow();
  }

  remove(number) {
    const { state } = this.explorer;
    state.pins = state.pins.filter((_, i) => i !== number);
    this.explorer.changed(false);
    this.follow();
    (this.list.querySelectorAll("button")[Math.max(0, number - 1)] ?? this.tool).focus();
  }

  /** The picture rests: values at pins are asked for anew, where it shows another setting or there are other pins. */
  follow() {
    const { state } = this.explorer, { camera, size } = this.frame ?? {}, settings = this.settings();
    this.refresh();
    if (!camera) return;
    const key = keyOf(settings, state.pins);
    if (state.pins.length && this.known?.key !== key) this.pinned.wish({ request: this.about(settings, camera, size), pins: state.pins, key });
    const isAlone = this.isOn && !this.at && document.activeElement === this.stage && this.stage.matches(":focus-visible");
    if (isAlone) this.ask(this.middle(), false);
  }

  keep({ pins, unit }, { key }) {
    this.known = { key, pins, unit };
    this.showPins();
  }

  /** The newest frame is on the screen: pins lie over it, and another value under the pointer. */
  annotate({ camera, size }) {
    this.frame = { camera, size };
    this.drawPins();
    if (this.isOn && this.at) this.point({ clientX: this.at.x, clientY: this.at.y });
  }

  /** The settings whose values are said: all of a comparison. */
  settings() {
    const { planned, state, facts } = this.explorer;
    return planned && planned.kind !== "sweep" ? planned.settings : [messageOf(current(state), facts)];
  }

  /** Values at pins by setting; null until they are known for what is shown. */
  values() { return this.known?.key === keyOf(this.settings(), this.explorer.state.pins) ? this.known : null; }

  /** Pins for a picture to be saved. */
  marked() {
    const known = this.values(), { pins, active } = this.explorer.state, own = known?.pins[known.pins.length > 1 ? active : 0];
    return pins.map((place, i) => ({ place, text: own ? shortOf(own[i], known.unit) : "" }));
  }

  showPins() {
    const { pins } = this.explorer.state, known = this.values();
    this.list.replaceChildren(...pins.map((place, i) => element("li", {},
      element("span", {}, element("b", {}, String(i + 1)), ` ${known ? known.pins.map((own, which) => `${known.pins.length > 1 ? `${"ABCD"[which]}: ` : ""}${shortOf(own[i], known.unit)}`).join(", ") : this.why ? "no value" : "…"}`,
        element("small", {}, place.map((x, k) => `${"xyz"[k]} ${digits(x, Infinity, 4)}`).join(" "))),
      button("×", () => this.remove(i), { class: "plain", "aria-label": `Remove pin ${i + 1}` }))));
    this.drawPins();
  }

  drawPins() {
    const { panes, planned, state } = this.explorer, known = this.values();
    if (!this.frame || !planned || planned.kind === "sweep") return;
    const lens = lensOf(this.frame.camera, this.frame.size), [ink, around] = inksOf(state.background);
    for (const [which, pane] of panes.slice(0, planned.truth ? 2 : planned.settings.length).entries()) {
      if (!pane.pins) pane.marks.after(pane.pins = drawn("svg", { class: "annotations of-pins", "aria-hidden": "true" }));
      pane.pins.style.cssText = `--ink-here: ${ink}; --around-here: ${around}`;
      pane.pins.setAttribute("viewBox", `0 0 ${pane.canvas.clientWidth} ${pane.canvas.clientHeight}`);
      pane.pins.replaceChildren(...state.pins.flatMap((place, i) => this.mark(lens.project(place), pane.canvas, i, known?.pins[which] && shortOf(known.pins[which][i], known.unit), which)));
    }
  }

  mark([right, down, depth], { clientWidth: width, clientHeight: height }, i, text, which) {
    const { size } = this.frame, scale = Math.min(width / size[0], height / size[1]);
    const x = (width - scale * size[0]) / 2 + scale * right, y = (height - scale * size[1]) / 2 + scale * down;
    if (!(depth > 0) || x < 0 || y < 0 || x > width || y > height) return [];
    const { isSwipe } = this.explorer.planned, divider = this.divider * width;
    if (isSwipe && which !== Number(x > divider)) return []; // values stand over their own picture
    const beside = RADIUS + 5, room = (isSwipe && !which ? divider : width) - x; // to the right
    const [way, anchor] = beside + LETTER * (text?.length ?? 0) > room && x > room ? [-1, "end"] : [1, "start"];
    return [
      drawn("circle", { class: "pin", cx: x, cy: y, r: RADIUS }), drawn("text", { class: "pin-number", x, y, "text-anchor": "middle", "dominant-baseline": "central" }, String(i + 1)),
      text && drawn("text", { class: "pin-value", x: x + way * beside, y, "text-anchor": anchor, "dominant-baseline": "central" }, text),
    ].filter(Boolean);
  }
}

const keyOf = (settings, pins) => JSON.stringify([settings.map(({ parameters, visualization }) => [parameters, visualization.appearance]), pins]);

/** A value to the second digit of its error, with that, and its unit. */
export function shortOf(found, unit) {
  if (!found) return "no value";
  const { value, deviation } = found, behind = unit ? ` ${unit}` : "";
  if (!(deviation > 0)) return `${digits(value, Infinity, 4)}${behind}`;
  const places = Math.max(0, Math.min(12, 1 - Math.floor(Math.log10(deviation)))), isPlain = Math.abs(value) < 1e6 && places < 8;
  if (!isPlain) return `${value.toExponential(3)} ± ${deviation.toExponential(1)}`.replaceAll("-", "−") + behind;
  return `${value.toFixed(places)} ± ${places ? deviation.toFixed(places) : digits(+deviation.toPrecision(2))}`.replace("-", "−") + behind;
}

/** The same, and the interval that nine in ten values lie in. */
function linesOf(found, unit) {
  if (!(found.half > 0)) return [shortOf(found, unit), "error not known here"];
  const places = Math.max(3, Math.ceil(Math.log10(Math.abs(found.value) / found.half)) + 2), text = x => digits(+x.toPrecision(Math.min(15, places)));
  return [shortOf(found, unit), `90 %: ${text(found.value - found.half)} to ${text(found.value + found.half)}`];
}
