// The explorer's program inside the page: the same calls as connection.js makes, answered by the browser itself.
// The page holds the surrogate: {facts, record, expected} and its tensors, compressed.

import { Cards } from "draw/cards.js";
import { differenceOf } from "draw/difference.js";
import { Doubt } from "draw/doubt.js";
import { Graphics } from "draw/graphics.js";
import { figureFor, modelOf } from "draw/model.js";
import { normalized } from "draw/parameters.js";
import { Scripts } from "draw/scripts.js";
import { across, cross, unit } from "web/vectors.js";

const GAUSSIANS = "gaussians", CARD = "card", SCRIPTS = "scripts", WORDS = { [CARD]: "graphics card", [SCRIPTS]: "scripts" };

const given = JSON.parse(new TextDecoder().decode(await unpacked("surrogate")));
export const model = modelOf(await unpacked("tensors"), given.record);
export const doubt = given.expected.survey ? new Doubt(given.expected, given.facts.parameters) : null;
const engines = new Map(); // that have drawn, by their figures and names
let graphics, refusal = "";
try {
  graphics = new Graphics(document.createElement("canvas"));
} catch (error) {
  refusal = error.message;
}
const best = graphics && !graphics.software ? CARD : SCRIPTS;

/** The bytes of an element that holds base64 of gzip. */
async function unpacked(id) {
  const text = document.getElementById(id).textContent.trim();
  const packed = Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), character => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export class Gone extends Error {}

/** Nothing is ever lost: there is no program. */
export const listen = () => {};

export async function facts() {
  const { megabytes } = given.facts.model;
  const ways = [graphics && { name: CARD, words: `${WORDS[CARD]}: ${graphics.renderer}`, megabytes },
    { name: SCRIPTS, words: refusal ? `${WORDS[SCRIPTS]}, for ${refusal}` : WORDS[SCRIPTS], megabytes }].filter(Boolean);
  return { ...given.facts, model: { ...given.facts.model, best: "what is faster here", representations: ways } };
}

/** An answer with pictures as bitmaps. */
export async function frame(request) {
  const started = performance.now(), { settings, size } = request, background = channels(request.background), camera = lookAt(request.camera, size);
  const pictures = [], answer = { truth: null };
  if (request.difference) {
    const both = settings.map(setting => displayed(shown(setting).draw(camera), background));
    const { picture, ...numbers } = differenceOf(...both);
    for (const own of [...both, picture]) pictures.push(await bitmapOf(own, size));
    answer.difference = numbers;
  } else {
    for (const setting of settings) pictures.push(await bitmap(shown(setting), camera, background));
  }
  return {
    ...answer, pictures, form: request.form, size, drawn: performance.now() - started,
    by: settings.map(setting => WORDS[setting.using || best]),
    expected: request.form === "png" ? settings.map(setting => expected(setting, camera)) : null,
  };
}

/** No pictures are stored here. */
export const nearest = async () => null;

/** A picture to be saved: { name, blob }. */
export async function exported(request) {
  const { pictures: [bitmapOfIt] } = await frame({ ...request, form: "png", difference: false, settings: request.settings.slice(0, 1) });
  const [width, height] = request.size, page = Object.assign(document.createElement("canvas"), { width, height });
  page.getContext("2d").drawImage(bitmapOfIt, 0, 0);
  return { name: `${given.facts.title}.png`, blob: await new Promise(resolve => { page.toBlob(resolve); }) };
}

/** The engine that a setting names, which shows it: what it shows already is not computed anew. */
function shown({ using, parameters, visualization, color_map: map, function: free }) {
  const name = using || best, figure = figureFor(model, visualization, map || free), engine = engineOf(name, figure);
  const values = { ...parameters, ...visualization }, point = JSON.stringify(values), look = JSON.stringify([visualization, map, free]);
  const isNew = figure.base && engine.look !== look;
  if (isNew) engine.setFunction(transferOf({ ...figure.base, ...free }, visualization, map));
  if (engine.point !== point || isNew && figure.made) engine.setParameters(values);
  return Object.assign(engine, { point, look });
}

function engineOf(name, figure) {
  const ofFigure = engines.get(figure) ?? {};
  engines.set(figure, ofFigure);
  return ofFigure[name] ??= name === CARD ? new Cards(figure, graphics) : new Scripts(figure);
}

const bitmap = (engine, camera, background) =>
  engine instanceof Cards ? engine.bitmap(camera, background) : bitmapOf(displayed(engine.draw(camera), background), [camera.width, camera.height]);

/** A function with displaced control points and a colour map; see `displaced` of the catalog's variations. */
export function transferOf(base, visualization, map) {
  const points = base.opacity_points.map(point => [...point]);
  ["c1_value", "c1_opacity", "c2_value", "c2_opacity"].forEach((name, i) => {
    if (name in visualization) points[1 + (i >> 1)][i & 1] += visualization[name];
  });
  const [low, high] = [base.color_points[0][0], base.color_points.at(-1)[0]];
  const chosen = map && given.facts.variations.flatMap(one => one.color_maps ?? []).find(({ name }) => name === map);
  const colors = chosen ? chosen.points.map(([place, ...color]) => [low + place * (high - low), ...color]) : base.color_points;
  return { ...base, opacity_points: points, color_points: colors };
}

/** A picture of premultiplied RGBA as displayed, (H, W, 3) in [0, 1]. */
function displayed(numbers, background) {
  const picture = new Float32Array(3 * numbers.length / 4);
  for (let from = 0, to = 0; from < numbers.length; from += 4) {
    for (let k = 0; k < 3; ++k) picture[to++] = numbers[from + k] + (1 - numbers[from + 3]) * background[k];
  }
  return picture;
}

/** A picture (H, W, 3) in [0, 1] as a bitmap. */
function bitmapOf(picture, [width, height]) {
  const bytes = new Uint8ClampedArray(4 * width * height);
  for (let from = 0, to = 0; from < picture.length; to += 4) {
    for (let k = 0; k < 3; ++k) bytes[to + k] = 255 * picture[from++];
    bytes[to + 3] = 255;
  }
  return createImageBitmap(new ImageData(bytes, width, height));
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
function expected({ parameters, visualization, color_map: map, function: free }, camera) {
  if (!doubt) return { psnr: null, short: given.expected.sentence, sentence: given.expected.sentence, warning: false };
  const { base } = model.record.field ?? {}, changed = map || free || Object.keys(visualization).length > 0;
  return doubt.interval({
    values: parameters, point: normalized(model.record.parameters, parameters), camera, using: GAUSSIANS, trained: !changed,
    transfer: base && changed && !("isovalue" in visualization) ? transferOf({ ...base, ...free }, visualization, map) : null,
  });
}
