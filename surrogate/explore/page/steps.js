// What was done, step by step: each is an entry of the browser's history, so that Back and Forward undo and redo.

import { button, element } from "../web/elements.js";

export class Steps {
  constructor() {
    // Entries of a frame would come between those of the page around it.
    this.alone = window === window.parent;
    this.undo = button("↶", () => history.back(), { id: "undo", title: "Undo (Ctrl+Z)", "aria-label": "Undo" });
    this.redo = button("↷", () => history.forward(), { id: "redo", title: "Redo (Ctrl+Shift+Z)", "aria-label": "Redo" });
    this.box = element("div", { class: "steps", role: "group", "aria-label": "Steps", hidden: !this.alone }, this.undo, this.redo);
    this.last = this.place;
    window.addEventListener("popstate", () => this.show());
    window.addEventListener("keydown", event => this.press(event));
    this.show();
  }

  /** How many steps were made before what is shown. */
  get place() { return history.state?.place ?? 0; }

  /** The next step: what is shown has another address, "#...". */
  add(address) {
    if (!this.alone) {
      this.replace(address);
      return;
    }
    this.last = this.place + 1;
    history.pushState({ place: this.last }, "", addressed(address));
    this.show();
  }

  /** The same step, whose address has changed. */
  replace(address) {
    if (location.protocol === "about:") return; // the contents of a notebook's cell have no address
    history.replaceState({ place: this.place }, "", addressed(address));
  }

  press(event) {
    const typing = event.target.closest?.("input:not([type=range]), textarea");
    if (!this.alone || typing || !(event.ctrlKey || event.metaKey) || event.altKey || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    const wanted = event.shiftKey ? this.redo : this.undo;
    if (!wanted.disabled) wanted.click();
  }

  show() {
    this.undo.disabled = this.place === 0;
    this.redo.disabled = this.place >= this.last;
  }
}

const addressed = address => `${location.pathname}${location.search}${address}`;
