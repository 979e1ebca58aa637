// What a picture says of itself: title and settings, a legend of colour and opacity, the box with ticks, and the axes.
// The same geometry as surrogate/explore/exporting/annotations.py.  Pixels from the picture's left top corner.
//
// Marks are ["line", [x1, y1, x2, y2], stroke], ["path", [[x, y], ...]], ["rect", [x, y, width, height], colour] and
// ["text", [x, y], anchor, size, text, weight]: a stroke is FRONT, BACK or a colour, x of a text is its start, middle or end.

import { across, cross, dot, plus, scaled, unit } from "../web/vectors.js";
import { axisOf, between, hexOf } from "./functions.js";

export const PARTS = { title: "Title and settings", legend: "Legend", box: "Box with ticks", axes: "Axes" };
export const FRONT = 0.5, BACK = 0.2; // opacity of lines
const APART = 64, SHORTEST = 40, TICK = 5, NUMBER = 9, NAME = 24, LETTER = 6; // pixels at scale 1
const NEAR = 1e-3; // of the box's diagonal
const NAMES = "xyz", AXES = ["#e5605e", "#4fa35f", "#5b8def"], ARM = 28, CORNER = 54;
const PIN = 9; // pixels of a ring at scale 1
export const LEFT = 18, TOP = 20;
const BESIDE_BAR = 2; // lines of words beside the bar of the page
const SMALL = 11, SPACE = 2; // height of numbers, and pixels between two
const LINE = 15, MOST_LINES = 5, WIDTH_OF_LETTER = 0.58; // of words below the title; a letter's share of its height
const LEGEND_TOP = 66, BAR = 12, CURVE = 26, STEPS = 64, TALLEST = 240;

/** The scale of a file by the pixels of its shorter side; on the screen it is 1. */
export const scaleOf = ([width, height]) => Math.max(0.75, Math.min(4, Math.min(width, height) / 600));

/** All marks of a picture; `legend` is { colors, opacity, knots, label } or null, `cut` what a cut leaves of the box or null, `shown` the names of PARTS that are not hidden, 
 * `pins` are { place, text }, `lines` the words, `rows` how many of them stand over the legend. */
export function annotationsOf({ camera, size, box, cut, legend, title, words, shown, pins = [], scale = 1, lines = linesOf(words, size[0], scale), rows = shown.includes("title") ? lines.length : 0 }) {
  const lens = lensOf(camera, size);
  return [
    ...shown.includes("box") ? boxOf(lens, box, scale) : [],
    ...shown.includes("box") && cut ? linesAlong(edgesOf(lens, ...cut)) : [],
    ...shown.includes("legend") && legend ? legendOf(legend, size, scale, rows) : [],
    ...shown.includes("axes") ? axesOf(lens, size, scale) : [],
    ...shown.includes("title") ? titleOf(title, lines, size, scale) : [],
    ...pinsOf(lens, pins, size, scale),
  ];
}

/** A camera { position, target, up, field } of a picture: { eye, axes: [right, down, forward], project(point) -> [x, y, depth] }. */
export function lensOf({ position, target, up, field }, [width, height]) {
  const forward = unit(plus(target, scaled(-1, position))), right = unit(cross(forward, across(up, forward))), down = cross(forward, right);
  const focal = height / (2 * Math.tan(field * Math.PI / 360));
  const project = point => {
    const from = plus(point, scaled(-1, position)), depth = dot(from, forward);
    return [width / 2 + focal * dot(from, right) / depth, height / 2 + focal * dot(from, down) / depth, depth];
  };
  return { eye: position, axes: [right, down, forward], project };
}

/** Numbers of places in rings, and what is said beside them. */
function pinsOf(lens, pins, [width, height], scale) {
  return pins.flatMap(({ place, text }, i) => {
    const [x, y, depth] = lens.project(place), turn = 2 * Math.PI / 24;
    if (!(depth > 0 && x >= 0 && x <= width && y >= 0 && y <= height)) return [];
    const ring = Array.from({ length: 25 }, (_, k) => [x + PIN * scale * Math.cos(k * turn), y + PIN * scale * Math.sin(k * turn)]);
    return [["path", ring], ["text", [x, y], "middle", 11, String(i + 1), 700], ["text", [x + (PIN + 5) * scale, y], "start", 12, text, 400]];
  });
}

// ---- the box

function boxOf(lens, [low, high], scale) {
  const edges = edgesOf(lens, low, high), lines = linesAlong(edges);
  const center = lens.project(plus(scaled(0.5, low), scaled(0.5, high)));
  return [...lines, ...readable([0, 1, 2].flatMap(axis => ticksOf(edges.filter(edge => edge.axis === axis), axis, lens, center, scale)), scale)];
}

/** The marks without numbers that would lie over a text before them: axes end in the same corners. */
function readable(marks, scale) {
  const places = [];
  return marks.filter(mark => {
    if (mark[0] !== "text") return true;
    const place = extentOf(mark, scale);
    if (mark[3] === SMALL && places.some(other => place.every(([low, high], k) => low < other[k][1] && other[k][0] < high))) return false;
    places.push(place);
    return true;
  });
}

/** Where a text lies: [from, to] across and down. */
function extentOf([, [x, y], anchor, letter, text], scale) {
  const width = WIDTH_OF_LETTER * letter * scale * text.length, left = x - width * { start: 0, middle: 0.5, end: 1 }[anchor];
  return [[left - SPACE * scale, left + width + SPACE * scale], [y - letter * scale / 2, y + letter * scale / 2]];
}

const linesAlong = edges => edges.filter(edge => edge.ends).map(({ ends: [[x1, y1], [x2, y2]], front }) => ["line", [x1, y1, x2, y2], front ? FRONT : BACK]);

/** The twelve edges: { axis, from, to, front, outline, ends }; two faces meet in each, and it is seen where one of them is. */
function edgesOf(lens, low, high) {
  const near = NEAR * Math.hypot(...plus(high, scaled(-1, low)));
  const faces = [0, 1, 2].map(axis => [lens.eye[axis] < low[axis], lens.eye[axis] > high[axis]]); // seen from outside
  return [0, 1, 2].flatMap(axis => [0, 1, 2, 3].map(corner => {
    const [a, b] = [0, 1, 2].filter(other => other !== axis), sides = [corner & 1, corner >> 1];
    const from = [...low];
    [from[a], from[b]] = [sides[0] ? high[a] : low[a], sides[1] ? high[b] : low[b]];
    const to = [...from], seen = [faces[a][sides[0]], faces[b][sides[1]]];
    to[axis] = high[axis];
    return { axis, from, to, front: seen[0] || seen[1], outline: seen[0] !== seen[1], ends: clipped(lens, from, to, near) };
  }));
}

/** Both ends on the screen, cut where the edge passes the camera; null behind it. */
function clipped(lens, from, to, near) {
  const [first, last] = [lens.project(from)[2], lens.project(to)[2]];
  if (Math.max(first, last) <= near) return null;
  const at = depth => plus(from, scaled((near - depth[0]) / (depth[1] - depth[0]), plus(to, scaled(-1, from))));
  const cut = at([first, last]);
  return [first > near ? from : cut, last > near ? to : cut].map(lens.project);
}

/** Ticks, numbers and the name of an axis along the outline's edge that lies lowest, or for z rightmost, on the screen. */
function ticksOf(edges, axis, lens, center, scale) {
  const order = axis === 2 ? 0 : 1, middle = ({ ends }) => ends[0][order] + ends[1][order];
  const fitting = edges.filter(({ outline, ends, from, to }) => outline && ends && lens.project(from)[2] > 0 && lens.project(to)[2] > 0);
  if (!fitting.length) return [];
  const { from, to, ends: [a, b] } = fitting.reduce((best, edge) => middle(edge) > middle(best) + 1e-9 ? edge : best);
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
  if (length < SHORTEST * scale) return [];
  let out = [(a[1] - b[1]) / length, (b[0] - a[0]) / length];
  if (out[0] * (a[0] - center[0]) + out[1] * (a[1] - center[1]) < 0) out = scaled(-1, out);
  const anchor = Math.abs(out[0]) < 0.5 ? "middle" : out[0] > 0 ? "start" : "end";
  const { values, texts } = niceNumbers(from[axis], to[axis], Math.max(1, Math.floor(length / (APART * scale))));
  const beside = ([x, y], pixels) => [x + pixels * scale * out[0], y + pixels * scale * out[1]];
  const marks = values.flatMap((value, i) => {
    const point = [...from];
    point[axis] = value;
    const at = lens.project(point);
    return [["line", [at[0], at[1], ...beside(at, TICK)], FRONT], ["text", beside(at, NUMBER + (anchor === "middle" ? 4 : 0)), anchor, SMALL, texts[i], 400]];
  });
  const widest = Math.max(0, ...texts.map(text => text.length)), far = NAME + 6 + (anchor === "middle" ? 0 : LETTER * widest);
  return [...marks, ["text", beside(plus(scaled(0.5, a), scaled(0.5, b)), far), "middle", 13, NAMES[axis], 600]];
}

/** At most `most` + 1 round numbers from low to high, 1, 2 or 5 times a power of ten apart, and their texts. */
export function niceNumbers(low, high, most) {
  const least = (high - low) / most, power = 10 ** Math.floor(Math.log10(least)), step = [1, 2, 5, 10].find(times => times * power >= least * (1 - 1e-9)) * power;
  const values = [], slack = 1e-9 * (high - low);
  for (let k = Math.ceil((low - slack) / step); k * step <= high + slack; ++k) values.push(k * step);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), plain = decimals <= 4 && Math.max(Math.abs(low), Math.abs(high)) < 1e5;
  const largest = Math.max(0, ...values.map(Math.abs)) || step, digits = Math.max(2, Math.floor(Math.log10(largest) + 1e-9) - Math.floor(Math.log10(step) + 1e-9));
  const texts = values.map(value => (plain ? value.toFixed(decimals) : value.toExponential(digits)).replace(/^-(?=0\.?0*$)/, "").replaceAll("-", "−"));
  return { values, texts };
}

// ---- legend, axes, title

function legendOf({ colors, opacity, knots, label }, [, height], scale, rows) {
  const axis = axisOf(knots), top = (LEGEND_TOP + LINE * Math.max(0, rows - 1)) * scale, tall = Math.min(TALLEST * scale, 0.45 * height), left = LEFT * scale;
  if (tall < 3 * SHORTEST * scale) return [];
  const y = place => top + tall * (1 - place), x = share => left + (BAR + 4 + CURVE * share) * scale, marks = [];
  for (let i = 0; i < STEPS; ++i) {
    const color = hexOf([1, 2, 3].map(k => between(colors, axis.value((i + 0.5) / STEPS), k)));
    marks.push(["rect", [left, y((i + 1) / STEPS), BAR * scale, tall / STEPS], color]);
  }
  marks.push(["line", [x(0), y(0), x(0), y(1)], BACK]);
  marks.push(["path", Array.from({ length: STEPS + 1 }, (_, i) => [x(between(opacity, axis.value(i / STEPS))), y(i / STEPS)])]);
  let free = Infinity;
  knots.forEach((knot, i) => {
    const at = y(axis.place(knot)), last = i === knots.length - 1;
    if (at > free || (!last && at < y(1) + 15 * scale)) return;
    free = at - 15 * scale;
    const text = String(+knot.toPrecision(3)).replace("-", "−");
    marks.push(["line", [left, at, left + BAR * scale, at], FRONT], ["text", [x(1) + 6 * scale, at], "start", 11, text, 400]);
  });
  marks.push(["text", [left, y(0) + 18 * scale], "start", 11, label ? `${label}, line: opacity` : "line: opacity", 400]);
  return marks;
}

/** Where the triad's tips lie: [x, y, depth] of each axis from the middle of the triad. */
export function tipsOf({ axes: [right, down, forward] }, scale) {
  return [0, 1, 2].map(k => [ARM * scale * right[k], ARM * scale * down[k], forward[k]]);
}

export const triadAt = ([width, height], scale) => [width - CORNER * scale, height - CORNER * scale];

function axesOf(lens, size, scale) {
  const [x, y] = triadAt(size, scale), tips = tipsOf(lens, scale);
  return [0, 1, 2].sort((a, b) => tips[b][2] - tips[a][2]).flatMap(k => [
    ["line", [x, y, x + tips[k][0], y + tips[k][1]], AXES[k]],
    ["text", [x + 1.35 * tips[k][0], y + 1.35 * tips[k][1]], "middle", 12, NAMES[k], 700],
  ]);
}

const lettersIn = (width, scale, letter) => Math.max(8, Math.floor((width / scale - 2 * LEFT) / (WIDTH_OF_LETTER * letter)));
const short = (text, most) => text.length > most ? `${text.slice(0, most - 1)}…` : text;

/** Settings in lines that are no wider than `width`, those below a bar than `below`, broken between them. */
export function linesOf(words, width, scale, below = width) {
  const most = i => lettersIn(i < BESIDE_BAR ? width : Math.max(width, below), scale, 12), lines = [];
  for (const part of words.split(/ (?=·)|(?<=,) /)) {
    const longer = lines.length ? `${lines.at(-1)} ${part}` : part;
    if (lines.length && longer.length <= most(lines.length - 1)) lines[lines.length - 1] = longer;
    else lines.push(part.replace(/^· /, ""));
  }
  if (lines.length > MOST_LINES) lines[MOST_LINES - 1] += " …";
  return lines.slice(0, MOST_LINES).map((line, i) => short(line, most(i)));
}

function titleOf(title, lines, [width], scale) {
  const line = (text, below, letter, weight) => ["text", [LEFT * scale, (TOP + below) * scale], "start", letter, text, weight];
  return [line(short(title, lettersIn(width, scale, 16)), 0, 16, 650), ...lines.map((text, i) => line(text, 21 + LINE * i, 12, 400))];
}
