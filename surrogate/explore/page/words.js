// Settings, and the errors to expect, in words.

import { digitsOf } from "../web/elements.js";
import { cutWords, usedBy } from "./cuts.js";
import { pointsOf, variation } from "./state.js";

export const KIND_NAMES = { base: "Volume", isovalue: "Isovalue", transfer_function: "Volume", field: "Field" };

/** A parameter's value with its name and unit, such as "Re = 1800": names may end in digits. */
export const valued = (p, value) => `${p.name} = ${digitsOf(p, value, 5)}${p.unit ? ` ${p.unit}` : ""}`;

/** A setting in words. */
export function described(setting, facts) {
  const words = facts.parameters.map(p => valued(p, setting.parameters[p.name]));
  if (setting.kind === "isovalue") words.push(valued({ name: "isovalue", ...variation(facts, "isovalue") }, setting.isovalue));
  if (setting.kind === "field") words.push(setting.appearance);
  if (setting.kind === "transfer_function") {
    if (setting.free) words.push(`function of ${setting.free.opacity.length} points`);
    const moved = pointsOf(facts).filter(p => setting.points[p.name] !== p.origin);
    words.push(...moved.map(p => valued(p, setting.points[p.name])));
    if (setting.colorMap) words.push(setting.colorMap);
  }
  words.push(...cutWords(setting, facts));
  const using = usedBy(setting);
  if (using) words.push(`by the ${facts.model.representations.find(one => one.name === using).words}`);
  return words.join(", ");
}

/** What error to expect of all pictures of a sweep, in a sentence. */
export function spanOf(expected) {
  const known = expected.map(one => one.psnr).filter(psnr => psnr !== null), missing = expected.length - known.length;
  const reason = expected.find(one => one.psnr === null)?.short ?? "";
  if (!known.length) return reason;
  const [low, high] = [Math.min(...known).toFixed(1), Math.max(...known).toFixed(1)];
  const span = `expected PSNR ${low === high ? low : `${low} to ${high}`} dB (higher is better; from 40 dB on differences are hardly visible)`;
  const far = expected.filter(one => one.psnr !== null && one.warning).length;
  return [span, missing && `${missing} of ${expected.length} pictures: ${reason}`, far && `${far} of ${expected.length} far from all runs`].filter(Boolean).join("; ");
}

/** A warning where [low, high] leaves the range that was trained; "" where it does not. */
export function extrapolation(p, low, high = low) {
  const slack = 1e-9 * (p.high - p.low);
  return low < p.low - slack || high > p.high + slack ? `Extrapolating beyond training range: ${digitsOf(p, p.low)} to ${digitsOf(p, p.high)}.` : "";
}

/** The same of one picture, as short as can be. */
export const shortest = expected => expected.psnr === null ? (expected.warning ? "— dB" : "") : `${expected.psnr.toFixed(1)} dB`;
