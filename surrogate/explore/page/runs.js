// The map of runs: what error to expect over two parameters, or over the only one, with the runs and the place that is shown.

import { Doubt } from "draw/doubt.js";
import { normalized } from "draw/parameters.js";
import { digits, digitsOf, drawn, element, menu } from "../web/elements.js";
import { survey } from "./connection.js";
import { group } from "./groups.js";
import { current, shareOf, tidy, valueAt } from "./state.js";

const CELLS = 20, WIDTH = 288, HEIGHT = 190, LEFT = 40, BOTTOM = 30, TOP = 8, RIGHT = 8; // pixels of the drawing
const REACH = 6; // of a run, in the drawing's pixels
const AWHILE = 8; // milliseconds of computing at a time, so that hands are not held up
// Of expected PSNR, low to high: matplotlib's "viridis", which everybody can tell apart.
const COLORS = ["#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725"];

/** { box, set(setting) }: the map, which moves the two parameters that it shows; null without runs. */
export function runsPanel(explorer) {
  const { facts } = explorer;
  if (!facts.members.length || !facts.parameters.length) return null;
  const map = explorer.map = new RunMap(explorer);
  return { box: map.box, set: setting => map.set(setting) };
}

class RunMap {
  constructor(explorer) {
    Object.assign(this, { explorer, facts: explorer.facts, drawing: 0 });
    const { parameters } = this.facts, names = parameters.map(({ name }) => [name, name]);
    explorer.mapped ??= names.slice(0, 2).map(([name]) => name);
    this.picture = drawn("svg", {
      class: "runs", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img",
      onpointerdown: event => this.press(event), onpointermove: event => event.buttons & 1 && this.press(event),
    });
    this.words = element("p", { class: "hint" });
    this.menus = names.length > 2 ? ["Across", "Up"].map((label, which) => menu(label, `map-${label.toLowerCase()}`, "", names, name => this.choose(which, name))) : [];
    this.box = group("Runs", this.picture, this.words, ...this.menus);
    this.paint([], ...this.axes());
    this.load();
  }

  choose(which, name) {
    const { mapped } = this.explorer;
    if (mapped[1 - which] === name) mapped[1 - which] = mapped[which];
    mapped[which] = name;
    this.redraw();
  }

  /** Ask for the survey, once it is made. */
  async load() {
    const { explorer } = this;
    explorer.surveyed ??= surveyed(this.facts);
    ({ doubt: this.doubt, why: this.why } = await explorer.surveyed);
    if (this.doubt && !explorer.sorted) { // at first over what changes pictures most
      explorer.sorted = true;
      const [lengths] = this.doubt.survey.opens[0].lengths, order = [...lengths.keys()].sort((a, b) => lengths[a] - lengths[b]);
      explorer.mapped = order.slice(0, 2).sort((a, b) => a - b).map(i => this.facts.parameters[i].name);
    }
    this.redraw();
  }

  set(setting) {
    const rest = this.shown().slice(this.axes().length).map(({ name }) => setting.parameters[name]);
    if (String(rest) !== String(this.rest)) this.soon();
    this.rest = rest;
    this.mark(setting);
  }

  soon() {
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => this.redraw(), 150);
  }

  /** All parameters, those of the map first. */
  shown() {
    const { mapped } = this.explorer, axes = mapped.map(name => this.facts.parameters.find(p => p.name === name));
    return [...axes, ...this.facts.parameters.filter(p => !mapped.includes(p.name))];
  }

  axes() { return this.shown().slice(0, Math.min(2, this.facts.parameters.length)); }

  /** Draw the map anew, a part at a time. */
  async redraw() {
    const turn = ++this.drawing, [first, second] = this.axes(), { doubt } = this, setting = current(this.explorer.state);
    this.menus.forEach((one, which) => { one.querySelector("select").value = this.explorer.mapped[which]; });
    const using = doubt && this.used(), cells = second ? CELLS : 1, values = [];
    let until = performance.now() + AWHILE;
    for (let row = 0; using && row < cells; ++row) {
      for (let column = 0; column < CELLS; ++column) {
        const place = { ...setting.parameters, [first.name]: valueAt(first, (column + 0.5) / CELLS) };
        if (second) place[second.name] = valueAt(second, (row + 0.5) / CELLS);
        values.push(doubt.numbers(normalized(this.facts.parameters, place), using));
        if (performance.now() < until) continue;
        await new Promise(resolve => { setTimeout(resolve); });
        if (turn !== this.drawing || !this.picture.isConnected) return;
        until = performance.now() + AWHILE;
      }
    }
    this.paint(values, first, second);
    this.mark(setting);
  }

  /** The representation that draws, or the one that is calibrated. */
  used() {
    const known = Object.keys(this.doubt.survey.expectations), { using } = current(this.explorer.state);
    return [using.split("-")[0], this.facts.model.chosen, ...known].find(name => known.includes(name));
  }

  paint(values, first, second) {
    const numbers = values.flatMap(one => one ? [one.psnr, ...(second ? [] : [one.low, one.high])] : []);
    const [low, high] = numbers.length ? [Math.floor(Math.min(...numbers)), Math.ceil(Math.max(...numbers))] : [0, 1];
    this.range = [low, Math.max(high, low + 1)];
    const parts = second ? this.cells(values) : this.curve(values);
    const runs = [...this.facts.members.map(member => this.run(member, first, second)), ...(this.explorer.suggested ?? []).map(values => this.diamond(values, first, second))];
    this.ring = drawn("circle", { class: "here", r: 6 });
    this.picture.replaceChildren(...parts, ...runs, ...this.frame(first, second), this.ring);
    this.words.textContent = !values.length ? this.why || "Measuring what to expect…"
      : second ? `Expected PSNR: ${low} (dark) to ${this.range[1]} dB (bright). Dots are runs; drag the ring.` : "Expected PSNR and its interval, dB. Ticks are runs; drag the ring.";
    const spoken = values.length ? `Expected PSNR ${low} to ${this.range[1]} dB over ${first.name}${second ? ` and ${second.name}` : ""}` : "Runs";
    this.picture.setAttribute("aria-label", `${spoken}, ${this.facts.members.length} runs`);
  }

  /** Squares of colours, from below upwards. */
  cells(values) {
    const width = (WIDTH - LEFT - RIGHT) / CELLS, height = (HEIGHT - TOP - BOTTOM) / CELLS, [low, high] = this.range;
    return values.map((one, i) => drawn("rect", {
      x: LEFT + (i % CELLS) * width, y: HEIGHT - BOTTOM - (Math.floor(i / CELLS) + 1) * height, width: width + 0.5, height: height + 0.5,
      fill: one ? colorOf((one.psnr - low) / (high - low)) : "none",
    }));
  }

  /** The expectation over the only parameter, within its interval. */
  curve(values) {
    const x = i => LEFT + (i + 0.5) / CELLS * (WIDTH - LEFT - RIGHT), y = value => this.heightOf(value);
    const line = name => values.map((one, i) => `${x(i)},${y(one[name])}`);
    if (!values.length) return [];
    return [drawn("polygon", { class: "interval", points: [...line("low"), ...line("high").reverse()].join(" ") }),
      drawn("polyline", { class: "expectation", points: line("psnr").join(" ") })];
  }

  heightOf(value) {
    const [low, high] = this.range;
    return HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM);
  }

  place(p, value, vertical) {
    const share = shareOf(p, value);
    return vertical ? HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM) : LEFT + share * (WIDTH - LEFT - RIGHT);
  }

  run({ name, split, values }, first, second) {
    const value = p => values[this.facts.parameters.indexOf(p)], title = drawn("title", {}, `${name} (${split})`);
    const cx = this.place(first, value(first), false);
    if (second) return drawn("circle", { class: `run ${split}`, cx, cy: this.place(second, value(second), true), r: 2.6 }, title);
    return drawn("line", { class: `run ${split}`, x1: cx, x2: cx, y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM - 8 }, title);
  }

  /** A run that is suggested. */
  diamond(values, first, second) {
    const value = p => values[this.facts.parameters.indexOf(p)], x = this.place(first, value(first), false);
    const y = second ? this.place(second, value(second), true) : HEIGHT - BOTTOM - 14;
    return drawn("path", { class: "suggested", d: `M${x - 4.5} ${y}l4.5 -4.5 4.5 4.5 -4.5 4.5z` }, drawn("title", {}, "suggested"));
  }

  /** Names and ends of the axes. */
  frame(first, second) {
    const text = (x, y, words, anchor, extra = {}) => drawn("text", { x, y, "text-anchor": anchor, ...extra }, words);
    const below = HEIGHT - BOTTOM + 12, middle = (HEIGHT - BOTTOM + TOP) / 2, beside = LEFT - 4;
    const [low, high] = second ? [digitsOf(second, second.low, 3), digitsOf(second, second.high, 3)] : this.range.map(value => digits(value));
    const name = second ? second.name : "dB";
    return [
      text(LEFT, below, digitsOf(first, first.low, 3), "start"), text(WIDTH - RIGHT, below, digitsOf(first, first.high, 3), "end"),
      text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 4, first.name + (first.unit ? ` (${first.unit})` : ""), "middle"),
      text(beside, HEIGHT - BOTTOM, low, "end"), text(beside, TOP + 9, high, "end"),
      text(12, middle, name + (second?.unit ? ` (${second.unit})` : ""), "middle", { transform: `rotate(-90 12 ${middle})` }),
    ];
  }

  /** Show where the setting lies. */
  mark(setting) {
    if (!this.ring) return;
    const [first, second] = this.axes(), x = this.place(first, setting.parameters[first.name], false);
    this.ring.setAttribute("cx", Math.max(LEFT - 6, Math.min(WIDTH, x)));
    const y = second ? this.place(second, setting.parameters[second.name], true) : HEIGHT - BOTTOM;
    this.ring.setAttribute("cy", Math.max(0, Math.min(HEIGHT - BOTTOM + 6, y)));
  }

  /** Go where the pointer is: to the run itself that is pressed. */
  press(event) {
    event.preventDefault();
    const box = this.picture.getBoundingClientRect(), { parameters } = current(this.explorer.state);
    const x = (event.clientX - box.left) * WIDTH / box.width, y = (event.clientY - box.top) * HEIGHT / box.height;
    const run = event.type === "pointerdown" && this.facts.members.find(({ values }) => this.isAt(values, x, y));
    if (run) this.facts.parameters.forEach((p, i) => { parameters[p.name] = run.values[i]; });
    else this.put(parameters, x, y);
    this.explorer.moved();
  }

  /** Whether the run of these values is drawn at a place. */
  isAt(values, x, y) {
    const [first, second] = this.axes(), value = p => values[this.facts.parameters.indexOf(p)];
    const down = second ? this.place(second, value(second), true) : y;
    return Math.hypot(this.place(first, value(first), false) - x, down - y) < REACH;
  }

  /** Give parameters the values of a place. */
  put(parameters, x, y) {
    const [first, second] = this.axes(), share = (at, from, to) => Math.max(0, Math.min(1, (at - from) / (to - from)));
    parameters[first.name] = tidy(valueAt(first, share(x, LEFT, WIDTH - RIGHT)), first);
    if (second) parameters[second.name] = tidy(valueAt(second, share(y, HEIGHT - BOTTOM, TOP)), second);
  }
}

function colorOf(share) {
  const place = Math.max(0, Math.min(1, share)) * (COLORS.length - 1), i = Math.min(Math.floor(place), COLORS.length - 2);
  return `color-mix(in srgb, ${COLORS[i + 1]} ${Math.round(100 * (place - i))}%, ${COLORS[i]})`;
}

/** The doubt of a run: { doubt, why }, of which one is there. */
async function surveyed(facts) {
  const expected = await survey();
  return expected.survey ? { doubt: new Doubt(expected, facts.parameters) } : { why: expected.sentence };
}
