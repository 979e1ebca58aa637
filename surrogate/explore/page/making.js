// A file in the making: how far it is, and a way to end it.  One at a time; the panels may be built anew meanwhile.

import { button, element } from "../web/elements.js";
import { exported } from "./connection.js";

export class Making {
  /** `say(sentence)` hears how it ends. */
  constructor(say) {
    this.say = say;
    this.buttons = new Map(); // the newest that begin to make files, by their ids
    this.bar = element("progress", { max: 1, "aria-label": "Export" });
    this.words = element("span", { class: "hint" });
    this.box = element("div", { id: "making", hidden: true }, this.bar, this.words, button("Cancel", () => this.ending.abort(), { id: "cancel-export" }));
  }

  /** A button that makes and saves what `request()` asks for, where `isReady()`. */
  button(label, id, request, isReady = () => true) {
    const made = button(label, () => this.make(request()), { id, class: id === "export" && "primary" });
    this.buttons.set(id, { made, isReady });
    this.enable();
    return made;
  }

  async make(request) {
    this.ending = new AbortController();
    const { signal } = this.ending;
    this.enable();
    this.bar.removeAttribute("value");
    this.words.textContent = "Making it…";
    try {
      const { name, blob } = await exported(request, { signal, count: (done, total) => this.count(done, total) });
      saveFile({ name, blob });
      this.say(`${name}: ${(blob.size / 1024).toFixed(0)} kB`);
    } catch (error) {
      this.say(signal.aborted ? "Nothing was saved." : error.message);
    } finally {
      this.ending = null;
      this.enable();
    }
  }

  /** Let a file be made where none is. */
  enable() {
    this.box.hidden = !this.ending;
    for (const { made, isReady } of this.buttons.values()) made.disabled = Boolean(this.ending) || !isReady();
  }

  count(done, total) {
    this.bar.value = done / total;
    this.words.textContent = `${done} of ${total}`;
  }
}

/** Let the browser save a file. */
export function saveFile({ name, blob }) {
  const address = URL.createObjectURL(blob), anchor = element("a", { href: address, download: name });
  document.body.append(anchor);
  anchor.click();
  anchor.remove();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}
