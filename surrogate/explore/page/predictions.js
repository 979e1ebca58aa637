// Predictions all over the parameters beside the runs, in parallel coordinates: brushed outcomes find parameters.

import { button, element, field, menu } from "../web/elements.js";
import { Gone, predictions } from "./connection.js";
import { group } from "./groups.js";
import { numberInput } from "./numbers.js";
import { axesOf, best, tableOf } from "./outcomes.js";
import { Parallel } from "./parallel.js";
import { current, messageOf, shareOf } from "./state.js";
import { valued } from "./words.js";

const EVERY = 250, LISTED = 12; // milliseconds between questions; rows of the menu

export class Predictions {
  constructor(explorer) {
    this.explorer = explorer;
    this.plot = new Parallel(() => this.change({ brushes: { ...this.plot.brushes } }), row => this.go(row), row => this.describe(row));
    this.words = element("p", { class: "said", role: "status" });
    this.progress = element("progress", { max: 1, hidden: true, "aria-label": "Predictions that are made" });
    this.stopping = button("Stop", () => this.close(), { id: "stop-predictions", hidden: true });
    this.level = numberInput("the level", () => ({ least: -Infinity, most: Infinity }), value => this.change({ level: value }), { id: "level" });
    this.levelBox = field("Level", this.level.input);
    this.list = menu("Go to", "go-to", "", [], row => row && this.go(+row));
    this.clearing = button("Clear brushes", () => this.plot.clear(), { id: "clear-brushes" });
    this.tools = element("div", { class: "tools-of-predictions", hidden: true }, this.levelBox, this.list, this.clearing);
    const head = element("div", { class: "head-of-predictions" }, this.words, this.progress, this.stopping, this.tools, button("×", () => this.close(), { class: "plain", id: "close-predictions", "aria-label": "Close the predictions" }));
    this.panel = element("div", { class: "predictions" }, head, this.level.note, this.plot.box);
    this.box = group("Predictions", this.panel);
    this.fold = this.box.querySelector("details");
    this.fold.classList.add("drawer");
    this.fold.addEventListener("toggle", () => this.follow());
  }

  /** The address holds another state, whose brushes are to be seen. */
  read() {
    if (Object.keys(this.explorer.state.brushes).length) this.fold.open = true;
  }

  get isOpen() { return this.fold.open && this.fold.isConnected; }

  close() {
    this.fold.open = false;
    this.fold.querySelector("summary").focus();
  }

  /** The picture rests, or the panel was opened: make what is shown here. */
  follow() {
    if (!this.isOpen) return;
    const { state } = this.explorer, { kind, appearance } = current(state), key = kind === "field" ? appearance : "";
    if (this.key === key) {
      if (this.table) this.show();
      return;
    }
    if (this.making !== key) this.make(key);
  }

  /** Ask until the predictions are there, or nobody wants them any more. */
  async make(key) {
    const { explorer } = this;
    this.making = key;
    this.table = null;
    if (this.key !== undefined) Object.assign(explorer.state, { brushes: {}, level: "" }); // they are of another field
    this.tools.hidden = true;
    this.words.textContent = "Predicting all over the parameters…";
    try {
      while (this.making === key && this.isOpen) {
        const answer = await predictions({ ...explorer.request(false), settings: [messageOf(current(explorer.state), explorer.facts)], difference: false, truth: false });
        if (this.making !== key) return;
        if (answer.done === undefined) {
          [this.table, this.key] = [tableOf(answer), key];
          break;
        }
        this.progress.value = answer.done;
        this.progress.hidden = this.stopping.hidden = false;
        await new Promise(resolve => { setTimeout(resolve, EVERY); });
      }
    } catch (error) {
      if (!(error instanceof Gone)) this.words.textContent = error.message;
      if (!(error instanceof Gone)) this.key = key;
    }
    if (this.making === key) this.making = null;
    this.progress.hidden = this.stopping.hidden = true;
    if (this.table) this.show();
  }

  show() {
    const { explorer, table } = this, { state, facts } = explorer, { levels } = table;
    const level = state.level === "" ? +levels[3 * levels.length >> 2].toPrecision(3) : state.level;
    this.level.set(level);
    this.levelBox.title = `Of the axis "share above"${table.unit ? `, in ${table.unit}` : ""}`;
    const axes = axesOf(table, level, state, facts), setting = current(state);
    this.plot.show(table, axes, state.brushes, axes.map((axis, i) => axis.isOutcome ? null : shareOf(facts.parameters[i], setting.parameters[axis.key])));
    this.tools.hidden = false;
    this.count();
  }

  /** Brushes or the level have changed: they are part of the state. */
  change(values) {
    Object.assign(this.explorer.state, values);
    this.explorer.changed(false);
    if ("level" in values) this.show();
    else this.count();
  }

  /** Say how many pass the brushes, and list the best of them. */
  count() {
    const { axes, brushes, passes } = this.plot, { table } = this, isBrushed = Object.keys(brushes).length > 0;
    const runs = passes.filter((does, i) => does && i < table.runs).length, others = passes.filter(Boolean).length - runs, all = table.count - table.runs;
    this.said = isBrushed ? `${others} of ${all} predictions${table.runs ? ` and ${runs} of ${table.runs} runs` : ""} pass.`
      : `${all} predictions${table.runs ? `, ${table.runs} runs solid` : ""}. Drag along an axis, press a line.`;
    this.words.textContent = this.said;
    this.clearing.disabled = !isBrushed;
    const select = this.list.querySelector("select"), rows = isBrushed ? best(axes, brushes, passes).slice(0, LISTED) : [];
    select.replaceChildren(element("option", { value: "" }, isBrushed ? rows.length ? "the best…" : "none passes" : "brush first"), ...rows.map(row => element("option", { value: row }, this.named(row))));
    select.disabled = !rows.length;
  }

  named(row) {
    const { facts } = this.explorer;
    return `${row < this.table.runs ? "run: " : ""}${facts.parameters.map((p, i) => valued(p, +this.table.parameters[row][i].toPrecision(4))).join(", ")}`;
  }

  /** Say what the line under the pointer is. */
  describe(row) { this.words.textContent = row === null ? this.said : this.named(row); }

  /** Show the picture of a row's parameters. */
  go(row) {
    const { explorer, table } = this, { parameters } = current(explorer.state);
    explorer.facts.parameters.forEach((p, i) => { parameters[p.name] = +table.parameters[row][i].toPrecision(row < table.runs ? 17 : 8); });
    explorer.moved();
  }
}
