// A slider for one number: name, unit, bounds, what was trained marked below the track, and a warning outside the bounds.

import { digits, element } from "./elements.js";

const MARGIN = 0.12; // how far a slider goes beyond the bounds, in widths

/**
 * `parameter` is { name, unit, low, high, train, validation }.  `moved(value)` hears every change.
 * Returns { box, set(value) }.
 */
export function slider(parameter, id, moved) {
  const { name: title, low, high, unit } = parameter, width = high - low;
  const least = low - MARGIN * width, most = high + MARGIN * width;
  const range = element("input", { type: "range", id, min: least, max: most, step: "any", oninput: event => change(+event.target.value) });
  const number = element("input", {
    type: "number", step: "any", class: "exact", "aria-label": `${title}, exact value`,
    onchange: event => event.target.value === "" || !Number.isFinite(+event.target.value) ? set(current) : change(clamp(+event.target.value)),
  });
  const warning = element("p", { class: "warning outside", hidden: true }, "");
  const track = element("div", { class: "track" }, zone(0, place(low)), zone(place(high), 1), range);
  const name = element("label", { for: id }, title, unit ? element("span", { class: "unit" }, ` (${unit})`) : null);
  const ends = element("div", { class: "ends", "aria-hidden": "true" }, mark(low), mark(high));
  const box = element("div", { class: "parameter" }, element("div", { class: "line" }, name, number), track, ticks(), ends, warning);
  let current = NaN;
  range.onkeydown = event => {
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!steps) return;
    event.preventDefault();
    change(Math.max(least, Math.min(most, current + steps * width / 100)));
  };

  function place(value) { return (value - least) / (most - least); }
  function clamp(value) { return Math.max(low - 0.9 * width, Math.min(high + 0.9 * width, value)); }
  function zone(from, to) { return element("i", { class: "beyond", style: `left:${100 * from}%;width:${100 * (to - from)}%` }); }
  function mark(value) { return element("span", { style: `left:${100 * place(value)}%` }, digits(value)); }

  function ticks() {
    const made = element("div", { class: "marks", "aria-hidden": "true" });
    for (const split of ["train", "validation"])
      for (const value of parameter[split] ?? []) made.append(element("i", { class: split, style: `left:${100 * place(value)}%` }));
    return made;
  }

  function change(value) {
    set(value);
    moved(value);
  }

  function set(value) {
    current = value;
    range.value = value;
    if (document.activeElement !== number || +number.value !== value) number.value = +value.toPrecision(6);
    const outside = value < low - 1e-9 * width || value > high + 1e-9 * width;
    range.setAttribute("aria-valuetext", `${digits(value)}${unit ? ` ${unit}` : ""}${outside ? ", outside what was trained" : ""}`);
    box.classList.toggle("is-outside", outside);
    warning.hidden = !outside;
    warning.textContent = outside ? `Outside ${digits(low)} to ${digits(high)}: a guess.` : "";
  }

  return { box, set };
}
