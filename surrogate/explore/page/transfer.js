// The transfer-function editor: opacity over field values, two points of which can be moved; the histogram of the field behind.

import { button, digits, drawn, element, menu } from "./elements.js";
import { POINTS } from "./state.js";

const WIDTH = 280, HEIGHT = 150, PAD = 8;
const APART = 1e-3; // of the range of values: how near to each other control points may come

/**
 * `of` is the variation's facts: bounds by name, opacity_points, gradient, color_maps.  `moved(points)` hears displacements,
 * `colored(name)` a colour map.  Returns { box, set(points, colorMap) }.
 */
export function transferEditor(of, histogram, unit, moved, colored) {
  const base = of.opacity_points, low = base[0][0], high = base[3][0];
  const x = value => PAD + (WIDTH - 2 * PAD) * (value - low) / (high - low);
  const y = opacity => HEIGHT - PAD - (HEIGHT - 2 * PAD) * opacity;
  let points = Object.fromEntries(POINTS.map(name => [name, 0]));

  const line = drawn("polyline", { class: "function" }), area = drawn("polygon", { class: "area" });
  const ghost = drawn("polyline", { class: "ghost", points: base.map(([v, o]) => `${x(v)},${y(o)}`).join(" ") });
  const ends = [base[0], base[3]].map(([v, o]) => drawn("circle", { class: "end", cx: x(v), cy: y(o), r: 3.5 }));
  const handles = [1, 2].map(handle);
  const svg = drawn(
    "svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "transfer", role: "group", "aria-label": "Opacity over field values" },
    bars(), ...[1, 2].map(allowed), area, ghost, line, ...ends, ...handles,
  );
  const gradient = element("div", { class: "gradient", "aria-hidden": "true" });
  const scale = element("div", { class: "scale" }, element("span", {}, digits(low)), element("span", {}, unit ? `value (${unit})` : "field value"), element("span", {}, digits(high)));
  const inputs = POINTS.map(numberFor);
  const colors = of.color_maps.length ? [
    menu("Colours", "color-map", "", [["", "as trained"], ...of.color_maps.map(({ name }) => [name, name])], name => { paintColors(name); colored(name); }),
    element("p", { class: "hint" }, "Other colours than the trained ones are computed from learnt field values: good, not exact."),
  ] : [];
  const reset = button("Reset to base", () => change(Object.fromEntries(POINTS.map(name => [name, 0]))));
  const box = element("div", {}, svg, gradient, scale, ...colors, element("div", { class: "numbers" }, ...inputs.map(input => input.label)), reset);

  function valueOf(i) { return [base[i][0] + points[`c${i}_value`], base[i][1] + points[`c${i}_opacity`]]; }

  function bars() {
    if (!histogram) return drawn("g");
    const { edges, heights } = histogram, part = drawn("g", { class: "histogram" });
    heights.forEach((height, i) => {
      const from = Math.max(low, edges[i]), to = Math.min(high, edges[i + 1]);
      if (to > from && height > 0) part.append(drawn("rect", { x: x(from), width: Math.max(0.5, x(to) - x(from)), y: y(height * 0.95), height: y(0) - y(height * 0.95) }));
    });
    return part;
  }

  function boundsOf(i) { return [of.bounds[`c${i}_value`], of.bounds[`c${i}_opacity`]]; }

  function allowed(i) {
    const [v, o] = base[i], [value, opacity] = boundsOf(i);
    const left = x(v + value.low), top = y(Math.min(1, o + opacity.high));
    return drawn("rect", { class: "allowed", x: left, y: top, width: x(v + value.high) - left, height: y(Math.max(0, o + opacity.low)) - top });
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
    const [v, o] = [value - base[i][0], opacity - base[i][1]].map((moved, k) => Math.max(boundsOf(i)[k].low, Math.min(boundsOf(i)[k].high, moved)));
    const gap = APART * (high - low), limit = valueOf(3 - i)[0] - base[i][0];
    change({ ...points, [`c${i}_value`]: i === 1 ? Math.min(v, limit - gap) : Math.max(v, limit + gap), [`c${i}_opacity`]: o });
  }

  function numberFor(name) {
    const i = Number(name[1]), axis = name.endsWith("value") ? 0 : 1;
    const input = element("input", {
      type: "number", step: "any",
      onchange: event => {
        const at = valueOf(i);
        if (event.target.value !== "" && Number.isFinite(+event.target.value)) at[axis] = +event.target.value;
        place(i, ...at);
      },
    });
    const label = element("label", {}, element("span", {}, `c${i} ${axis ? "opacity" : "value"}`), input);
    return { label, input, i, axis };
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
    for (const { input, i, axis } of inputs) if (document.activeElement !== input) input.value = +valueOf(i)[axis].toPrecision(5);
    if (colorMap === undefined) return;
    if (colors.length) box.querySelector("#color-map").value = colorMap;
    paintColors(colorMap);
  }

  return { box, set };
}
