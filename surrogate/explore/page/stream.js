// Frames: small ones while something moves, one whole one when it rests.  The newest wish wins; never more than two are asked for
// at once, so that a slow line shows fewer frames instead of old ones.

const AT_ONCE = 2;
const REST = 45; // milliseconds without a change after which it rests

export class Stream {
  /**
   * `request(moving)` makes the message; `frame(request)` resolves to an answer; `show(answer, moving, request, isNewest)` puts it on
   * the screen, if `isNewest()` says then that no later one is there already, and resolves when it is there;
   * `fail(error)` says why there is none.
   */
  constructor(request, frame, show, fail) {
    Object.assign(this, { request, frame, show, fail });
    this.waiting = 0; // frames that were asked for and are not on the screen yet
    this.dirty = false; // whether something changed since
    this.whole = false; // whether the last that was asked for is a whole one
    this.asked = 0; // frames, of which each has its number
    this.newest = 0; // number of the last that was put on the screen
  }

  /** Whether the newest wish is on the screen, whole. */
  get resting() { return !this.dirty && !this.waiting && this.whole; }

  /** Something changed. */
  change() {
    this.dirty = true;
    this.whole = false;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.settle(), REST);
    this.pump();
  }

  /** Draw the whole frame now, as after a change that is not part of a movement. */
  settle() {
    clearTimeout(this.timer);
    this.dirty = false;
    this.ask(false);
  }

  pump() {
    if (!this.dirty || this.waiting >= AT_ONCE) return;
    this.dirty = false;
    this.ask(true);
  }

  async ask(moving) {
    this.whole = !moving;
    this.waiting += 1;
    const number = this.asked += 1;
    const isNewest = () => {
      if (number < this.newest) return false;
      this.newest = number;
      return true;
    };
    try {
      const request = this.request(moving);
      await this.show(await this.frame(request), moving, request, isNewest);
    } catch (error) {
      if (isNewest()) this.fail(error);
    } finally {
      this.waiting -= 1;
      this.pump();
    }
  }
}
