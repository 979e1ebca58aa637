// What the stage shows: one picture, two and their difference, the truth beside the prediction, or a sweep.

import { digits, element } from "./elements.js";
import { messageOf, rangeOf, sweepable, withValue } from "./state.js";

const WIDE = 1.35; // width of a usual stage in heights
const CELLS = 60; // pictures of a sweep at most

/** A picture with words below it. */
function pane(label) {
  const canvas = element("canvas", { role: "img", "aria-label": label });
  const words = element("figcaption", {}, label);
  return { canvas, words, box: element("figure", { class: "pane" }, canvas, words) };
}

/** Values of a sweep over one parameter. */
export function valuesOf({ low, high }, count) {
  return Array.from({ length: count }, (_, i) => low + (high - low) * i / Math.max(1, count - 1));
}

/** The cells of the sweep: { setting, label }, row by row, and how many columns they have. */
export function cellsOf(state, facts) {
  const setting = state.settings[0], known = sweepable(facts, setting);
  const first = known.find(p => p.name === state.sweep.name) ?? known[0];
  const second = known.find(p => p.name === state.sweep.second && p !== first);
  const columns = valuesOf(rangeOf(state.sweep, first), state.sweep.count);
  const rows = second ? valuesOf(second, Math.max(2, Math.min(state.sweep.secondCount, Math.floor(CELLS / columns.length)))) : [null];
  const cells = rows.flatMap(row => columns.map(value => ({
    setting: row === null ? withValue(setting, first.name, value) : withValue(withValue(setting, first.name, value), second.name, row),
    label: [label(first, value), row === null ? "" : label(second, row)].filter(Boolean).join(", "),
  })));
  // One parameter alone is broken into rows, so that the pictures are about square on a wide screen.
  const wide = second ? columns.length : Math.min(columns.length, Math.round(Math.sqrt(WIDE * columns.length)));
  return { cells, columns: wide, first, second };
}

const label = (p, value) => `${p.name} ${digits(+value.toPrecision(4))}${p.unit ? ` ${p.unit}` : ""}`;

/** What the stage holds for a state: { kind, labels, columns, settings, difference, truth }. */
export function plan(state, facts) {
  if (state.mode === "sweep") {
    const { cells, columns } = cellsOf(state, facts);
    return { kind: "sweep", labels: cells.map(cell => cell.label), columns, settings: cells.map(cell => messageOf(cell.setting)) };
  }
  if (state.mode === "compare" && state.against === "truth")
    return { kind: "truth", labels: ["prediction", "truth", "difference"], columns: 3, settings: [messageOf(state.settings[state.active])], truth: true };
  if (state.mode === "compare")
    return { kind: "compare", labels: ["A", "B", "difference"], columns: 3, settings: state.settings.map(messageOf), difference: true };
  return { kind: "view", labels: [""], columns: 1, settings: [messageOf(state.settings[state.active])] };
}

/** Fill the stage with panes for a plan; returns them. */
export function build(stage, planned) {
  const panes = planned.labels.map(pane);
  stage.dataset.kind = planned.kind;
  stage.style.setProperty("--columns", planned.columns);
  stage.replaceChildren(...panes.map(p => p.box));
  return panes;
}
