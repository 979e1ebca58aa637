// The way from snapshot to snapshot: settings and cameras between two states.

import { AXES, clipBetween } from "./cuts.js";
import { anglesOf, placedAt } from "./orbit.js";
import { current, pointsOf, shareOf, tidy, valueAt, variation } from "./state.js";

const between = (a, b, share) => a + (b - a) * share;
const smooth = share => share * share * (3 - 2 * share); // slow at both ends

/** The state at a share of the way from a state to another: numbers go there evenly, all else is that of the nearer end. */
export function stateBetween(first, last, share, facts) {
  if (share <= 0 || share >= 1) return structuredClone(share <= 0 ? first : last);
  const at = smooth(share), nearer = structuredClone(at < 0.5 ? first : last), [a, b] = [current(first), current(last)], setting = current(nearer), [low, high] = facts.box;
  const placed = (x, k) => tidy(x, { low: low[k], high: high[k] });
  for (const p of facts.parameters) {
    setting.parameters[p.name] = tidy(valueAt(p, between(shareOf(p, a.parameters[p.name]), shareOf(p, b.parameters[p.name]), at)), p);
  }
  if (a.kind === "isovalue" && b.kind === "isovalue") setting.isovalue = tidy(between(a.isovalue, b.isovalue, at), variation(facts, "isovalue"));
  setting.clip = clipBetween(a, b, at, facts.box)?.map((x, i) => placed(x, i % 3)) ?? null;
  if (a.slice && b.slice && a.slice[0] === b.slice[0]) setting.slice = [a.slice[0], placed(between(a.slice[1], b.slice[1], at), AXES.indexOf(a.slice[0]))];
  for (const p of pointsOf(facts)) setting.points[p.name] = tidy(between(a.points[p.name], b.points[p.name], at), p);
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
