// The link to Python: parameters that it sets are shown, and it hears of those that hands set.

import { follow, Gone } from "./connection.js";
import { current } from "./state.js";

const EVERY = 300; // milliseconds

/** Keep in step with the program's `page.parameters` from now on. */
export async function link(explorer) {
  for (let number = 0; ;) {
    try {
      const answer = await follow({ number, parameters: current(explorer.state).parameters });
      if (answer.parameters) {
        Object.assign(current(explorer.state).parameters, answer.parameters);
        explorer.moved();
      }
      ({ number } = answer);
    } catch (error) {
      if (!(error instanceof Gone)) return; // the program refuses what is shown
    }
    await new Promise(resolve => { setTimeout(resolve, EVERY); });
  }
}
