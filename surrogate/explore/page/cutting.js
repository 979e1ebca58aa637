// Controls that cut the field: the ends of a box along each axis, and a slice.

import { button, element, menu } from "../web/elements.js";
import { AXES, canCut, clipOf, isEmpty } from "./cuts.js";
import { group } from "./groups.js";
import { numberInput } from "./numbers.js";
import { slider } from "./sliders.js";
import { current, tidy } from "./state.js";

const STEPS = 100; // of a hand's keys, from end to end
const ENDS = ["from", "to"];

/** The panel: { box, set(setting) }; null where nothing can be cut. */
export function cutPanel(explorer) {
  const { facts } = explorer, setting = () => current(explorer.state), [low, high] = facts.box;
  if (!canCut(facts)) return null;
  const change = values => {
    Object.assign(setting(), values);
    set(setting());
    explorer.changed();
  };
  const rows = [0, 1, 2].map(k => ends(AXES[k], low[k], high[k], (end, value) => {
    const corners = setting().clip ?? facts.box.flat();
    change({ clip: clipOf(corners.map((x, i) => i === k + 3 * end ? value : x), facts.box) });
  }));
  const reset = button("Reset box", () => change({ clip: null }), { id: "reset-clip" });
  const middle = k => tidy((low[k] + high[k]) / 2, { low: low[k], high: high[k] });
  const chosen = menu("Slice", "slice-axis", "", [["", "none"], ...[...AXES].map(axis => [axis, `across ${axis}`])], axis =>
    change({ slice: axis ? [axis, middle(AXES.indexOf(axis))] : null }));
  const places = [0, 1, 2].map(k => slider({ name: AXES[k], low: low[k], high: high[k], least: low[k], most: high[k] }, `slice-${AXES[k]}`, place => change({ slice: [AXES[k], place] })));
  const why = element("p", { class: "hint" });
  const box = group("Clip and slice", ...rows.map(row => row.box), element("div", { class: "buttons" }, reset), chosen, ...places.map(one => one.box), why);

  function set(now) {
    const { clip, slice, kind } = now;
    rows.forEach((row, k) => row.set(clip?.[k] ?? low[k], clip?.[3 + k] ?? high[k]));
    reset.disabled = !clip;
    chosen.querySelector("select").value = slice?.[0] ?? "";
    places.forEach((one, k) => {
      one.box.hidden = slice?.[0] !== AXES[k];
      if (!one.box.hidden) one.set(slice[1]);
    });
    why.classList.toggle("warning", isEmpty(now, facts.box));
    why.textContent = isEmpty(now, facts.box) ? "Nothing is left to draw: widen the box, or move the slice into it." : slice && kind === "isovalue" ? "A surface is not sliced: a slice has the colours of the volume."
      : clip || slice ? "Drawn from the emulated field, which alone can be cut exactly." : "";
  }
  set(setting());
  return { box, set };
}

/** Two hands on one track, and two numbers: { box, set(from, to) }; `changed(end, value)` hears which end, 0 or 1. */
function ends(axis, low, high, changed) {
  const now = [low, high], id = end => `clip-${axis}-${ENDS[end]}`;
  const limits = end => end ? { least: now[0], most: high } : { least: low, most: now[1] };
  const move = (end, value) => {
    const { least, most } = limits(end), near = tidy(value, { low, high }), at = value >= high ? high : value <= low ? low : near;
    now[end] = Math.max(least, Math.min(most, at));
    set(...now);
    changed(end, now[end]);
  };
  const hands = ENDS.map((words, end) => element("input", {
    type: "range", id: id(end), min: low, max: high, step: "any", "aria-label": `Clip ${axis} ${words}`, oninput: event => move(end, +event.target.value),
    onkeydown: event => {
      const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10, Home: -Infinity, End: Infinity }[event.key];
      if (!steps) return;
      event.preventDefault();
      move(end, Math.max(low, Math.min(high, now[end] + steps * (high - low) / STEPS)));
    },
  }));
  const numbers = ENDS.map((words, end) => numberInput(axis, () => limits(end), value => move(end, value), { class: "exact", "aria-label": `Clip ${axis} ${words}, exact value` }));
  const between = element("i", { class: "between", "aria-hidden": "true" });
  const box = element("div", { class: "parameter" },
    element("div", { class: "line" }, element("span", {}, axis), ...numbers.map(one => one.input)), ...numbers.map(one => one.note), element("div", { class: "hands" }, between, ...hands));

  function set(...values) {
    values.forEach((value, end) => {
      now[end] = value;
      hands[end].value = value;
      numbers[end].set(value);
    });
    const [start, stop] = now.map(value => 100 * Math.max(0, Math.min(1, (value - low) / (high - low))));
    between.style.left = `${start}%`;
    between.style.width = `${stop - start}%`;
    hands[0].classList.toggle("is-above", start > 50); // so that both can be taken where they meet
  }
  return { box, set };
}
