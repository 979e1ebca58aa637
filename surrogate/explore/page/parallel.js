// Parallel coordinates: a line for each row over upright axes, of which parts are brushed by hands and keys.

import { digits, drawn, element } from "../web/elements.js";
import { passing, placeOn, valueOn } from "./outcomes.js";

const TOP = 50, BOTTOM = 27, BESIDE = 34, REACH = 11, NEAR = 7; // pixels: around the axes, of an axis, of a line
const LETTER = 6.8, STEP = 0.02, FINE = 0.002, LEAST = 0.004; // pixels of a letter; shares of an axis

export class Parallel {
  /** `brushed()` hears that brushes changed, `chosen(row)` that a line was pressed, `hovered(row)` what lies under the pointer, null for none. */
  constructor(brushed, chosen, hovered) {
    Object.assign(this, { brushed, chosen, hovered, axes: [], brushes: {}, passes: [], table: null, over: null, here: [] });
    this.canvas = element("canvas", { "aria-hidden": "true" });
    this.hands = drawn("svg", {
      role: "group", "aria-label": "Parallel coordinates of parameters and outcomes: ends of brushes",
      onpointerdown: event => this.take(event), onpointermove: event => this.move(event), onpointerup: () => this.release(), onpointercancel: () => this.release(),
      onpointerleave: () => this.point(null),
    });
    this.box = element("div", { class: "parallel" }, this.canvas, this.hands);
    new ResizeObserver(() => this.draw()).observe(this.box);
    new MutationObserver(() => this.draw()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  }

  /** Show the rows of a table over axes, and brushes, { axis: [from, to] }; `here` are the places of what is shown now, null where it is not known. */
  show(table, axes, brushes, here) {
    this.brushes = Object.fromEntries(Object.entries(brushes).filter(([key]) => axes.some(axis => axis.key === key)));
    const isNew = String(axes.map(({ key, label }) => [key, label])) !== String(this.axes.map(({ key, label }) => [key, label]));
    Object.assign(this, { table, axes, here });
    this.passes = passing(axes, this.brushes, table.count);
    if (isNew) this.build();
    this.draw();
  }

  clear() {
    this.brushes = {};
    this.change();
  }

  change() {
    this.passes = passing(this.axes, this.brushes, this.table.count);
    this.draw();
    this.brushed();
  }

  // ---- places

  get size() { return [Math.max(60, this.box.clientWidth), Math.max(TOP + BOTTOM + 20, this.box.clientHeight)]; }
  x(i) {
    const [width] = this.size, beside = Math.min(BESIDE, width / (2 * this.axes.length));
    return beside + i * (width - 2 * beside) / Math.max(1, this.axes.length - 1);
  }
  y(place) {
    const [, height] = this.size;
    return height - BOTTOM - Math.max(-0.04, Math.min(1.04, place)) * (height - TOP - BOTTOM);
  }
  placeAt(y) {
    const [, height] = this.size;
    return Math.max(0, Math.min(1, (height - BOTTOM - y) / (height - TOP - BOTTOM)));
  }

  // ---- hands

  at(event) {
    const box = this.box.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  axisAt(x) { return this.axes.findIndex((_, i) => Math.abs(this.x(i) - x) < REACH); }

  take(event) {
    if (!this.table || event.button) return;
    const [x, y] = this.at(event), i = this.axisAt(x);
    event.preventDefault();
    if (i < 0) {
      const row = this.rowAt(x, y);
      if (row !== null) this.chosen(row);
      return;
    }
    const { key } = this.axes[i], now = this.brushes[key], place = this.placeAt(y), end = +event.target.dataset?.end;
    this.hands.setPointerCapture(event.pointerId);
    event.target.focus?.();
    this.taken = { key, from: place, before: now, end: Number.isInteger(end) && event.target.dataset?.axis === key ? end : null, isInside: now && place > now[0] && place < now[1], moved: false };
  }

  move(event) {
    const [x, y] = this.at(event), { taken } = this;
    if (!taken) {
      this.point(this.table && this.axisAt(x) < 0 ? this.rowAt(x, y) : null);
      return;
    }
    const place = this.placeAt(y), { key, from, before, end } = taken, by = place - from;
    if (!taken.moved && Math.abs(by) < LEAST) return;
    taken.moved = true;
    if (end !== null) this.brushes[key] = ordered(before ?? [0, 1], end, place);
    else if (taken.isInside) this.brushes[key] = shifted(before, by);
    else this.brushes[key] = [Math.min(from, place), Math.max(from, place)];
    this.change();
  }

  /** A press that moves nothing takes the axis' brush away. */
  release() {
    const { taken } = this;
    this.taken = null;
    if (!taken || taken.moved || taken.end !== null) return;
    delete this.brushes[taken.key];
    this.change();
  }

  point(row) {
    if (row === this.over) return;
    this.over = row;
    this.hands.style.cursor = row === null ? "" : "pointer";
    this.hovered(row);
    this.draw();
  }

  /** The row whose line passes a place, runs before predictions; null without one. */
  rowAt(x, y) {
    const i = this.axes.findIndex((_, k) => this.x(k) > x) - 1;
    if (i < 0) return null;
    const [left, right] = [this.axes[i], this.axes[i + 1]], share = (x - this.x(i)) / (this.x(i + 1) - this.x(i));
    let found = null, least = NEAR;
    for (let row = 0; row < this.table.count; ++row) {
      if (!this.passes[row]) continue;
      const height = (1 - share) * this.y(placeOn(left, left.values[row])) + share * this.y(placeOn(right, right.values[row])), away = Math.abs(height - y) + (row < this.table.runs ? 0 : 1);
      if (away < least) [found, least] = [row, away];
    }
    return found;
  }

  press(event, key, end) {
    const way = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 5, PageDown: -5 }[event.key], now = this.brushes[key] ?? [0, 1];
    if (event.key === "Delete" || event.key === "Backspace") delete this.brushes[key];
    else if (event.key === "Home" || event.key === "End") this.brushes[key] = ordered(now, end, event.key === "Home" ? 0 : 1);
    else if (way) this.brushes[key] = ordered(now, end, now[end] + way * (event.shiftKey ? FINE : STEP));
    else return;
    event.preventDefault();
    const [from, to] = this.brushes[key] ?? [0, 1];
    if (from <= 0 && to >= 1) delete this.brushes[key];
    this.change();
  }

  // ---- drawing

  /** Axes with both ends of their brushes, to be dragged and moved by keys. */
  build() {
    const names = ["lower", "upper"];
    this.hands.replaceChildren(...this.axes.flatMap(({ key, label }) => [
      drawn("rect", { class: "brush", "data-axis": key }),
      ...names.map((name, end) => drawn("path", {
        class: "end", "data-axis": key, "data-end": end, tabindex: 0, role: "slider", "aria-orientation": "vertical", "aria-valuemin": 0, "aria-valuemax": 1, "aria-label": `${label}: ${name} end of the brush`,
        onkeydown: event => this.press(event, key, end),
      })),
    ]));
  }

  draw() {
    const [width, height] = this.size, scale = devicePixelRatio;
    if (!this.table || !this.box.isConnected) return;
    Object.assign(this.canvas, { width: Math.round(width * scale), height: Math.round(height * scale) });
    this.hands.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const context = this.canvas.getContext("2d"), color = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    context.scale(scale, scale);
    const isBrushed = Object.keys(this.brushes).length > 0, { table, passes } = this, xs = this.axes.map((_, i) => this.x(i));
    const heights = this.axes.map(axis => axis.values.map(value => this.y(placeOn(axis, value))));
    const stroke = (rows, name, alpha, thick) => {
      Object.assign(context, { strokeStyle: color(name), globalAlpha: alpha, lineWidth: thick });
      for (const row of rows) {
        context.beginPath();
        xs.forEach((x, i) => context.lineTo(x, heights[i][row]));
        context.stroke();
      }
      context.globalAlpha = 1;
    };
    const rows = Array.from({ length: table.count }, (_, i) => i), isRun = i => i < table.runs;
    stroke(rows.filter(i => !isRun(i) && !passes[i]), "edge", 0.1, 1);
    stroke(rows.filter(i => isRun(i) && !passes[i]), "edge", 0.35, 1);
    stroke(rows.filter(i => !isRun(i) && passes[i]), isBrushed ? "accent" : "quiet", isBrushed ? 0.55 : 0.2, 1);
    stroke(rows.filter(i => isRun(i) && passes[i]), "ink", isBrushed ? 0.9 : 0.6, 1);
    if (this.over !== null) stroke([this.over], "warning", 1, 2.5);
    this.drawAxes(context, xs, color);
    this.place();
  }

  drawAxes(context, xs, color) {
    const [, height] = this.size, apart = xs.length > 1 ? xs[1] - xs[0] : 200, isTight = this.axes.some(({ label }) => LETTER * label.length > apart - 6);
    const write = (text, x, y, name, weight, room) => {
      context.font = `${weight} 11px ${getComputedStyle(document.body).fontFamily}`;
      const shown = elided(text, room, word => context.measureText(word).width);
      const half = context.measureText(shown).width / 2 + 2, [width] = this.size;
      Object.assign(context, { fillStyle: color(name), textAlign: "center", textBaseline: "alphabetic" });
      context.fillText(shown, Math.max(half, Math.min(width - half, x)), y);
    };
    const numbers = apart < 44 ? 1 : 3; // digits
    this.axes.forEach((axis, i) => {
      Object.assign(context, { strokeStyle: color("edge"), lineWidth: 1.2, globalAlpha: 1 });
      context.beginPath();
      context.moveTo(xs[i], TOP);
      context.lineTo(xs[i], height - BOTTOM);
      context.stroke();
      write(axis.label, xs[i], isTight && i % 2 ? 25 : 12, axis.isOutcome ? "accent" : "ink", 600, isTight ? 2 * apart - 6 : apart - 6);
      write(digits(axis.high, axis.high - axis.low, numbers), xs[i], TOP - 11, "quiet", 400, Infinity);
      write(digits(axis.low, axis.high - axis.low, numbers), xs[i], height - 6, "quiet", 400, Infinity);
      if (this.here[i] === null || this.here[i] === undefined) return;
      Object.assign(context, { strokeStyle: color("accent"), fillStyle: color("panel"), lineWidth: 2 });
      context.beginPath();
      context.arc(xs[i], this.y(this.here[i]), 4, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    });
  }

  /** Put brushes where they are. */
  place() {
    for (const made of this.hands.children) {
      const { axis: key, end } = made.dataset, i = this.axes.findIndex(axis => axis.key === key), axis = this.axes[i], brush = this.brushes[key], [from, to] = brush ?? [0, 1];
      if (end === undefined) {
        made.style.display = brush ? "" : "none";
        for (const [name, value] of Object.entries({ x: this.x(i) - 6, width: 12, y: this.y(to), height: Math.max(1, this.y(from) - this.y(to)) })) made.setAttribute(name, value);
        continue;
      }
      const at = [from, to][end], x = this.x(i), y = this.y(at), way = end === "0" ? 7 : -7;
      made.setAttribute("d", `M${x} ${y}l-6 ${way}h12z`);
      made.setAttribute("aria-valuenow", at.toFixed(3));
      made.setAttribute("aria-valuetext", `${digits(+valueOn(axis, at).toPrecision(4))}${axis.unit ? ` ${axis.unit}` : ""}`);
    }
  }
}

/** A text, or as much of its beginning and end as fits in a room, by its `width(text)`: names often differ in their ends. */
export function elided(text, room, width) {
  for (let letters = text.length, shown = text; ; shown = `${text.slice(0, --letters >> 1)}…${text.slice(1 - letters + (letters >> 1))}`) {
    if (letters <= 3 || width(shown) <= room) return shown;
  }
}

/** A brush whose one end is elsewhere, at most at the other. */
function ordered(brush, end, place) {
  const next = [...brush];
  next[end] = end ? Math.min(1, Math.max(place, brush[0])) : Math.max(0, Math.min(place, brush[1]));
  return next;
}

function shifted([from, to], by) {
  const within = Math.max(-from, Math.min(1 - to, by));
  return [from + within, to + within];
}
