// The histogram of what is shown, beside that of all runs: how often the emulated field has which value at these parameters.

import { Gone, here } from "./connection.js";
import { Newest } from "./newest.js";
import { current, messageOf } from "./state.js";

const SAMPLES = 1e6; // of a field, where no run says how many

export class Here {
  constructor(explorer) {
    this.explorer = explorer;
    this.has = explorer.facts.model.representations.some(({ name }) => name.split("-")[0] === "field");
    this.newest = new Newest(({ request }) => here(request), (found, { key }) => this.take(found, key), error => { this.has &&= error instanceof Gone; });
  }

  /** The picture rests: ask anew where it shows other parameters. */
  follow() {
    const { state, facts } = this.explorer, setting = current(state), key = JSON.stringify(setting.parameters);
    if (!this.has || setting.kind !== "transfer_function") return;
    if (this.key === key) this.explorer.hereShown?.(this.found);
    else this.newest.wish({ request: { ...this.explorer.request(false), settings: [messageOf(setting, facts)], difference: false, truth: false }, key });
  }

  take(found, key) {
    Object.assign(this, { found, key });
    this.explorer.hereShown?.(found);
  }
}

/** Heights (B,) of a field's shares on the logarithmic axis of all runs' `histogram`, where the fullest bin of these is 1. */
export function heightsOf({ shares }, histogram) {
  const samples = histogram?.samples ?? SAMPLES, most = histogram?.most ?? SAMPLES * Math.max(...shares);
  return shares.map(share => Math.min(1.05, Math.log1p(share * samples) / Math.log1p(most)));
}
