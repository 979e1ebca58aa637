// Questions about the picture that is shown: where it may be wrong, where a parameter acts, what to simulate next.

import { button, digits, element, menu } from "../web/elements.js";
import { group } from "./groups.js";
import { asks, over, suggested } from "./connection.js";
import { decoded, paint } from "./pictures.js";

/** The panel of questions; null where nobody could answer. */
export const askPanel = explorer => asks ? new Ask(explorer) : null;

class Ask {
  constructor(explorer) {
    this.explorer = explorer;
    const { facts, state } = explorer, acts = facts.parameters.map(({ name }) => [name, `Where does ${name} act?`]);
    const offered = [["", "Nothing"], ...(facts.truth ? [["error", "Where may it be wrong?"]] : []), ...acts];
    this.map = element("canvas", { class: "over", "aria-hidden": "true" });
    this.words = element("p", { class: "hint", role: "status" });
    this.bars = element("div", { class: "bars" });
    this.box = group("Ask", menu("Over the picture", "over", state.over, offered, chosen => explorer.set({ over: chosen })), this.words, this.bars,
      facts.members.length > 0 && button("What to simulate next", () => this.suggest(), { id: "suggest" }));
  }

  /** The picture has changed: what was said is of another one. */
  clear() {
    this.asking = null;
    this.map.hidden = true;
    this.words.textContent = "";
    this.bars.replaceChildren();
  }

  /** Answer for the picture that rests on the stage. */
  async follow() {
    const { explorer } = this, about = explorer.state.over;
    this.clear();
    if (!about) return;
    if (explorer.state.mode !== "view") {
      this.words.textContent = "Maps lie over the picture of Explore.";
      return;
    }
    const asking = this.asking = {};
    try {
      const answer = await over(explorer.request(false), about), [bitmap] = await Promise.all(answer.pictures.map(bytes => decoded(bytes, "png")));
      if (asking === this.asking) this.show(answer, bitmap);
      else bitmap.close();
    } catch (error) {
      if (asking === this.asking) this.words.textContent = error.message;
    }
  }

  show({ high, words, shares }, bitmap) {
    this.explorer.panes[0].canvas.after(this.map);
    this.map.hidden = false;
    paint([this.map], [bitmap], true);
    this.words.textContent = `Brightest: ${digits(high)} and more, ${words}.`;
    const ranked = Object.entries(shares).sort((a, b) => b[1] - a[1]);
    this.bars.replaceChildren(...ranked.map(([name, share]) => element("p", {}, element("span", {}, name),
      element("i", { style: `width:${Math.round(100 * share)}px`, role: "img", "aria-label": `${digits(+share.toFixed(2))} of the largest change` }))));
  }

  async suggest() {
    try {
      this.explorer.suggested = await suggested();
      this.words.textContent = `${this.explorer.suggested.length} runs that would teach most are diamonds on the map of runs; surrogate ask next writes them.`;
      this.explorer.map.redraw();
    } catch (error) {
      this.words.textContent = error.message;
    }
  }
}
