// How sure the surrogate is of what is shown: its words, the interval, the nearest run, and that run's stored picture.

import { button, element } from "../web/elements.js";
import { group } from "./groups.js";
import { current, shareOf } from "./state.js";
import { shortest, spanOf, valued } from "./words.js";

const KINDS = { "like a run that was simulated": "like", "between runs": "between", "far from all runs": "far", "never shown in training": "never" };
const MOST = 3; // parameters of the nearest run that are said
const SIGNS = { like: "✓", between: "~", far: "!", never: "✕" };

export class Trust {
  constructor(explorer) {
    this.explorer = explorer;
    this.sign = element("span", { class: "sign", "aria-hidden": "true" });
    this.expected = element("p", { id: "expected", role: "status", tabindex: 0 });
    this.nearest = element("p", { id: "nearest-run", class: "hint" });
    this.rest = element("p", { class: "hint" });
    this.others = element("details", { id: "nearest-rest", hidden: true }, element("summary", { class: "hint" }), this.rest);
    this.show = button("Show it", () => this.compare(), { id: "show-nearest", class: "plain", title: "Compare with the stored picture that is nearest to this one", hidden: !explorer.facts.truth });
    this.box = group("Trust", element("div", { class: "trust" }, this.sign, this.expected), element("div", { class: "trust" }, element("div", {}, this.nearest, this.others), this.show));
  }

  /** Say what error to expect of what the panes show: `expected` of each, null while nobody knows; `panes` say their own. */
  say(expected, kind, panes) {
    const { facts } = this.explorer, alone = kind === "view" && expected?.[0];
    this.expected.classList.toggle("warning", Boolean(expected?.some(one => one.warning)));
    this.sign.className = `sign ${alone ? KINDS[alone.words] ?? "" : ""}`;
    this.sign.textContent = alone ? SIGNS[KINDS[alone.words]] ?? "" : "";
    this.show.hidden = !facts.truth || kind !== "view";
    this.sayNearest(kind === "view" ? this.nearestRun() : null);
    this.expected.style.minHeight = "";
    if (!expected) {
      this.expected.textContent = facts.truth ? "Measuring what to expect here…" : "";
      return;
    }
    const said = kind === "sweep" ? spanOf(expected) : alone ? alone.sentence || "Nobody has measured what to expect." : "Beside each picture.", [, words, rest] = /^([^:]*:?)(.*)$/.exec(said);
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

  /** While something moves: what was measured at rest is of another picture.  Its room stays, so that no slider slips away. */
  clear() {
    if (!this.expected.textContent) return;
    this.expected.style.minHeight = `${this.expected.offsetHeight}px`;
    this.expected.textContent = "";
  }

  /** The run whose parameters are nearest, as shares of their ranges: { split, apart: [[how far, words]] }, farthest first; null without runs. */
  nearestRun() {
    const { facts, state } = this.explorer, { parameters } = current(state), trained = facts.members.filter(({ split }) => split !== "test");
    const apart = values => facts.parameters.map((p, i) => Math.abs(shareOf(p, values[i]) - shareOf(p, parameters[p.name])));
    if (!trained.length) return null;
    const [[, { split, values }]] = trained.map(one => [Math.hypot(...apart(one.values)), one]).sort(([a], [b]) => a - b);
    const far = apart(values), words = facts.parameters.map((p, i) => valued(p, values[i]));
    return { split, apart: words.map((word, i) => [far[i], word]).sort(([a], [b]) => b - a) };
  }

  /** Say which run is nearest: of many parameters those that differ most, the others on demand. */
  sayNearest(run) {
    const words = (run?.apart ?? []).map(([, word]) => word), count = words.length > MOST ? MOST - 1 : words.length, rest = words.slice(count);
    this.nearest.textContent = run ? `Nearest run: ${words.slice(0, count).join(", ")}${run.split === "train" ? "" : " (validation)"}` : "";
    this.others.hidden = !rest.length;
    this.others.firstChild.textContent = `${rest.length} parameters that are nearer`;
    this.rest.textContent = rest.join(", ");
  }

  /** The prediction beside the nearest stored picture. */
  async compare() {
    const { explorer } = this;
    await explorer.goToStored(found => explorer.takeStored(found));
    explorer.set({ mode: "compare", against: "truth" });
    explorer.stage.focus();
  }
}
