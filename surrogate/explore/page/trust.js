// How sure the surrogate is of what is shown: its words, the interval, the nearest run, and that run's stored picture.

import { button, element } from "../web/elements.js";
import { group } from "./groups.js";
import { current, shareOf } from "./state.js";
import { shortest, spanOf, valued } from "./words.js";

const KINDS = { "like a run that was simulated": "like", "between runs": "between", "far from all runs": "far", "never shown in training": "never" };
const SIGNS = { like: "✓", between: "~", far: "!", never: "✕" };

export class Trust {
  constructor(explorer) {
    this.explorer = explorer;
    this.sign = element("span", { class: "sign", "aria-hidden": "true" });
    this.expected = element("p", { id: "expected", role: "status", tabindex: 0 });
    this.nearest = element("p", { id: "nearest-run", class: "hint" });
    this.show = button("Show it", () => this.compare(), { id: "show-nearest", class: "plain", title: "Compare with the stored picture that is nearest to this one", hidden: !explorer.facts.truth });
    this.box = group("Trust", element("div", { class: "trust" }, this.sign, element("div", {}, this.expected, this.nearest), this.show));
  }

  /** Say what error to expect of what the panes show: `expected` of each, null while nobody knows; `panes` say their own. */
  say(expected, kind, panes) {
    const { facts } = this.explorer, alone = kind === "view" && expected?.[0];
    this.expected.classList.toggle("warning", Boolean(expected?.some(one => one.warning)));
    this.sign.className = `sign ${alone ? KINDS[alone.words] ?? "" : ""}`;
    this.sign.textContent = alone ? SIGNS[KINDS[alone.words]] ?? "" : "";
    this.show.hidden = !facts.truth || kind !== "view";
    this.nearest.textContent = kind === "view" ? this.nearestRun() : "";
    if (!expected) {
      this.expected.textContent = facts.truth ? "Measuring what to expect here…" : "";
      return;
    }
    const said = kind === "sweep" ? spanOf(expected) : alone ? alone.sentence : "Beside each picture.", [, words, rest] = /^([^:]*:?)(.*)$/.exec(said);
    this.expected.replaceChildren(...alone && rest ? [element("strong", {}, words), rest] : [said]);
    this.expected.title = `${this.expected.textContent}. A higher PSNR is better; from 40 dB on differences are hardly visible.`;
    if (alone) return;
    expected.forEach((one, i) => {
      const label = panes[i].expected;
      label.textContent = kind === "sweep" ? shortest(one) : one.short;
      label.title = one.short;
      label.classList.toggle("warning", one.warning);
    });
  }

  /** While something moves: what was measured at rest is of another picture. */
  clear() { this.expected.textContent = ""; }

  /** The run whose parameters are nearest, as shares of their ranges. */
  nearestRun() {
    const { facts, state } = this.explorer, { parameters } = current(state), trained = facts.members.filter(({ split }) => split !== "test");
    const away = ({ values }) => Math.hypot(...facts.parameters.map((p, i) => shareOf(p, values[i]) - shareOf(p, parameters[p.name])));
    if (!trained.length) return "";
    const nearest = trained.reduce((best, one) => away(one) < away(best) ? one : best);
    return `Nearest run: ${facts.parameters.map((p, i) => valued(p, nearest.values[i])).join(", ")}${nearest.split === "train" ? "" : " (validation)"}`;
  }

  /** The prediction beside the nearest stored picture. */
  async compare() {
    const { explorer } = this;
    await explorer.goToStored(found => explorer.takeStored(found));
    explorer.set({ mode: "compare", against: "truth" });
    explorer.stage.focus();
  }
}
