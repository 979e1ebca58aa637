// Groups of controls that fold, and stay folded in later visits.

import { element } from "../web/elements.js";
import { recalled, remember } from "./memory.js";

const FOLDED = ["Predictions", "Clip and slice", "Snapshots", "View", "Display", "Model"]; // at first

/** A section of the controls, named and foldable. */
export function group(title, ...children) {
  const isOpen = recalled(`group ${title}`, FOLDED.includes(title) ? "folded" : "open") === "open";
  const box = element("details", { class: "group", open: isOpen }, element("summary", {}, element("h2", {}, title)), ...children);
  box.ontoggle = () => remember(`group ${title}`, box.open ? "open" : "folded");
  return element("section", { "aria-label": title }, box);
}
