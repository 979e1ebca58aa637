// The transfer-function editor: opacity over field values by any number of control points, their colours, and the histogram of the
// field behind.  Values lie on the model's own scale.  Where a model learnt displacements alone, two points move, and within bounds.

import { button, digits, drawn, element } from "../web/elements.js";
import { between, axisOf, colorsOf, displaced, hexOf, settled } from "./functions.js";
import { heightsOf } from "./here.js";
import { exchange } from "./exchange.js";
import { numberInput } from "./numbers.js";
import { tidy } from "./state.js";
import { extrapolation } from "./words.js";

const WIDTH = 280, HEIGHT = 160, PAD = 9, FOOT = 16;
const APART = 1e-3; // of the axis: how near to each other control points may come
const OFF = 24; // pixels beside the editor, from which on a point that is let go is removed
const STOPS = 48; // of the area's gradient
const LETTER = 5.6; // width of a tick's digit

/**
 * `of` is the variation's facts, `changed({ points, free, colorMap })` hears what is set, `explorer` copies and says things.
 * Returns { box, set(setting) }.
 */
export function transferEditor(of, histogram, changed, explorer) {
  const axis = axisOf(of.knots), parameters = Object.fromEntries(of.points.map(p => [p.name, p]));
  let now = { opacity: [], colors: null }, shares = null, colorMap = "", selected = 1, handles = [], from = 0, to = 1;

  const x = value => PAD + (WIDTH - 2 * PAD) * (axis.place(value) - from) / (to - from);
  const y = opacity => HEIGHT - FOOT - (HEIGHT - FOOT - PAD) * opacity;
  const valueAt = place => axis.value(from + (place - PAD) / (WIDTH - 2 * PAD) * (to - from));

  const stops = Array.from({ length: STOPS + 1 }, (_, i) => drawn("stop", { offset: i / STOPS }));
  const line = drawn("polyline", { class: "function" }), area = drawn("polygon", { class: "area", fill: "url(#transfer-colors)" });
  const outline = drawn("path", { class: "here" }), behind = drawn("g"), knobs = drawn("g"), ghost = drawn("polyline", { class: "ghost" });
  const svg = drawn(
    "svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "transfer", role: "group", "aria-label": "Opacity over field values" },
    drawn("defs", {}, drawn("linearGradient", { id: "transfer-colors" }, ...stops)), behind, area, outline, ghost, line, knobs,
  );
  if (of.free) svg.ondblclick = event => { if (event.target.tagName !== "circle") add(at(event)[0]); };

  const hereKey = element("span", { hidden: true }, element("i", { class: "here" }), "here");
  const title = element("div", { class: "scale" }, element("span", {}, of.label || "field value"), element("span", { class: "histograms" }, ...histogram ? [element("i", { class: "all" }), "all runs"] : [], hereKey));
  const row = element("div", { class: "point" });
  const value = numberInput(spoken("value"), () => valueBounds(now, selected), to => move(selected, to, now.opacity[selected][1]), { id: "point-value" });
  const opacity = numberInput(spoken("opacity"), () => opacityBounds(selected), to => move(selected, now.opacity[selected][0], to), { id: "point-opacity" });
  const color = of.free && element("input", { type: "color", id: "point-color", "aria-label": "Colour of the point", oninput: () => paint(color.value) });
  const named = element("strong", {}), valueName = element("span", {}), opacityName = element("span", {});
  row.append(named, element("label", {}, valueName, value.input), element("label", {}, opacityName, opacity.input), ...color ? [color] : []);
  const adding = of.free && button("Add", () => addBeside(selected), { title: "Add a point beside this one (Enter; double click in the picture)" });
  const removing = of.free && button("Remove", () => remove(selected), { title: "Remove this point (Delete; or drag it off)" });
  const reset = button("Reset to base", () => change(displaced(of, firstPlaces()), ""));
  const maps = of.color_maps.length ? element("div", { class: "chips", role: "group", "aria-label": "Colours" }, ...[{ name: "" }, ...of.color_maps].map(chip)) : null;
  const warning = element("p", { class: "warning outside", hidden: true }, "Extrapolating beyond training range: a control point lies outside its dashed box.");
  const hint = of.free && element("p", { class: "hint" }, "Double click adds a point; drag one off, or press Delete, to remove it.");
  const json = of.free && exchange(of, () => ({ made: now, colors: colorsOf(now, colorMap, of) }), made => change(made), explorer);
  const box = element("div", {}, svg, title, maps, row, value.note, opacity.note, warning, element("div", { class: "buttons" }, adding, removing, reset), hint, json);

  /** The name of one of the selected point's numbers, whichever point that is. */
  function spoken(number) { return { toString: () => `${inner(selected) ? nameOf(selected) : "point"} ${number}` }; }

  function firstPlaces() { return Object.fromEntries(of.points.map(p => [p.name, p.origin])); }

  function chip({ name }) {
    return button("", () => change({ ...now, colors: null }, name), { class: "chip", "data-map": name, "aria-label": name || "as trained", title: name || "as trained" });
  }

  // ---- points

  const inner = i => of.points.length && now.opacity.length === 4 && (i === 1 || i === 2);
  const nameOf = i => inner(i) ? `c${i}` : String(i + 1);

  /** From where to where the value of point i of a function can go without crossing its neighbours. */
  function valueBounds({ opacity: points }, i) {
    if (!of.free && parameters[`c${i}_value`] === undefined) return { least: points[i][0], most: points[i][0] };
    const beside = (k, way) => points[k] && axis.value(axis.place(points[k][0]) + way * APART);
    const own = of.free ? { least: axis.value(from), most: axis.value(to) } : parameters[`c${i}_value`];
    return { least: Math.max(own.least, beside(i - 1, 1) ?? -Infinity), most: Math.min(own.most, beside(i + 1, -1) ?? Infinity) };
  }

  const opacityBounds = i => of.free ? { least: 0, most: 1 } : parameters[`c${i}_opacity`];

  /** A function with point i at a value and an opacity, as near as its neighbours let it; its colour comes along. */
  function moved(given, i, toValue, toOpacity, byHand = false) {
    const limit = valueBounds(given, i), high = opacityBounds(i), p = byHand && !of.free && parameters[`c${i}_value`];
    const within = (number, { least, most }) => Math.max(least, Math.min(most, number));
    const value = byHand ? tidied(toValue) : toValue, opaque = byHand ? tidy(toOpacity, { low: 0, high: 1 }) : toOpacity;
    const next = [within(p ? within(value, { least: p.low, most: p.high }) : value, limit), within(opaque, p ? { least: high.low, most: high.high } : high)];
    const before = given.opacity[i][0], opacity = given.opacity.map((point, k) => k === i ? next : point);
    const own = given.colors?.find(point => point[0] === before);
    if (!own || before === next[0]) return { ...given, opacity };
    const passed = given.colors.filter(([at]) => at < Math.min(before, next[0]) || at > Math.max(before, next[0]));
    return { opacity, colors: [...passed, [next[0], own[1]]].sort((a, b) => a[0] - b[0]) };
  }

  /** A value with no more digits than the axis tells apart there. */
  const tidied = value => tidy(value, { low: value, high: axis.value(axis.place(value) + 1 / of.knots.length) });

  const move = (i, toValue, toOpacity) => change(moved(now, i, toValue, toOpacity));

  const without = (given, i) => ({ ...given, opacity: given.opacity.filter((_, k) => k !== i) });
  const removable = given => of.free && given.opacity.length > 2;

  function remove(i) {
    if (!removable(now)) return;
    selected = Math.max(0, Math.min(i, now.opacity.length - 2));
    change(without(now, i));
    handles[selected].focus();
  }

  function add(at) {
    const value = tidied(at), near = now.opacity.some(([other]) => Math.abs(axis.place(other) - axis.place(value)) < 2 * APART);
    if (near || !Number.isFinite(value)) return;
    const opacity = [...now.opacity, [value, tidy(between(now.opacity, value), { low: 0, high: 1 })]].sort((a, b) => a[0] - b[0]);
    selected = opacity.findIndex(point => point[0] === value);
    change({ ...now, opacity });
    handles[selected].focus();
  }

  function addBeside(i) {
    const other = now.opacity[i + 1] ? i + 1 : i - 1, middle = (axis.place(now.opacity[i][0]) + axis.place(now.opacity[other][0])) / 2;
    add(axis.value(middle));
  }

  /** Give the selected point a colour; from then on colours are the function's own, and move with its points. */
  function paint(hex) {
    const [at] = now.opacity[selected], own = now.colors ?? colorsOf(now, colorMap, of).map(([value, ...rgb]) => [value, hexOf(rgb)]);
    change({ ...now, colors: [...own.filter(([value]) => value !== at), [at, hex]].sort((a, b) => a[0] - b[0]) }, "");
  }

  function change(made, map = made.colors ? "" : colorMap) {
    [now, colorMap] = [made, map];
    draw();
    changed({ ...settled(made, of), colorMap: map });
  }

  // ---- hands

  /** [value, opacity] under the pointer, and how many pixels it lies beside the editor. */
  function at(event) {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()), room = svg.getBoundingClientRect();
    const beside = Math.max(room.left - event.clientX, event.clientX - room.right, room.top - event.clientY, event.clientY - room.bottom);
    return [valueAt(Math.max(PAD, Math.min(WIDTH - PAD, point.x))), (y(0) - point.y) / (y(0) - y(1)), beside];
  }

  function handle(i) {
    const still = !of.free && !parameters[`c${i}_value`];
    const made = drawn("circle", still ? { class: "end", r: 3.5 } : { class: "handle", r: 7, tabindex: 0, role: "slider", "aria-valuemin": 0, "aria-valuemax": 1 });
    if (still) return made;
    let start = null; // the function when it was taken
    made.onpointerdown = event => {
      made.setPointerCapture(event.pointerId);
      event.preventDefault();
      made.focus();
      start = now;
    };
    made.onpointermove = event => {
      if (!start || !made.hasPointerCapture(event.pointerId)) return;
      const [toValue, toOpacity, beside] = at(event), off = beside > OFF && removable(start);
      made.classList.toggle("leaves", off);
      now = off ? without(start, i) : moved(start, i, toValue, toOpacity, true);
      if (!off) draw();
      else drawLines();
      changed({ ...settled(now, of), colorMap });
    };
    made.onpointerup = made.onpointercancel = () => {
      start = null;
      if (!made.classList.contains("leaves")) return;
      selected = Math.max(0, Math.min(selected, now.opacity.length - 1));
      draw();
      handles[selected].focus();
    };
    made.onfocus = () => select(i);
    made.onkeydown = event => press(event, i);
    return made;
  }

  function press(event, i) {
    if (of.free && ["Delete", "Backspace", "Enter"].includes(event.key)) {
      event.preventDefault();
      if (event.key === "Enter") addBeside(i);
      else remove(i);
      return;
    }
    const [right, up] = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [0, 0];
    if (!right && !up) return;
    event.preventDefault();
    const [at, opacity] = now.opacity[i], fine = event.shiftKey ? 400 : 40;
    change(moved(now, i, axis.value(axis.place(at) + right / fine), opacity + up / fine, true));
  }

  // ---- drawing

  function select(i) {
    selected = i;
    drawRow();
  }

  function drawRow() {
    const i = Math.min(selected, now.opacity.length - 1), [at, opaque] = now.opacity[i];
    named.textContent = inner(i) ? nameOf(i) : `${nameOf(i)} of ${now.opacity.length}`;
    [valueName.textContent, opacityName.textContent] = [`${spoken("value")}${of.unit ? ` (${of.unit})` : ""}`, `${spoken("opacity")}`];
    value.set(at);
    opacity.set(opaque);
    if (color) color.value = hexOf([1, 2, 3].map(k => between(colorsOf(now, colorMap, of), at, k)));
    if (removing) removing.disabled = !removable(now);
    handles.forEach((made, k) => made.classList.toggle("selected", k === i));
  }

  function drawLines() {
    const colors = colorsOf(now, colorMap, of), corners = [[axis.value(from), now.opacity[0][1]], ...now.opacity, [axis.value(to), now.opacity.at(-1)[1]]].map(([v, o]) => `${x(v)},${y(o)}`);
    line.setAttribute("points", corners.join(" "));
    area.setAttribute("points", [...corners, `${x(axis.value(to))},${y(0)}`, `${x(axis.value(from))},${y(0)}`].join(" "));
    stops.forEach((stop, i) => { stop.setAttribute("stop-color", colorAt(colors, axis.value(from + i / STOPS * (to - from)))); });
  }

  const colorAt = (colors, value) => hexOf([1, 2, 3].map(k => between(colors, value, k)));

  function draw() {
    const colors = colorsOf(now, colorMap, of);
    drawLines();
    if (handles.length !== now.opacity.length) {
      handles = now.opacity.map((_, i) => handle(i));
      knobs.replaceChildren(...handles);
    }
    handles.forEach((made, i) => {
      const [v, o] = now.opacity[i];
      for (const [name, set] of Object.entries({ cx: x(v), cy: y(o), fill: colorAt(colors, v) })) made.setAttribute(name, set);
      if (made.getAttribute("role") !== "slider") return;
      const said = { "aria-valuenow": o.toFixed(3), "aria-valuetext": `value ${digits(v)}, opacity ${digits(o)}`, "aria-label": `Control point ${nameOf(i)}` };
      for (const [name, set] of Object.entries(said)) made.setAttribute(name, set);
    });
    drawRow();
    const places = settled(now, of).points;
    warning.hidden = !of.points.length || Boolean(settled(now, of).free) || !of.points.some(p => extrapolation(p, places[p.name]));
    for (const made of maps?.children ?? []) made.setAttribute("aria-pressed", !now.colors && made.dataset.map === colorMap);
  }

  /** Histogram, dashed boxes where points were trained, base and ticks. */
  function drawBehind() {
    const bars = (histogram?.heights ?? []).map((height, i) => {
      const [left, right] = [x(histogram.edges[i]), x(histogram.edges[i + 1])];
      return height > 0 && drawn("rect", { class: "bar", x: left, width: Math.max(0.5, right - left), y: y(height * 0.95), height: y(0) - y(height * 0.95) });
    });
    drawHere();
    const allowed = of.points.length ? [1, 2].map(i => {
      const [value, opacity] = [parameters[`c${i}_value`], parameters[`c${i}_opacity`]], left = x(value.low), top = y(Math.min(1, opacity.high));
      return drawn("rect", { class: "allowed", x: left, y: top, width: x(value.high) - left, height: y(Math.max(0, opacity.low)) - top });
    }) : [];
    const texts = of.knots.map(knot => digits(knot, of.knots.at(-1) - of.knots[0], 2)), last = texts.length - 1, widths = texts.map(text => LETTER * text.length);
    const starts = of.knots.map((knot, i) => x(knot) - (i === 0 ? 0 : i === last ? widths[i] : widths[i] / 2));
    let end = -Infinity;
    const ticks = of.knots.map((knot, i) => {
      if (starts[i] < end || (i < last && starts[i] + widths[i] + LETTER > starts[last])) return null;
      end = starts[i] + widths[i] + LETTER;
      return drawn("text", { x: starts[i], y: HEIGHT - 3 }, texts[i]);
    });
    behind.replaceChildren(...[...bars, ...allowed, ...ticks].filter(Boolean));
    ghost.setAttribute("points", of.function.opacity_points.map(([v, o]) => `${x(v)},${y(o)}`).join(" "));
    for (const made of maps?.children ?? []) {
      const colors = colorsOf({ colors: null }, made.dataset.map, of), [first, last] = [colors[0][0], colors.at(-1)[0]];
      const at = share => made.dataset.map ? first + share * (last - first) : axis.value(share);
      made.style.background = `linear-gradient(to right, ${Array.from({ length: 13 }, (_, i) => colorAt(colors, at(i / 12))).join(", ")})`;
    }
  }

  /** The outline of the histogram of what is shown, on the axis of that of all runs. */
  function drawHere() {
    hereKey.hidden = !shares;
    const heights = shares ? heightsOf(shares, histogram) : [];
    outline.setAttribute("d", heights.map((height, i) => `${i ? "L" : "M"}${x(shares.edges[i])} ${y(0.95 * height)}H${x(shares.edges[i + 1])}`).join(""));
  }

  explorer.hereShown = found => {
    shares = found;
    drawHere();
  };

  function set(setting) {
    [now, colorMap] = [setting.free ?? displaced(of, setting.points), setting.colorMap];
    const places = [...now.opacity, of.function.opacity_points[0], of.function.opacity_points.at(-1)].map(([value]) => axis.place(value));
    [from, to] = [Math.min(0, ...places), Math.max(1, ...places)];
    selected = Math.min(selected, now.opacity.length - 1);
    drawBehind();
    draw();
  }

  return { box, set };
}
