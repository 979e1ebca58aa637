// The explorer's program inside the page: the same calls as connection.js makes, answered by the browser itself.
// The page holds the surrogate, {facts, record, megabytes, best, expected} and its tensors, compressed, or names their files.

import { answered, cameraOf } from "draw/answers.js";
import { Doubt, never } from "draw/doubt.js";
import { Graphics } from "draw/graphics.js";
import { Measured } from "draw/measured.js";
import { modelOf } from "draw/model.js";
import { normalized } from "draw/parameters.js";
import { seenPlace, sharesOf, valueAt } from "draw/probing.js";
import { CARD, transferOf, transferred, Ways } from "draw/ways.js";
import { paintMarks } from "explore/overlay.js";

const given = JSON.parse(new TextDecoder().decode(await unpacked("surrogate")));
export const model = modelOf(await unpacked("tensors"), await unpacked("field"), given.record);
export const doubt = given.expected.survey ? new Doubt(given.expected, given.facts.parameters) : null;
const canvas = document.createElement("canvas");
const measured = []; // predictions by field
let refusal = "", kept = {}; // the field of the last parameters
export const ways = new Ways(model, given, graphicsOf());
canvas.addEventListener("webglcontextlost", event => {
  event.preventDefault();
  ways.use(null);
});
canvas.addEventListener("webglcontextrestored", () => ways.use(graphicsOf()));

/** Graphics on the card; null, and why, without. */
function graphicsOf() {
  try {
    return new Graphics(canvas);
  } catch (error) {
    refusal = error.message;
    return null;
  }
}

/** The bytes of an element that holds base64 of gzip, or names a file beside the page; null without. */
async function unpacked(id) {
  const holder = document.getElementById(id), file = holder?.dataset.file, text = holder?.textContent.trim();
  if (file) return fetched(file);
  if (!text) return null;
  const packed = Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), character => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function fetched(file) {
  const response = await fetch(file).catch(() => null);
  if (response?.ok) return new Uint8Array(await response.arrayBuffer());
  document.body.textContent = `This page can't be shown, for its host does not send ${file}.`;
  throw new Error(document.body.textContent);
}

export class Gone extends Error {}

/** There is no program that could draw, or be asked. */
export const drawable = null, expected = null, asks = false, over = null, suggested = null, follow = null;

/** Whether a graphics card draws here. */
export const drawsAlone = () => ways.device === CARD;

/** Nothing is ever lost. */
export const listen = () => {};

export async function facts() {
  const contents = [...ways.contents, refusal && `scripts draw, for ${refusal}`].filter(Boolean);
  return { ...given.facts, model: { ...given.facts.model, best: "what is best and fastest here", representations: ways.listed, contents } };
}

/** An answer with pictures as bitmaps. */
export async function frame(request) {
  const { settings, form } = request, camera = cameraOf(request);
  return { ...await answered(ways, request), truth: null, expected: form === "png" ? settings.map(setting => expectation(setting, camera)) : null };
}

/** The values that are seen at a pixel and at pins; their errors the page does not hold. */
export async function probed(request, pixel, pins) {
  const { field, appearance } = fieldOf(request.settings[0]), found = (place, own = field) => {
    const value = valueAt(own, place);
    return value === null ? null : { value, deviation: null, half: null };
  };
  const place = pixel && seenPlace(field, appearance, cameraOf(request), pixel, request.settings[0]);
  const { name, unit } = given.quantities[appearance.number];
  return { seen: place && { place, value: null, ...found(place) }, pins: pins.length ? request.settings.map(setting => pins.map(place => found(place, fieldOf(setting).field))) : [], name, unit };
}

/** How often the field has which value. */
export async function here(request) {
  const { field } = fieldOf(request.settings[0]), edges = given.facts.histogram?.edges;
  return sharesOf(field, edges);
}

/** Predictions all over the parameters, without the runs, whose fields the page does not hold. */
export async function predictions(request) {
  const { appearance: { number } } = fieldOf(request.settings[0]);
  measured[number] ??= new Measured(model.fields, number, given.quantities[number]);
  return measured[number].answer();
}

/** The field that shows a setting, and how: { field, appearance }. */
function fieldOf({ parameters, visualization, color_map: map, function: free }) {
  const { fields } = model;
  if (!fields) throw new Error("This page holds no emulated field, so it knows no values: surrogate export --field-modes puts one in.");
  const { appearance } = fields.appearance(visualization, transferred(fields, { visualization, color_map: map, function: free }, ways.maps[map]));
  const key = JSON.stringify([appearance.number, parameters]);
  if (kept.key !== key) kept = { key, field: fields.at(appearance.number, parameters) };
  return { field: kept.field, appearance };
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

/** What to expect of a picture; what the run measured on average where it holds no more. */
function expectation(setting, camera) {
  if (setting.clip || setting.slice) return never("no stored image is cut or sliced");
  if (!doubt) return { psnr: null, short: given.expected.sentence, sentence: given.expected.sentence, warning: false };
  const { parameters, visualization, color_map: map, function: free } = setting, base = model.record.field?.base ?? model.record.emulation?.base.transfer_function;
  const changed = map || free || Object.keys(visualization).length > 0, isFunction = changed && !("isovalue" in visualization || "appearance" in visualization);
  return doubt.interval({
    values: parameters, point: normalized(model.record.parameters, parameters), camera, using: ways.of(setting)[0], trained: !changed,
    transfer: base && isFunction ? transferOf({ ...base, ...free }, visualization, ways.maps[map]) : null,
  });
}
