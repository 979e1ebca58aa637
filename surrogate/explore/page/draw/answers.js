// Requests for pictures, answered by a browser; see surrogate/explore/request.py for what they hold.

import { differenceOf } from "draw/difference.js";
import { bitmapOf } from "draw/ways.js";
import { across, cross, unit } from "web/vectors.js";

/** Pictures as bitmaps, and what is said of them: { pictures, difference, form, size, drawn, by }. */
export async function answered(ways, request) {
  const started = performance.now(), { settings, size, form } = request, background = channels(request.background), camera = cameraOf(request);
  const pictures = [], answer = {};
  if (request.difference) {
    const both = settings.map(setting => ways.displayed(setting, camera, background));
    const { picture, ...numbers } = differenceOf(...both);
    for (const own of [...both, picture]) pictures.push(await bitmapOf(own, size));
    answer.difference = numbers;
  } else {
    for (const setting of settings) pictures.push(await ways.bitmap(setting, camera, background));
  }
  return { ...answer, pictures, form, size, drawn: performance.now() - started, by: settings.map(setting => ways.wordsOf(setting)) };
}

const channels = color => [1, 3, 5].map(at => parseInt(color.slice(at, at + 2), 16) / 255);

/** The camera of a request, as `Camera.look_at` makes it, as JSON. */
export function cameraOf({ camera: { position, target, up, field }, size: [width, height] }) {
  const forward = unit(target.map((x, k) => x - position[k])), right = unit(cross(forward, across(up, forward))), down = cross(forward, right);
  const focal = height / (2 * Math.tan(field * Math.PI / 360));
  const rows = [right, down, forward].map(axis => [...axis, -axis.reduce((sum, x, k) => sum + x * position[k], 0)]);
  return { world_to_camera: [...rows, [0, 0, 0, 1]], fx: focal, fy: focal, cx: width / 2, cy: height / 2, width, height };
}
