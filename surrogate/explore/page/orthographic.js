// The switch to lines that stay parallel, as nearly as a camera far away sees them: the smallest field of view.

import { button } from "../web/elements.js";
import { widened } from "./orbit.js";

const LEAST = 1; // degrees that a camera sees

/** A button that is pressed while the field of view is the smallest: { box, set(orbit), turn() }. */
export function orthographicSwitch(explorer) {
  const home = explorer.facts.camera, isOn = ({ field }) => field <= LEAST;
  let before = home.field > LEAST ? home.field : 30;
  const turn = () => {
    const { orbit } = explorer.state;
    explorer.look(widened(orbit, isOn(orbit) ? before : LEAST, home));
  };
  const box = button("Orthographic", turn, { id: "orthographic", "aria-pressed": false, title: "Parallel lines stay parallel (o)" });
  const set = orbit => {
    if (!isOn(orbit)) before = orbit.field;
    box.setAttribute("aria-pressed", isOn(orbit));
  };
  return { box, set, turn };
}
