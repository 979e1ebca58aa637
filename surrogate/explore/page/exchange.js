// A transfer function as JSON, to copy and to paste: as catalogs have it, and as ParaView's presets.

import { button, element } from "../web/elements.js";
import { ofText, paraviewOf, textOf } from "./functions.js";

/** `get()` is { made, colors } as shown, `set(made)` takes another function; `explorer` copies and says things. */
export function exchange(of, get, set, explorer) {
  const text = element("textarea", { id: "function-json", rows: 3, "aria-label": "A transfer function as JSON, ours or ParaView's", spellcheck: "false" });
  const note = element("p", { class: "refused", role: "alert", hidden: true });
  const copy = (title, write) => button(title, () => {
    const { made, colors } = get();
    text.value = write(made, colors);
    return explorer.copy(text.value, "transfer function");
  });
  const say = words => {
    note.textContent = words;
    note.hidden = !words;
  };
  function apply() {
    try {
      const { made, notes } = ofText(text.value, get().made, of);
      say(notes.length ? `Taken over; ${notes.join("; ")}.` : "");
      set(made);
    } catch (error) {
      say(error.message);
    }
  }
  return element("details", { class: "exchange" }, element("summary", {}, "Copy and paste"), text, note, element("div", { class: "buttons" },
    button("Apply", apply, { id: "apply-function" }), copy("Copy", (made, colors) => textOf(made, colors, of)), copy("Copy for ParaView", (made, colors) => paraviewOf(made, colors, explorer.facts.title))));
}
