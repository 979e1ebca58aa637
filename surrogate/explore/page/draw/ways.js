// The ways to draw a setting: by Gaussians, from the emulated field or as the mean image of both, each on a graphics card or by scripts.

import { Cards } from "draw/cards.js";
import { FieldCards } from "draw/field_cards.js";
import { FieldScripts } from "draw/field_scripts.js";
import { figureFor, follows } from "draw/model.js";
import { Scripts } from "draw/scripts.js";

export const CARD = "card"; // a device
const SCRIPTS = "scripts";
const GAUSSIANS = "gaussians", FIELD = "field", BOTH = "both";
const WORDS = { [GAUSSIANS]: "Gaussians", [FIELD]: "emulated field", [BOTH]: "mean image of Gaussians and field" };
const DEVICES = { [CARD]: "graphics card", [SCRIPTS]: "scripts" };

export class Ways {
  /** Of a model, what its page holds, and graphics, null without. */
  constructor(model, { megabytes, best, facts }, graphics) {
    Object.assign(this, { model, megabytes, best });
    this.maps = Object.fromEntries(facts.variations.flatMap(one => one.color_maps ?? []).map(({ name, points }) => [name, points]));
    this.engines = new Map(); // that have drawn, by what they draw and their devices
    this.use(graphics);
    const held = Object.keys(megabytes);
    this.kinds = held.length > 1 ? [...held, BOTH] : held;
  }

  /** Draw by other graphics from now on; by scripts alone while these are null, such as after a card was lost. */
  use(graphics) {
    this.graphics = graphics;
    this.device = graphics && !graphics.software ? CARD : SCRIPTS;
    for (const own of this.engines.values()) delete own[CARD];
  }

  /** All ways: [{name, words, megabytes}]. */
  get listed() {
    const devices = this.graphics ? [CARD, SCRIPTS] : [SCRIPTS], whole = Object.values(this.megabytes).reduce((sum, own) => sum + own, 0);
    return this.kinds.flatMap(kind => devices.map(device =>
      ({ name: `${kind}-${device}`, words: this.wordsFor(kind, device), megabytes: this.megabytes[kind] ?? whole })));
  }

  /** Sentences on what the page holds and what draws it. */
  get contents() {
    const { graphics, megabytes, model: { figures } } = this, held = Object.entries(megabytes);
    const described = ([kind, size]) => [kind === GAUSSIANS && figures[0].columns.count.toLocaleString("en"), WORDS[kind]].filter(Boolean).join(" ")
      + `, ${+size.toPrecision(2)} MB`;
    return [...held.map(described), graphics && `${DEVICES[CARD]}: ${graphics.renderer}`].filter(Boolean);
  }

  /** The representation that validation prefers for a setting, held here or not. */
  preferred({ visualization, color_map: map, function: free, clip, slice }) {
    return clip || slice ? FIELD : this.best[questionOf(visualization, map || free)];
  }

  /** True where a setting can be drawn here by a representation. */
  draws(kind, { visualization, color_map: map, function: free, clip, slice }) {
    return this.kinds.includes(kind) && (kind === FIELD || !clip && !slice && follows(this.model, visualization, map || free));
  }

  /** What draws a setting: [kind, device]. */
  of(setting) {
    const [kind, device] = setting.using ? setting.using.split("-") : [this.preferred(setting), this.device];
    const drawn = (setting.clip || setting.slice ? [kind] : [kind, ...this.kinds]).find(one => this.draws(one, setting));
    if (!drawn && (setting.clip || setting.slice)) throw new Error("only the emulated field can be cut or sliced: choose it, where this page has one");
    return [drawn ?? this.kinds[0], this.graphics ? device : SCRIPTS];
  }

  wordsOf(setting) {
    return this.wordsFor(...this.of(setting));
  }

  wordsFor(kind, device) {
    return this.kinds.length > 1 ? `${WORDS[kind]}, ${DEVICES[device]}` : DEVICES[device];
  }

  /** The picture of a setting that a world camera sees over a background, (H, W, 3) in [0, 1]. */
  displayed(setting, camera, background) {
    const [kind, device] = this.of(setting);
    if (kind !== BOTH) return displayed(this.shown(setting, kind, device).draw(camera), background);
    const [first, second] = [GAUSSIANS, FIELD].map(one => displayed(this.shown(setting, one, device).draw(camera), background));
    return first.map((x, k) => 0.5 * (x + second[k]));
  }

  /** The same as a bitmap. */
  bitmap(setting, camera, background) {
    const [kind, device] = this.of(setting);
    if (kind === BOTH || device === SCRIPTS) return bitmapOf(this.displayed(setting, camera, background), [camera.width, camera.height]);
    return this.shown(setting, kind, device).bitmap(camera, background);
  }

  /** The engine that shows a setting: what it shows already is not computed anew. */
  shown(setting, kind, device) {
    const { model, maps, graphics } = this, { parameters, visualization, color_map: map, function: free, clip, slice } = setting, cut = JSON.stringify([clip, slice]);
    const isField = kind === FIELD, of = isField ? model.fields : figureFor(model, visualization, map || free), onCard = device === CARD;
    const engine = this.engine(of, device, isField ? () => onCard ? new FieldCards(of, graphics) : new FieldScripts(of)
      : () => onCard ? new Cards(of, graphics) : new Scripts(of));
    const values = { ...parameters, ...visualization }, point = JSON.stringify(values), look = JSON.stringify([visualization, map, free, Boolean(slice)]);
    const isNew = engine.look !== look;
    if (isField) {
      if (engine.point !== point || isNew) engine.set(parameters, visualization, transferred(of, setting, maps[map]), { clip, slice });
      else if (engine.cut !== cut) engine.cutTo({ clip, slice });
    } else {
      if (isNew && of.base) engine.setFunction(transferOf({ ...of.base, ...free }, visualization, maps[map]));
      if (engine.point !== point || isNew && of.made) engine.setParameters(values);
    }
    return Object.assign(engine, { point, look, cut });
  }

  engine(of, device, make) {
    const own = this.engines.get(of) ?? {};
    this.engines.set(of, own);
    return own[device] ??= make();
  }
}

/** The kind of question that a setting is, as `RepresentationScores` tells them apart. */
function questionOf(visualization, byFunction) {
  if ("isovalue" in visualization) return "isovalue";
  if ("appearance" in visualization) return "field";
  return byFunction || Object.keys(visualization).length ? "transfer_function" : "view";
}

/** The function of a field's base that a setting shows: {function, free}, free where no distance along rays is known; null for its own. */
export function transferred({ record: { base: { transfer_function: base } } }, { visualization, color_map: map, function: free }, points) {
  if (!base || "isovalue" in visualization || "appearance" in visualization) return null;
  return { function: transferOf({ ...base, ...free }, visualization, points), free: Boolean(map || free) };
}

/** The base with displaced control points and the colours of a map; see `displaced` of the catalog's variations. */
export function transferOf(base, visualization, map) {
  const points = base.opacity_points.map(point => [...point]);
  ["c1_value", "c1_opacity", "c2_value", "c2_opacity"].forEach((name, i) => {
    if (name in visualization) points[1 + (i >> 1)][i & 1] += visualization[name];
  });
  const [low, high] = [base.color_points[0][0], base.color_points.at(-1)[0]];
  const colors = map ? map.map(([place, ...color]) => [low + place * (high - low), ...color]) : base.color_points;
  return { ...base, opacity_points: points, color_points: colors };
}

/** A picture of premultiplied RGBA as displayed, (H, W, 3) in [0, 1]. */
function displayed(numbers, background) {
  const picture = new Float32Array(3 * numbers.length / 4);
  for (let from = 0, to = 0; from < numbers.length; from += 4) {
    for (let k = 0; k < 3; ++k) picture[to++] = Math.min(Math.max(numbers[from + k] + (1 - numbers[from + 3]) * background[k], 0), 1);
  }
  return picture;
}

/** A picture (H, W, 3) in [0, 1] as a bitmap. */
export function bitmapOf(picture, [width, height]) {
  const bytes = new Uint8ClampedArray(4 * width * height);
  for (let from = 0, to = 0; from < picture.length; to += 4) {
    for (let k = 0; k < 3; ++k) bytes[to + k] = 255 * picture[from++];
    bytes[to + 3] = 255;
  }
  return createImageBitmap(new ImageData(bytes, width, height));
}
