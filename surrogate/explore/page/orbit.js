// The camera as hands move it: around a target, towards it, along the picture.
//
// An orbit is { direction, up, distance, target, field }: from `target` (world units) the camera lies along the unit vector
// `direction`, `distance` away; `up` is a unit vector across it; `field` is the field of view, in degrees, across the shorter side
// of the picture, so that what fits into a wide picture fits into a tall one.

import { across, cross, plus, scaled, unit } from "../web/vectors.js";

const NEAREST = 0.05, FARTHEST = 50; // of the first distance

/** The same with as many digits as an address keeps, so that it holds exactly what is drawn. */
export function rounded({ direction, up, distance, target, field }) {
  const to = (places, value) => +value.toPrecision(places);
  return { direction: direction.map(x => to(9, x)), up: up.map(x => to(9, x)), distance: to(12, distance), target: target.map(x => to(14, x)), field: to(12, field) };
}

/** What the server takes for a camera of a picture of this size: its field is the vertical one. */
export function cameraOf(orbit, [width, height]) {
  const half = Math.tan(orbit.field * Math.PI / 360) * Math.max(1, height / width);
  return {
    position: plus(orbit.target, scaled(orbit.distance, orbit.direction)),
    target: orbit.target,
    up: orbit.up,
    field: height > width ? Math.atan(half) * 360 / Math.PI : orbit.field,
  };
}

/** Moved along the picture by shares of its shorter side. */
export function panned(orbit, right, down) {
  const side = 2 * orbit.distance * Math.tan(orbit.field * Math.PI / 360);
  const rightwards = cross(orbit.up, orbit.direction);
  return { ...orbit, target: plus(orbit.target, plus(scaled(-right * side, rightwards), scaled(down * side, orbit.up))) };
}

/** Farther by a factor, nearer for one below 1. */
export const zoomed = (orbit, factor, home) => ({
  ...orbit,
  distance: Math.max(NEAREST * home.distance, Math.min(FARTHEST * home.distance, orbit.distance * factor)),
});

/** From a direction, the world's z upwards where that is possible. */
export function seenFrom(orbit, direction) {
  const towards = unit(direction);
  return { ...orbit, direction: towards, up: across(Math.abs(towards[2]) > 0.99 ? [0, 1, 0] : [0, 0, 1], towards) };
}

export const PRESETS = { "+x": [1, 0, 0], "−x": [-1, 0, 0], "+y": [0, 1, 0], "−y": [0, -1, 0], "+z": [0, 0, 1], "−z": [0, 0, -1] };
