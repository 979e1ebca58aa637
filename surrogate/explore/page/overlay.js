// Marks (annotations.js) over a picture: as SVG on the stage, whose axes are buttons, and painted into a picture to be saved.

import { drawn } from "../web/elements.js";
import { annotationsOf, BACK, FRONT, lensOf, linesOf, PARTS, scaleOf, tipsOf, triadAt } from "./annotations.js";
import { leftOf } from "./cuts.js";
import { colorsOf, displaced } from "./functions.js";
import { variation } from "./state.js";
import { described } from "./words.js";

const FONT = "system-ui, 'DejaVu Sans', sans-serif", REACH = 9; // pixels around an axis' name that hear a click
const WIDEST = 430; // pixels of words below the bar
const OVER = 60; // pixels of a picture below which no bar is in the way
const LIGHT = 0.5; // luminance of a background from which on ink is dark

/** What the marks of a setting's picture say, beside its camera and size. */
export function saidOf(setting, state, facts) {
  const of = variation(facts, "transfer_function"), made = setting.kind === "transfer_function" && (setting.free ?? displaced(of, setting.points));
  return {
    title: facts.title, words: `${described(setting, facts)} · predicted, not simulated`, box: facts.box, cut: leftOf(setting, facts.box), background: state.background,
    legend: made ? { colors: colorsOf(made, setting.colorMap, of), opacity: setting.slice ? made.opacity.map(([value]) => [value, 1]) : made.opacity, knots: of.knots, label: of.label } : null,
    shown: Object.keys(PARTS).filter(part => !state.hidden.includes(part)),
  };
}

/** Straight colours of ink and of what surrounds it on a background "#rrggbb". */
export function inksOf(background) {
  const [red, green, blue] = [1, 3, 5].map(at => parseInt(background.slice(at, at + 2), 16) / 255);
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue > LIGHT ? ["#101216", "#ffffff"] : ["#f1f3f6", "#101216"];
}

const GROUPS = { // parts that are drawn anew together, when something that they need has changed
  words: { parts: ["title"], needs: ["title", "lines"] },
  legend: { parts: ["legend"], needs: ["legend", "rows"] },
  space: { parts: ["box", "axes"], needs: ["box", "cut", "camera"] },
};

/** Show the marks of a picture in an SVG of `size` (CSS pixels); `look(axis)` hears that an axis is chosen. */
export function overlay(svg, plain, look) {
  const lines = linesOf(plain.words, freeAbove(svg), 1, Math.min(plain.size[0], WIDEST)), rows = plain.shown.includes("title") ? lines.length : 0;
  const given = { ...plain, lines, rows }, { size, background, shown, camera } = given, inks = inksOf(background);
  if (!svg.firstChild) {
    svg.append(...Object.keys(GROUPS).map(() => drawn("g", { "aria-hidden": "true" })), drawn("g", {}, ...[0, 1, 2].map(axis => axisButton(axis, look))));
  }
  const axes = svg.lastChild;
  svg.setAttribute("viewBox", `0 0 ${size.join(" ")}`);
  Object.values(GROUPS).forEach(({ parts, needs }, i) => {
    const part = svg.children[i], own = shown.filter(one => parts.includes(one)), key = JSON.stringify([size, background, own, ...needs.map(name => given[name])]);
    if (key === part.dataset.key) return;
    part.dataset.key = key;
    part.replaceChildren(...annotationsOf({ ...given, shown: own }).map(mark => shapeOf(mark, inks)));
  });
  const tips = tipsOf(lensOf(camera, size), 1), [x, y] = triadAt(size, 1);
  axes.style.display = shown.includes("axes") ? "" : "none";
  [...axes.children].forEach((made, k) => {
    made.setAttribute("cx", x + 1.35 * tips[k][0]);
    made.setAttribute("cy", y + 1.35 * tips[k][1]);
  });
}

/** How wide words at the top of a picture may be: as far as the bar, where that lies over it. */
function freeAbove(svg) {
  const bar = document.getElementById("top").getBoundingClientRect(), own = svg.getBoundingClientRect();
  return bar.left > own.left && bar.top < own.top + OVER ? bar.left - own.left : own.width;
}

function shapeOf([kind, place, ...rest], [ink, around]) {
  if (kind === "rect") return drawn("rect", { x: place[0], y: place[1], width: place[2], height: place[3] + 0.5, fill: rest[0] });
  if (kind === "path") return drawn("polyline", { points: place.map(point => point.join(",")).join(" "), fill: "none", stroke: ink, "stroke-width": 1.3 });
  if (kind === "line") return drawn("line", { x1: place[0], y1: place[1], x2: place[2], y2: place[3], ...strokeOf(rest[0], ink) });
  const [anchor, letter, text, weight] = rest;
  return drawn("text", {
    x: place[0], y: place[1], "text-anchor": anchor, "font-size": letter, "font-weight": weight, "dominant-baseline": "central",
    fill: ink, stroke: around, "stroke-width": 3, "stroke-opacity": 0.6, "paint-order": "stroke",
  }, text);
}

const strokeOf = (stroke, ink) => typeof stroke === "string"
  ? { stroke, "stroke-width": 2.5, "stroke-linecap": "round" } : { stroke: ink, "stroke-opacity": stroke, "stroke-width": stroke === FRONT ? 1.1 : 1 };

function axisButton(k, look) {
  return drawn("circle", {
    class: "axis", r: REACH, role: "button", tabindex: 0, "aria-label": `Look along ${"xyz"[k]}`,
    onclick: () => look(k), onpointerdown: event => event.stopPropagation(), ondblclick: event => event.stopPropagation(),
    onkeydown: event => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      event.stopPropagation();
      look(k);
    },
  });
}

/** Paint the marks of a picture over it; a 2-D context of its size. */
export function paintMarks(context, given) {
  const scale = scaleOf(given.size), [ink, around] = inksOf(given.background);
  for (const [kind, place, ...rest] of annotationsOf({ ...given, scale })) {
    if (kind === "rect") {
      context.fillStyle = rest[0];
      context.fillRect(place[0], place[1], place[2], place[3] + 0.5);
      continue;
    }
    if (kind === "text") {
      write(context, place, rest, scale, [ink, around]);
      continue;
    }
    const points = kind === "path" ? place : [place.slice(0, 2), place.slice(2)], colored = typeof rest[0] === "string";
    context.globalAlpha = kind === "path" || colored ? 1 : rest[0] === BACK ? BACK : FRONT;
    Object.assign(context, { strokeStyle: colored ? rest[0] : ink, lineWidth: (colored ? 2.5 : 1.1) * scale, lineCap: "round" });
    context.beginPath();
    points.forEach(([x, y], i) => { context[i ? "lineTo" : "moveTo"](x, y); });
    context.stroke();
    context.globalAlpha = 1;
  }
}

function write(context, [x, y], [anchor, letter, text, weight], scale, [ink, around]) {
  Object.assign(context, {
    font: `${weight} ${letter * scale}px ${FONT}`, textAlign: { middle: "center" }[anchor] ?? anchor, textBaseline: "middle",
    strokeStyle: around, lineWidth: 3 * scale, lineJoin: "round", globalAlpha: 0.6,
  });
  context.strokeText(text, x, y);
  Object.assign(context, { globalAlpha: 1, fillStyle: ink });
  context.fillText(text, x, y);
}
