// The bar over the stage: view modes, steps, light and dark, the whole screen, folded panels, and the list of keys.

import { button, element } from "../web/elements.js";
import { recalled, remember } from "./memory.js";
import { followTheme } from "./theme.js";

const KEYS = [
  ["Arrows", "turn the picture"], ["Shift + arrows", "move it"], ["+ and −", "come nearer, go farther"], ["Home", "the first view"],
  ["Ctrl + Z, Ctrl + Shift + Z", "undo, redo"], ["o", "orthographic, and back"], ["p", "fold all panels, and back"], ["f", "the whole screen, and back"], ["v", "values under the pointer, and off"], ["Enter", "while these are on: pin the middle of the picture"], ["l", "light or dark"], ["?", "this list"],
  ["Enter, Delete", "at a control point: add one, remove it"], ["Arrows", "at a control point or slider: move it"],
];
export class Room {
  /** `changed(before)` hears that the theme is another one, see `followTheme`. */
  constructor(changed) {
    this.switchTheme = followTheme(changed);
    this.keys = element("dialog", { id: "keys", "aria-labelledby": "keys-title", onclick: event => { if (event.target === this.keys) this.keys.close(); } },
      element("h2", { id: "keys-title" }, "Keys"),
      element("dl", {}, ...KEYS.flatMap(([key, does]) => [element("dt", {}, key), element("dd", {}, does)])),
      button("Close", () => this.keys.close()));
    const tool = (sign, words, act, id) => button(sign, act, { id, "aria-label": words, title: words });
    this.panels = tool("◧", "Panels (p)", () => this.fold(), "toggle-panels");
    this.tools = element("div", { class: "tools", role: "group", "aria-label": "Window" }, this.panels,
      tool("◐", "Light or dark (l)", () => this.switchTheme(), "toggle-theme"), tool("⤢", "Whole screen (f)", () => this.fill(), "toggle-screen"), tool("?", "Keys (?)", () => this.keys.showModal(), "show-keys"));
    window.addEventListener("keydown", event => this.press(event));
    document.body.classList.toggle("is-bare", recalled("panels", "") === "folded");
    this.mark();
  }

  press(event) {
    const typing = event.target.closest?.("input, select, textarea, dialog");
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    const act = { "?": () => this.keys.showModal(), f: () => this.fill(), p: () => this.fold(), l: () => this.switchTheme(), o: () => document.getElementById("orthographic").click() }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  fold() {
    const folded = document.body.classList.toggle("is-bare");
    remember("panels", folded ? "folded" : "open");
    this.mark();
  }

  mark() { this.panels.setAttribute("aria-pressed", !document.body.classList.contains("is-bare")); }

  fill() { return document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen?.().catch(() => {}); }
}
