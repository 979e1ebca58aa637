// Frames by the program, or by this browser where it has a graphics card, or is asked to: then no picture has to come over the line.

import { Graphics } from "draw/graphics.js";
import { drawable, drawsAlone, expected, frame } from "./connection.js";

export const HERE = "browser", THERE = "program"; // "" is whichever is faster

export class Drawing {
  /** `asked()` is where frames are to be drawn now; `say(sentence)` hears why they can't be. */
  constructor(asked, say) {
    Object.assign(this, { asked, say, isOffered: drawable !== null });
    if (!this.isOffered) return;
    try {
      this.graphics = new Graphics(document.createElement("canvas"));
    } catch {
      this.graphics = null;
    }
    this.card = this.graphics && !this.graphics.software ? this.graphics.renderer : "";
  }

  /** Whether this browser draws, as far as it can. */
  get isHere() { return this.isOffered && !this.failed && (this.asked() || (this.card ? HERE : THERE)) === HERE; }

  /** Whether it draws whole pictures fast enough to move them. */
  get isFast() { return drawsAlone() || this.isHere && Boolean(this.ways && this.card); }

  /** An answer with pictures. */
  async frame(request) {
    if (!this.isHere || request.truth) return frame(request);
    const ways = await this.load();
    const own = ways && { ...request, settings: request.settings.map(setting => waysOf(setting, ways)) };
    if (!own || own.settings.includes(null)) return frame(request);
    const answer = await this.answered(ways, own);
    return { ...answer, by: answer.by.map(words => `${words}, in this browser`), expected: request.form === "png" ? await expected(request) : null };
  }

  /** Fetch the modules that draw, and the model: most browsers without a graphics card never need them. */
  async begin() {
    const [{ answered }, { modelOf }, { Ways }] = await Promise.all(["answers", "model", "ways"].map(name => import(`draw/${name}.js`)));
    const { tensors, field, ...given } = await drawable();
    this.answered = answered;
    return new Ways(modelOf(tensors, field, given.record), given, this.graphics);
  }

  /** The model, from the program, once; null where it can't be drawn here. */
  async load() {
    this.loading ??= this.begin();
    try {
      this.ways = await this.loading;
    } catch (error) {
      this.failed = true;
      this.say(`This browser can't draw it, so the program does: ${error.message}`);
      return null;
    }
    return this.ways;
  }
}

/** A setting in the words of the ways to draw; null where none draws it. */
function waysOf(setting, ways) {
  const kind = setting.using || ways.preferred(setting);
  return ways.draws(kind, setting) ? { ...setting, using: `${kind}-${ways.device}` } : null;
}
