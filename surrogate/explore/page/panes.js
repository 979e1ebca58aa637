// What the stage shows: one picture, two and their difference, the truth beside the prediction, or a sweep.

import { button, drawn, element } from "../web/elements.js";
import { current, endsOf, messageOf, mostRows, rangeOf, sweptOf, withValue } from "./state.js";
import { described, valued } from "./words.js";

const MOST_LETTERS = 60; // of a caption
const WIDE = 1.35; // width of a usual stage in heights

/** A picture with words on it: its name, what it shows, and what error to expect. */
function pane(label) {
  const canvas = element("canvas", { role: "img", "aria-label": label });
  const marks = drawn("svg", { class: "annotations" });
  const name = element("strong", {}, label), words = element("span", { class: "shown" }), expected = element("span", { class: "expected" });
  const caption = element("figcaption", {}, name, " ", words, expected);
  const open = act => { caption.append(button("Open", act, { class: "open", "aria-label": `Explore ${label}`, title: "Explore this setting" })); };
  return { canvas, name, words, expected, open, marks, box: element("figure", { class: "pane" }, canvas, marks, caption) };
}

/** Values of a sweep over one parameter. */
export function valuesOf({ low, high }, count, scale) {
  const share = i => i / Math.max(1, count - 1);
  return Array.from({ length: count }, (_, i) =>
    i === 0 ? low : i === count - 1 ? high : scale === "log" ? low * (high / low) ** share(i) : low + (high - low) * share(i));
}

/** The cells of the sweep: { setting, label }, row by row, how many columns they have, and the heads of columns and rows of a grid. */
export function cellsOf(state, facts) {
  const setting = current(state), { sweep } = state, { first, second } = sweptOf(state, facts);
  const columns = valuesOf(rangeOf(endsOf(sweep, false), first), sweep.count, first.scale);
  const rows = second ? valuesOf(rangeOf(endsOf(sweep, true), second), Math.min(sweep.secondCount, mostRows(columns.length)), second.scale) : [null];
  const cells = rows.flatMap(row => columns.map(value => ({
    setting: row === null ? withValue(setting, first.name, value) : withValue(withValue(setting, first.name, value), second.name, row),
    label: [valued(first, value), row === null ? "" : valued(second, row)].filter(Boolean).join(", "),
  })));
  // One parameter alone is broken into rows, so that the pictures are about square on a wide screen.
  const wide = second ? columns.length : Math.min(columns.length, Math.round(Math.sqrt(WIDE * columns.length)));
  const heads = second && { columns: columns.map(value => valued(first, value)), rows: rows.map(value => valued(second, value)) };
  return { cells, columns: wide, heads };
}

/** The divider of two pictures that lie one under the other. */
function swipe(stage) {
  const divide = share => stage.style.setProperty("--swipe", `${share}%`);
  divide(50);
  return element("input", {
    type: "range", id: "swipe", min: 0, max: 100, step: "any", value: 50, "aria-label": "Divider between the two pictures",
    oninput: event => divide(event.target.value), onkeydown: event => event.stopPropagation(),
  });
}

/** What is different in settings, in words. */
function differences(settings, facts) {
  const words = settings.map(setting => described(setting, facts).split(", "));
  return words.map(own => own.filter(word => !words.every(other => other.includes(word))).join(", "));
}

/** Settings in words, of long ones what is different alone: captions lie over pictures. */
function briefly(settings, facts) {
  const words = settings.map(setting => described(setting, facts));
  return words.some(word => word.length > MOST_LETTERS) ? differences(settings, facts) : words;
}

/**
 * What the stage holds for a state: { kind, labels, words, columns, settings, heads, difference, truth, isSwipe }; `cells` are the settings of a
 * sweep, `shown` those of a comparison.
 */
export function plan(state, facts) {
  const shown = current(state);
  if (state.mode === "sweep") {
    const { cells, columns, heads } = cellsOf(state, facts), settings = cells.map(cell => cell.setting);
    return { kind: "sweep", labels: cells.map(cell => cell.label), words: [], columns, heads, cells: settings, settings: settings.map(setting => messageOf(setting, facts)) };
  }
  const isSwipe = state.layout === "swipe";
  if (state.mode === "compare" && state.against === "truth")
    return { kind: "truth", labels: ["prediction", "stored", "difference"], words: [described(shown, facts), null], columns: 3, settings: [messageOf(shown, facts)], truth: true, isSwipe };
  if (state.mode === "compare" && state.against === "three")
    return { kind: "four", labels: ["A", "B", "C", "D"], words: differences(state.settings, facts), columns: 2, shown: state.settings, settings: state.settings.map(setting => messageOf(setting, facts)) };
  if (state.mode === "compare") {
    const pair = state.settings.slice(0, 2), words = briefly(pair, facts);
    return { kind: "compare", labels: ["A", "B", "difference"], words, columns: 3, shown: pair, settings: pair.map(setting => messageOf(setting, facts)), difference: true, isSwipe };
  }
  return { kind: "view", labels: [""], words: [], columns: 1, settings: [messageOf(shown, facts)] };
}

/** Fill the stage with panes for a plan; returns them. */
export function build(stage, planned) {
  const panes = planned.labels.map(pane);
  stage.dataset.kind = planned.kind;
  stage.style.setProperty("--columns", planned.columns);
  const boxes = panes.map(p => p.box), { heads, columns } = planned;
  stage.classList.toggle("has-heads", Boolean(heads));
  stage.classList.toggle("is-swipe", Boolean(planned.isSwipe));
  if (planned.isSwipe) boxes.push(swipe(stage));
  if (!heads) {
    stage.replaceChildren(...boxes);
    return panes;
  }
  const head = (kind, label) => element("p", { class: `head ${kind}` }, label);
  stage.replaceChildren(element("span"), ...heads.columns.map(label => head("column", label)),
    ...heads.rows.flatMap((label, row) => [head("row", label), ...boxes.slice(row * columns, (row + 1) * columns)]));
  return panes;
}
