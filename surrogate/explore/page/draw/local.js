// The explorer's program inside the page: the same calls as connection.js makes, answered by the browser itself.
// The page holds the surrogate: {facts, record, megabytes, best, expected} and its tensors, compressed.

import { differenceOf } from "draw/difference.js";
import { Doubt } from "draw/doubt.js";
import { Graphics } from "draw/graphics.js";
import { modelOf } from "draw/model.js";
import { normalized } from "draw/parameters.js";
import { bitmapOf, CARD, SCRIPTS, transferOf, Ways } from "draw/ways.js";
import { paintMarks } from "explore/overlay.js";
import { across, cross, unit } from "web/vectors.js";

const given = JSON.parse(new TextDecoder().decode(await unpacked("surrogate")));
export const model = modelOf(await unpacked("tensors"), await unpacked("field"), given.record);
export const doubt = given.expected.survey ? new Doubt(given.expected, given.facts.parameters) : null;
let graphics = null, refusal = "";
try {
  graphics = new Graphics(document.createElement("canvas"));
} catch (error) {
  refusal = error.message;
}
const ways = new Ways(model, given, graphics);

/** The bytes of an element that holds base64 of gzip; null where it is empty. */
async function unpacked(id) {
  const text = document.getElementById(id).textContent.trim();
  if (!text) return null;
  const packed = Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), character => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export class Gone extends Error {}

/** Nothing is ever lost: there is no program. */
export const listen = () => {};

export async function facts() {
  const besides = { [CARD]: graphics?.renderer, [SCRIPTS]: refusal && `for ${refusal}` };
  return { ...given.facts, model: { ...given.facts.model, best: "what is best and fastest here", representations: ways.listed(besides) } };
}

/** An answer with pictures as bitmaps. */
export async function frame(request) {
  const started = performance.now(), { settings, size } = request, background = channels(request.background), camera = lookAt(request.camera, size);
  const pictures = [], answer = { truth: null };
  if (request.difference) {
    const both = settings.map(setting => ways.displayed(setting, camera, background));
    const { picture, ...numbers } = differenceOf(...both);
    for (const own of [...both, picture]) pictures.push(await bitmapOf(own, size));
    answer.difference = numbers;
  } else {
    for (const setting of settings) pictures.push(await ways.bitmap(setting, camera, background));
  }
  return {
    ...answer, pictures, form: request.form, size, drawn: performance.now() - started,
    by: settings.map(setting => ways.wordsOf(setting)),
    expected: request.form === "png" ? settings.map(setting => expected(setting, camera)) : null,
  };
}

export const survey = async () => given.expected;

/** No pictures are stored here. */
export const nearest = async () => null;

/** A picture to be saved: { name, blob }. */
export async function exported(request) {
  const { pictures: [bitmapOfIt] } = await frame({ ...request, form: "png", difference: false, settings: request.settings.slice(0, 1) });
  const [width, height] = request.size, page = Object.assign(document.createElement("canvas"), { width, height });
  const context = page.getContext("2d");
  context.drawImage(bitmapOfIt, 0, 0);
  paintMarks(context, { ...request.annotations, camera: request.camera, size: request.size });
  return { name: `${given.facts.title}.png`, blob: await new Promise(resolve => { page.toBlob(resolve); }) };
}

const channels = color => [1, 3, 5].map(at => parseInt(color.slice(at, at + 2), 16) / 255);

/** The camera of `Camera.look_at`, as JSON. */
function lookAt({ position, target, up, field }, [width, height]) {
  const forward = unit(target.map((x, k) => x - position[k])), right = unit(cross(forward, across(up, forward))), down = cross(forward, right);
  const focal = height / (2 * Math.tan(field * Math.PI / 360));
  const rows = [right, down, forward].map(axis => [...axis, -axis.reduce((sum, x, k) => sum + x * position[k], 0)]);
  return { world_to_camera: [...rows, [0, 0, 0, 1]], fx: focal, fy: focal, cx: width / 2, cy: height / 2, width, height };
}

/** What to expect of a picture; what the run measured on average where it holds no more. */
function expected(setting, camera) {
  if (!doubt) return { psnr: null, short: given.expected.sentence, sentence: given.expected.sentence, warning: false };
  const { parameters, visualization, color_map: map, function: free } = setting, base = model.record.field?.base ?? model.record.emulation?.base.transfer_function;
  const changed = map || free || Object.keys(visualization).length > 0, isFunction = changed && !("isovalue" in visualization || "appearance" in visualization);
  return doubt.interval({
    values: parameters, point: normalized(model.record.parameters, parameters), camera, using: ways.of(setting)[0], trained: !changed,
    transfer: base && isFunction ? transferOf({ ...base, ...free }, visualization, ways.maps[map]) : null,
  });
}
