// The way from snapshot to snapshot: settings and cameras between two states.

import { clipBetween } from "./cuts.js";
import { anglesOf, placedAt } from "./orbit.js";
import { current, shareOf, valueAt } from "./state.js";

const between = (a, b, share) => a + (b - a) * share;
const smooth = share => share * share * (3 - 2 * share); // slow at both ends

/** The state at a share of the way from a state to another: numbers go there evenly, all else is that of the nearer end. */
export function stateBetween(first, last, share, facts) {
  const at = smooth(share), nearer = structuredClone(at < 0.5 ? first : last), [a, b] = [current(first), current(last)], setting = current(nearer);
  for (const p of facts.parameters) {
    setting.parameters[p.name] = valueAt(p, between(shareOf(p, a.parameters[p.name]), shareOf(p, b.parameters[p.name]), at));
  }
  if (a.kind === "isovalue" && b.kind === "isovalue") setting.isovalue = between(a.isovalue, b.isovalue, at);
  setting.clip = clipBetween(a, b, at, facts.box);
  if (a.slice && b.slice && a.slice[0] === b.slice[0]) setting.slice = [a.slice[0], between(a.slice[1], b.slice[1], at)];
  for (const name of Object.keys(setting.points)) setting.points[name] = between(a.points[name], b.points[name], at);
  nearer.orbit = orbitBetween(first.orbit, last.orbit, at);
  return nearer;
}

/** The camera between two, by the shorter way round. */
function orbitBetween(first, last, at) {
  const [from, to] = [anglesOf(first), anglesOf(last)], turn = ((to.azimuth - from.azimuth + 540) % 360 + 360) % 360 - 180;
  const angles = { azimuth: from.azimuth + turn * at, elevation: between(from.elevation, to.elevation, at) };
  return placedAt({
    ...first, target: first.target.map((x, k) => between(x, last.target[k], at)), field: between(first.field, last.field, at),
    distance: first.distance ** (1 - at) * last.distance ** at,
  }, angles);
}

/** All states of a film through `stops`, `steps` from each to the next. */
export const journey = (stops, steps, facts) => stops.slice(1).flatMap((last, i) =>
  Array.from({ length: steps + (i === stops.length - 2 ? 1 : 0) }, (_, step) => stateBetween(stops[i], last, step / steps, facts)));
