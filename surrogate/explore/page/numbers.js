// An input for one number.  What is typed and can be drawn is drawn; of anything else the input says why not, and goes back.

import { digits, element } from "../web/elements.js";

const WIDE = 9; // letters that an input shows

/** A number as an input shows it: whole where it fits, else with as many digits as do. */
export function fitting(value) {
  for (let places = 17; places > 1; --places) {
    const text = String(+value.toPrecision(places));
    if (text.length <= WIDE) return text;
  }
  return String(+value.toPrecision(1));
}

/**
 * `range()` is { least, most } now; `changed(value)` hears what is accepted; `attributes` are the input's.
 * Returns { input, note, set(value) }: `note` is the element that says what was refused.
 */
export function numberInput(title, range, changed, attributes = {}) {
  const note = element("p", { class: "refused", role: "alert", hidden: true });
  let now = NaN;
  const input = element("input", {
    type: "number", step: "any", ...attributes,
    oninput: () => show(""),
    onchange: () => {
      const { least, most } = range(), text = input.value, value = text === fitting(now) ? now : Number(text);
      const proper = text.trim() !== "" && Number.isFinite(value);
      if (proper && least <= value && value <= most) {
        show("");
        changed(value);
        return;
      }
      show(`${proper ? digits(value) : "That"} ${proper ? "can't be drawn" : "is not a number"}: ${title} goes from ${digits(least, most - least)} to ${digits(most, most - least)}, and stays ${digits(now, most - least)}.`);
      input.value = fitting(now);
    },
  });

  function show(text) {
    note.textContent = text;
    note.hidden = !text;
    input.setAttribute("aria-invalid", Boolean(text));
  }

  function set(value) {
    if (value === now && input.value === fitting(value)) return;
    now = value;
    input.value = fitting(value);
    input.title = value;
    show("");
  }

  return { input, note, set };
}
