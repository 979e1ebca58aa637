// The transfer-function editor: opacity over field values, two points of which can be moved; the histogram of the field behind.

import { button, digits, drawn, element, menu } from "../web/elements.js";
import { numberInput } from "./numbers.js";
import { tidy } from "./state.js";
import { extrapolation } from "./words.js";

const WIDTH = 280, HEIGHT = 150, PAD = 8;
const APART = 1e-3; // of the range of values: how near to each other control points may come

/**
 * `of` is the variation's facts: points, opacity_points, gradient, color_maps, label.  `moved(points)` hears where the control points
 * are, `colored(name)` a colour map.  A hand moves points where they were trained; typed numbers may go farther.  Returns
 * { box, set(points, colorMap) }.
 */
export function transferEditor(of, histogram, moved, colored) {
  const base = of.opacity_points, low = base[0][0], high = base[3][0];
  const x = value => PAD + (WIDTH - 2 * PAD) * (value - low) / (high - low);
  const y = opacity => HEIGHT - PAD - (HEIGHT - 2 * PAD) * opacity;
  const parameters = Object.fromEntries(of.points.map(p => [p.name, p])), first = Object.fromEntries(of.points.map(p => [p.name, p.origin]));
  let points = { ...first };

  const line = drawn("polyline", { class: "function" }), area = drawn("polygon", { class: "area" });
  const ghost = drawn("polyline", { class: "ghost", points: base.map(([v, o]) => `${x(v)},${y(o)}`).join(" ") });
  const ends = [base[0], base[3]].map(([v, o]) => drawn("circle", { class: "end", cx: x(v), cy: y(o), r: 3.5 }));
  const handles = [1, 2].map(handle);
  const svg = drawn(
    "svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "transfer", role: "group", "aria-label": "Opacity over field values" },
    bars(), ...[1, 2].map(allowed), area, ghost, line, ...ends, ...handles,
  );
  const gradient = element("div", { class: "gradient", "aria-hidden": "true" });
  const scale = element("div", { class: "scale" }, element("span", {}, digits(low)), element("span", {}, of.label || (of.unit ? `field value (${of.unit})` : "field value")), element("span", {}, digits(high)));
  const inputs = of.points.map(numberFor), warning = element("p", { class: "warning outside", hidden: true }, "Extrapolating beyond training range: a control point lies outside its dashed box.");
  const colors = of.color_maps.length ? [
    menu("Colours", "color-map", "", [["", "as trained"], ...of.color_maps.map(({ name }) => [name, name])], name => { paintColors(name); colored(name); }),
    element("p", { class: "hint" }, "Colours other than the trained ones are computed from learnt field values: good, not exact."),
  ] : [];
  const reset = button("Reset to base", () => change({ ...first }));
  const box = element("div", {}, svg, gradient, scale, ...colors, element("div", { class: "numbers" }, ...inputs.map(input => input.label)),
    ...inputs.map(input => input.number.note), warning, reset);

  function valueOf(i) { return [points[`c${i}_value`], points[`c${i}_opacity`]]; }

  function bars() {
    if (!histogram) return drawn("g");
    const { edges, heights } = histogram, part = drawn("g", { class: "histogram" });
    heights.forEach((height, i) => {
      const from = Math.max(low, edges[i]), to = Math.min(high, edges[i + 1]);
      if (to > from && height > 0) part.append(drawn("rect", { x: x(from), width: Math.max(0.5, x(to) - x(from)), y: y(height * 0.95), height: y(0) - y(height * 0.95) }));
    });
    return part;
  }

  function boundsOf(i) { return [parameters[`c${i}_value`], parameters[`c${i}_opacity`]]; }

  function allowed(i) {
    const [value, opacity] = boundsOf(i), left = x(value.low), top = y(Math.min(1, opacity.high));
    return drawn("rect", { class: "allowed", x: left, y: top, width: x(value.high) - left, height: y(Math.max(0, opacity.low)) - top });
  }

  function handle(i) {
    const made = drawn("circle", { class: "handle", r: 7, tabindex: 0, role: "slider", "aria-valuemin": 0, "aria-valuemax": 1 });
    made.onpointerdown = event => { made.setPointerCapture(event.pointerId); event.preventDefault(); made.focus(); };
    made.onpointermove = event => {
      if (!made.hasPointerCapture(event.pointerId)) return;
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      place(i, low + (at.x - PAD) / (WIDTH - 2 * PAD) * (high - low), (HEIGHT - PAD - at.y) / (HEIGHT - 2 * PAD));
    };
    made.onkeydown = event => {
      const [right, up] = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [0, 0];
      if (!right && !up) return;
      event.preventDefault();
      const [value, opacity] = boundsOf(i), [v, o] = valueOf(i);
      place(i, v + right * (value.high - value.low) / 40, o + up * (opacity.high - opacity.low) / 40);
    };
    return made;
  }

  /** Move point i to a value and an opacity, within its bounds and on its side of the other point. */
  function place(i, value, opacity) {
    const [v, o] = [value, opacity].map((to, k) => tidy(Math.max(boundsOf(i)[k].low, Math.min(boundsOf(i)[k].high, to)), boundsOf(i)[k]));
    const limit = besides(i);
    change({ ...points, [`c${i}_value`]: Math.max(limit.least, Math.min(limit.most, v)), [`c${i}_opacity`]: o });
  }

  /** From where to where point i can go without crossing the other one. */
  function besides(i) {
    const { least, most } = boundsOf(i)[0], gap = APART * (high - low), other = valueOf(3 - i)[0];
    return i === 1 ? { least, most: Math.min(most, other - gap) } : { least: Math.max(least, other + gap), most };
  }

  function numberFor(p) {
    const i = Number(p.name[1]), value = p.name.endsWith("value"), title = `c${i} ${value ? "value" : "opacity"}`;
    const number = numberInput(title, () => value ? besides(i) : p, to => change({ ...points, [p.name]: to }));
    const unit = value && p.unit ? ` (${p.unit})` : "";
    return { label: element("label", {}, element("span", {}, title + unit), number.input), number, p };
  }

  function change(moving) {
    set(moving);
    moved(points);
  }

  function paintColors(name) {
    const stops = of.color_maps.find(map => map.name === name)?.gradient ?? of.gradient;
    gradient.style.background = `linear-gradient(to right, ${stops})`;
  }

  function set(given, colorMap) {
    points = { ...given };
    const corners = [base[0], valueOf(1), valueOf(2), base[3]].map(([v, o]) => `${x(v)},${y(o)}`);
    line.setAttribute("points", corners.join(" "));
    area.setAttribute("points", [...corners, `${x(high)},${y(0)}`, `${x(low)},${y(0)}`].join(" "));
    handles.forEach((made, k) => {
      const [v, o] = valueOf(k + 1);
      made.setAttribute("cx", x(v));
      made.setAttribute("cy", y(o));
      made.setAttribute("aria-valuenow", o.toFixed(3));
      made.setAttribute("aria-valuetext", `value ${digits(v)}, opacity ${digits(o)}`);
      made.setAttribute("aria-label", `Control point c${k + 1}`);
    });
    for (const { number, p } of inputs) number.set(points[p.name]);
    warning.hidden = !of.points.some(p => extrapolation(p, points[p.name]));
    if (colorMap === undefined) return;
    if (colors.length) box.querySelector("#color-map").value = colorMap;
    paintColors(colorMap);
  }

  return { box, set };
}
