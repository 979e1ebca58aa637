// Frames: small ones while something moves, one whole one when it rests.  The newest wish wins; never more than two are asked for
// at once, so that a slow line shows fewer frames instead of old ones.

import { frame } from "./connection.js";

const AT_ONCE = 2;
const REST = 45; // milliseconds without a change after which it rests

export class Stream {
  /**
   * `request(moving)` makes the message; `show(answer, moving)` puts it on the screen and resolves when it is there;
   * `fail(error)` says why there is none.
   */
  constructor(request, show, fail) {
    Object.assign(this, { request, show, fail });
    this.asked = 0; // number of the last request
    this.shown = 0; // number of the last one that was shown
    this.waiting = 0;
    this.dirty = false;
    this.settled = 0; // number of the last request for a whole frame
    this.timer = null;
  }

  /** Whether the newest wish is on the screen, whole. */
  get resting() { return !this.dirty && !this.waiting && this.shown === this.settled; }

  /** Something changed. */
  change() {
    this.dirty = true;
    this.settled = 0;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.rest(), REST);
    this.pump();
  }

  /** Draw the whole frame now, as after a change that is not part of a movement. */
  settle() {
    clearTimeout(this.timer);
    this.rest();
  }

  pump() {
    if (!this.dirty || this.waiting >= AT_ONCE) return;
    this.dirty = false;
    this.ask(true);
  }

  rest() {
    this.dirty = false;
    this.ask(false);
  }

  async ask(moving) {
    const request = this.request(moving), number = ++this.asked;
    if (!moving) this.settled = number;
    this.waiting += 1;
    try {
      const answer = await frame(request);
      if (number > this.shown) {
        this.shown = number;
        await this.show(answer, moving);
      }
    } catch (error) {
      if (number > this.shown) {
        this.shown = number;
        this.fail(error);
      }
    } finally {
      this.waiting -= 1;
      this.pump();
    }
  }
}
