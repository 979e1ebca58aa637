// A slider for one number: name, unit, bounds, what was trained marked below the track, and a warning outside the bounds.

import { digitsOf, element } from "../web/elements.js";
import { numberInput } from "./numbers.js";
import { player } from "./play.js";
import { tidy } from "./state.js";
import { extrapolation } from "./words.js";

const MARGIN = 0.12; // how far a slider goes beyond the bounds, in widths; numbers that are typed may go farther

/**
 * `parameter` is { name, label, unit, scale, low, high, least, most, train, validation }.  `moved(value)` hears every change.
 * Returns { box, set(value) }.
 */
export function slider(parameter, id, moved) {
  const { name: title, low, high, unit, least, most } = parameter, logarithmic = parameter.scale === "log";
  const on = logarithmic ? Math.log10 : x => x, off = logarithmic ? x => 10 ** x : x => x; // to the track, and back
  const width = on(high) - on(low), from = Math.max(on(least), on(low) - MARGIN * width), to = Math.min(on(most), on(high) + MARGIN * width);
  const range = element("input", { type: "range", id, min: from, max: to, step: "any", oninput: event => slide(+event.target.value) });
  const number = numberInput(title, () => ({ least, most }), value => change(value), { class: "exact", "aria-label": `${title}, exact value` });
  const playing = player(title, () => (on(current) - on(low)) / width, share => slide(on(low) + share * width));
  const warning = element("p", { class: "warning outside", hidden: true }, "");
  const track = element("div", { class: "track" }, ticks(), zone(0, place(low)), zone(place(high), 1), range);
  const name = element("label", { for: id }, title, element("span", { class: "unit" }, words()));
  const box = element("div", { class: "parameter" }, element("div", { class: "line" }, name, playing.box, number.input), number.note, track, warning);
  let current = NaN;
  range.onpointerdown = number.input.onfocus = playing.stop;
  range.onkeydown = event => {
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10, Home: -Infinity, End: Infinity }[event.key];
    if (!steps) return;
    event.preventDefault();
    slide(on(current) + steps * width / 100);
  };

  function words() {
    const bounds = [digitsOf(parameter, low), "…", digitsOf(parameter, high), !parameter.label && unit, logarithmic && "logarithmic"];
    return `${parameter.label ? ` of ${parameter.label}` : ""} ${bounds.filter(Boolean).join(" ")}`;
  }
  function place(value) { return (on(value) - from) / (to - from); }
  function zone(start, end) { return element("i", { class: "beyond", style: `left:${100 * start}%;width:${100 * (end - start)}%` }); }

  function ticks() {
    const made = element("div", { class: "marks", "aria-hidden": "true" });
    for (const split of ["train", "validation"])
      for (const value of parameter[split] ?? []) made.append(element("i", { class: split, style: `left:${100 * place(value)}%` }));
    return made;
  }

  function slide(position) {
    const value = tidy(off(Math.max(from, Math.min(to, position))), parameter);
    change(Math.max(least, Math.min(most, value)));
  }

  function change(value) {
    set(value);
    moved(value);
  }

  function set(value) {
    number.set(value);
    if (value === current) return;
    current = value;
    range.value = on(value);
    warning.textContent = extrapolation(parameter, value);
    warning.hidden = !warning.textContent;
    range.setAttribute("aria-valuetext", `${digitsOf(parameter, value)}${unit ? ` ${unit}` : ""}${warning.hidden ? "" : ", outside the training range"}`);
    box.classList.toggle("is-outside", !warning.hidden);
  }

  return { box, set };
}
