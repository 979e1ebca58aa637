// The camera as hands move it: around a target, towards it, along the picture.
//
// An orbit is { direction, up, distance, target, field }: from `target` (world units) the camera lies along the unit vector
// `direction`, `distance` away; `up` is a unit vector across it; `field` is the field of view, in degrees, across the shorter side
// of the picture, so that what fits into a wide picture fits into a tall one.

import { across, cross, plus, scaled, unit } from "../web/vectors.js";

const NEAREST = 0.05, FARTHEST = 50; // of the first distance, at the first field of view
const UPWARDS = [0, 0, 1], STEEPEST = Math.PI / 2;

/** The same with as many digits as an address keeps, so that it holds exactly what is drawn. */
export function rounded({ direction, up, distance, target, field }) {
  const to = (places, value) => +value.toPrecision(places);
  return { direction: direction.map(x => to(9, x)), up: up.map(x => to(9, x)), distance: to(12, distance), target: target.map(x => to(14, x)), field: to(12, field) };
}

/** What the server takes for a camera of a picture of this size: its field is the vertical one. */
export function cameraOf(orbit, [width, height]) {
  const vertical = half(orbit) * Math.max(1, height / width);
  return {
    position: plus(orbit.target, scaled(orbit.distance, orbit.direction)),
    target: orbit.target,
    up: orbit.up,
    field: height > width ? Math.atan(vertical) * 360 / Math.PI : orbit.field,
  };
}

/**
 * Turned by angles (radians) as on a turntable: sideways about the world's z axis, up and down as far as the poles, the horizon
 * level.  The object follows the pointer, so the camera goes the other way.
 */
export function turned(orbit, right, down) {
  const { direction, up } = orbit;
  const height = Math.asin(Math.max(-1, Math.min(1, direction[2])));
  // Seen from a pole, `up` says which way the camera faces.
  const level = Math.abs(direction[2]) > 1 - 1e-12 ? scaled(-Math.sign(direction[2]), up) : direction;
  const angle = Math.atan2(level[1], level[0]) - right, outwards = [Math.cos(angle), Math.sin(angle), 0];
  const to = Math.max(-STEEPEST, Math.min(STEEPEST, height + down)), cosine = Math.cos(to), sine = Math.sin(to);
  return {
    ...orbit,
    direction: unit(plus(scaled(cosine, outwards), scaled(sine, UPWARDS))),
    up: unit(plus(scaled(-sine, outwards), scaled(cosine, UPWARDS))),
  };
}

/** Moved along the picture by shares of its shorter side. */
export function panned(orbit, right, down) {
  const side = 2 * orbit.distance * half(orbit);
  const rightwards = cross(orbit.up, orbit.direction);
  return { ...orbit, target: plus(orbit.target, plus(scaled(-right * side, rightwards), scaled(down * side, orbit.up))) };
}

/** Farther by a factor, nearer for one below 1. */
export function zoomed(orbit, factor, home) {
  const first = home.distance * half(home) / half(orbit); // where the target's plane has its first size
  return { ...orbit, distance: Math.max(NEAREST * first, Math.min(FARTHEST * first, orbit.distance * factor)) };
}

/** The tangent of half the field of view. */
const half = ({ field }) => Math.tan(field * Math.PI / 360);

/** Zoomed so that the point of the target's plane at shares (right, down) of the shorter side from the middle stays where it is. */
export function zoomedAt(orbit, factor, home, right, down) {
  const nearer = zoomed(orbit, factor, home), more = orbit.distance / nearer.distance - 1;
  return panned(nearer, -right * more, -down * more);
}

/** Another field of view (degrees), from so far away that the target's plane keeps its size. */
export function widened(orbit, field, home) {
  return zoomed({ ...orbit, field }, half(orbit) / half({ field }), home);
}

/** { azimuth, elevation }: where the camera stands, degrees from the world's x towards y, and above the horizon. */
export function anglesOf({ direction: [x, y, z], up }) {
  const pole = Math.hypot(x, y) < 1e-9, degrees = 180 / Math.PI;
  const [east, north] = pole ? [-Math.sign(z) * up[0], -Math.sign(z) * up[1]] : [x, y];
  return { azimuth: degrees * Math.atan2(north, east), elevation: degrees * Math.asin(Math.max(-1, Math.min(1, z))) };
}

/** Seen from these angles, the horizon level. */
export function placedAt(orbit, { azimuth, elevation }) {
  const radians = Math.PI / 180, start = { direction: [1, 0, 0], up: [0, 0, 1] };
  return turned({ ...orbit, ...start }, -azimuth * radians, elevation * radians);
}

/** From a direction, the world's z upwards where that is possible. */
export function seenFrom(orbit, direction) {
  const towards = unit(direction);
  return { ...orbit, direction: towards, up: across(Math.abs(towards[2]) > 0.99 ? [0, 1, 0] : [0, 0, 1], towards) };
}

/** Along an axis (0, 1, 2) from its positive end; seen from there already, from the other. */
export function seenAlong(orbit, axis) {
  const direction = [0, 1, 2].map(k => Number(k === axis));
  return seenFrom(orbit, orbit.direction[axis] > 0.9999 ? scaled(-1, direction) : direction);
}

export const PRESETS = { "+x": [1, 0, 0], "−x": [-1, 0, 0], "+y": [0, 1, 0], "−y": [0, -1, 0], "+z": [0, 0, 1], "−z": [0, 0, -1] };
