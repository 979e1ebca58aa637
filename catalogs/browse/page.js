"use strict";
// One picture of a catalog at a time: which member (sliders, menu), which appearance, from which viewpoint (dragging).

const catalog = JSON.parse(document.getElementById("catalog").textContent);
const $ = id => document.getElementById(id);
const SPLITS = ["train", "validation", "test"];
const HANDLED = 4; // a parameter under the hand counts this much more in "nearest member"
const ROLL = 0.5; // cosine of the largest roll that a drag follows from picture to picture
const KEPT = 400; // pictures prefetched and kept decoded at most

// ---- vectors: arrays of three

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const combine = (x, a, y, b) => a.map((_, i) => x * a[i] + y * b[i]);
const unit = a => combine(1 / (Math.hypot(...a) || 1), a, 0, a);
const across = (a, axis) => unit(combine(1, a, -dot(a, axis), axis)); // the part of `a` at right angles to `axis`
const degrees = radians => radians * 180 / Math.PI;

// ---- state: what is shown (also in the address), and what the hand is doing

const shown = { member: 0, appearance: 0, view: 0, background: "dark", size: "fit" };
let wanted = []; // where the sliders stand, per parameter
let looking = null; // while dragging: {direction, up}, between the viewpoints

const member = () => catalog.members[shown.member];
const viewpoints = () => catalog.viewpoints[member().viewpoints];
const everyAppearance = catalog.appearances.map((_, i) => i);
const appearancesOf = m => m.appearances || everyAppearance; // by number; a member may show some only
const towards = point => point.slice(0, 3);
const upOf = point => point.slice(3, 6);
const addressOf = (m, appearance, view) =>
  ["members", m.name, catalog.appearances[appearance].name, catalog.files[view]].map(encodeURIComponent).join("/");
const text = value => String(+(+value).toPrecision(6));

// ---- nearest viewpoint, nearest member

function nearestView(direction, up) {
  // Two pictures may be taken from one place with the camera rolled: `up` decides between those only.
  let best = 0, most = -Infinity;
  viewpoints().forEach((point, i) => {
    const closeness = dot(point, direction) + 1e-3 * dot(upOf(point), up);
    if (closeness > most) { most = closeness; best = i; }
  });
  return best;
}

function separation(m, target, handled) {
  return catalog.parameters.reduce((sum, p, i) =>
    sum + (i === handled ? HANDLED : 1) * ((m.values[i] - target[i]) / (p.high - p.low)) ** 2, 0);
}

function nearestMember(target, handled, allowed = () => true) {
  let best = -1, least = Infinity;
  catalog.members.forEach((m, k) => {
    const far = allowed(m) ? separation(m, target, handled) : Infinity;
    if (far < least) { least = far; best = k; }
  });
  return best;
}

// ---- showing

const decoded = new Map(); // address -> Image, oldest first

function fetched(address) {
  const image = decoded.get(address) || Object.assign(new Image(), { src: address });
  decoded.delete(address);
  decoded.set(address, image);
  if (decoded.size > KEPT) decoded.delete(decoded.keys().next().value);
  return image;
}

async function showPicture() {
  const address = addressOf(member(), shown.appearance, shown.view);
  let problem = "";
  try { await fetched(address).decode(); } catch (error) {
    problem = `${decodeURIComponent(address)} can't be shown: it is missing or damaged.`;
    decoded.delete(address);
  }
  if (address !== addressOf(member(), shown.appearance, shown.view)) return; // something newer is on its way
  say(problem);
  $("picture").hidden = Boolean(problem);
  if (!problem) {
    $("picture").src = address;
    prefetchAround();
  }
  document.documentElement.dataset.shown = address;
}

function prefetchAround() {
  const here = towards(viewpoints()[shown.view]);
  viewpoints().map((point, i) => [dot(point, here), i]).sort((a, b) => b[0] - a[0]).slice(1, 9)
    .forEach(([, view]) => fetched(addressOf(member(), shown.appearance, view)));
}

function say(message) {
  $("message").textContent = message;
  $("message").hidden = !message;
}

function element(tag, className, content) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (content !== undefined) made.textContent = content;
  return made;
}

function showCaption() {
  const m = member(), parts = catalog.parameters.map((p, i) => {
    const part = element("span", "", `${p.name} `);
    part.append(element("b", "", text(m.values[i])), p.unit ? ` ${p.unit}` : "");
    return part;
  });
  if (catalog.appearances.length > 1) parts.push(element("span", "", catalog.appearances[shown.appearance].title));
  parts.push(element("span", "", `view ${shown.view}`));
  const splits = [m.split, catalog.splits[m.viewpoints][shown.view]];
  parts.push(element("span", `badge ${splits[0]}`, `${splits[0]} member`));
  parts.push(element("span", `badge ${splits[1]}`, `${splits[1]} view`));
  $("caption").replaceChildren(...parts);
  $("picture").alt = parts.map(part => part.textContent).join(", ");
  const [x, y, z] = viewpoints()[shown.view];
  $("view-number").textContent = `${shown.view} of ${viewpoints().length}`;
  $("phi").textContent = `${degrees(Math.atan2(y, x)).toFixed(1)}°`;
  $("theta").textContent = `${degrees(Math.acos(Math.max(-1, Math.min(1, z)))).toFixed(1)}°`;
}

function showControls() {
  const m = member();
  $("member").value = shown.member;
  offerAppearances();
  catalog.parameters.forEach((p, i) => {
    const box = $("parameters").children[i];
    box.querySelector("input").value = wanted[i];
    box.querySelector("input").setAttribute("aria-valuetext", `${text(m.values[i])} ${p.unit}`);
    box.querySelector("output").textContent = text(m.values[i]);
    const current = box.querySelector(".ticks .current");
    current.style.left = percent(p, m.values[i]);
  });
  $("stage").dataset.background = shown.background;
  $("stage").dataset.size = shown.size;
  if (catalog.background) $("stage").style.background = catalog.background;
  for (const button of document.querySelectorAll("[data-size], [data-background]"))
    if (button.tagName === "BUTTON")
      button.setAttribute("aria-pressed", shown.size === button.dataset.size || shown.background === button.dataset.background);
}

function offerAppearances() {
  const menu = $("appearance"), offered = appearancesOf(member()), numbers = offered.join();
  if (menu.dataset.offered !== numbers) {
    menu.dataset.offered = numbers;
    menu.replaceChildren(...grouped(offered));
  }
  menu.value = shown.appearance;
  menu.title = catalog.appearances[shown.appearance].title; // long titles are cut short in the menu
}

function grouped(numbers) {
  const made = [], groups = new Map();
  for (const i of numbers) {
    const { title, group } = catalog.appearances[i], option = new Option(title, i);
    if (!group) {
      made.push(option);
      continue;
    }
    if (!groups.has(group)) {
      groups.set(group, Object.assign(document.createElement("optgroup"), { label: group }));
      made.push(groups.get(group));
    }
    groups.get(group).append(option);
  }
  return made;
}

function show() {
  showCaption();
  showControls();
  drawGlobe();
  writeAddress();
  return showPicture();
}

// ---- changing

function chooseMember(index, keepSliders = false) {
  if (index < 0) return;
  const point = viewpoints()[shown.view];
  shown.member = index;
  if (!keepSliders) wanted = [...member().values];
  keepToAppearances();
  shown.view = nearestView(towards(point), upOf(point)); // members may have cameras of their own
  show();
}

function keepToAppearances() {
  const offered = appearancesOf(member());
  if (!offered.includes(shown.appearance)) shown.appearance = offered[0];
}

function slide(i, value) {
  wanted[i] = value;
  chooseMember(nearestMember(wanted, i), true);
}

function step(i, sign) {
  const here = member().values;
  chooseMember(nearestMember(here, i, m => sign * (m.values[i] - here[i]) > 0));
}

function turn(right, down) {
  // The thing follows the pointer, so the camera goes the other way, along the axes of the picture on the screen.  Only
  // where pictures roll at once, over a pole, does the hand keep its own axes: else it would be sent back and forth.
  const { direction, up } = looking;
  const side = cross(up, direction);
  const moved = unit(combine(1, combine(Math.cos(right), direction, -Math.sin(right), side), Math.sin(down), up));
  looking = { direction: moved, up: across(up, moved) };
  const view = nearestView(moved, looking.up);
  if (view === shown.view) return;
  shown.view = view;
  const pictured = across(upOf(viewpoints()[view]), moved);
  if (dot(pictured, looking.up) > ROLL) looking.up = pictured;
  show();
}

function lookFrom(view) {
  const point = viewpoints()[view];
  looking = { direction: towards(point), up: upOf(point) };
}

function nudge(right, down) {
  const before = shown.view;
  lookFrom(before);
  for (let i = 0; i < 30 && shown.view === before; i++) turn(right * 0.05, down * 0.05);
  looking = null;
}

// ---- the globe of viewpoints, seen from the present one

function globePoints() {
  const middle = viewpoints()[shown.view], direction = towards(middle), up = upOf(middle), side = cross(up, direction);
  return viewpoints().map(point => ({ x: 60 + 52 * dot(point, side), y: 60 - 52 * dot(point, up), depth: dot(point, direction) }));
}

function drawGlobe() {
  const canvas = $("globe"), scale = window.devicePixelRatio || 1, style = getComputedStyle(document.documentElement);
  canvas.width = canvas.height = 120 * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  const circle = (x, y, radius) => { pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); };
  pen.strokeStyle = style.getPropertyValue("--line");
  circle(60, 60, 56);
  pen.stroke();
  const splits = catalog.splits[member().viewpoints];
  globePoints().forEach(({ x, y, depth }, i) => {
    pen.globalAlpha = depth > 0 ? 0.35 + 0.6 * depth : 0.12;
    pen.fillStyle = style.getPropertyValue(`--${splits[i]}`);
    circle(x, y, 1.8);
    pen.fill();
  });
  pen.globalAlpha = 1;
  pen.strokeStyle = style.getPropertyValue("--ink");
  pen.lineWidth = 1.5;
  circle(60, 60, 5);
  pen.stroke();
}

function chooseOnGlobe(event) {
  let best = shown.view, least = Infinity;
  globePoints().forEach(({ x, y, depth }, i) => {
    const far = Math.hypot(x - event.offsetX, y - event.offsetY);
    if (depth > 0 && far < least) { least = far; best = i; }
  });
  shown.view = best;
  show();
}

// ---- the address: #member=...&appearance=...&view=...

function writeAddress() {
  const fields = { member: member().name, appearance: catalog.appearances[shown.appearance].name, view: shown.view };
  if (shown.background !== "dark") fields.background = shown.background;
  if (shown.size !== "fit") fields.size = shown.size;
  history.replaceState(null, "", `#${new URLSearchParams(fields)}`);
}

function readAddress() {
  const fields = new URLSearchParams(location.hash.slice(1));
  const place = (list, name) => Math.max(0, list.findIndex(item => item.name === name));
  if (fields.has("member")) shown.member = place(catalog.members, fields.get("member"));
  if (fields.has("appearance")) shown.appearance = place(catalog.appearances, fields.get("appearance"));
  keepToAppearances();
  if (["dark", "black", "white", "checker"].includes(fields.get("background"))) shown.background = fields.get("background");
  if (["fit", "actual"].includes(fields.get("size"))) shown.size = fields.get("size");
  const view = Number(fields.get("view") ?? NaN), count = viewpoints().length;
  if (Number.isInteger(view) && view >= 0 && view < count) shown.view = view;
  else shown.view = Math.min(shown.view, count - 1);
  wanted = [...member().values];
}

// ---- building the page

const percent = (p, value) => `${100 * Math.max(0, Math.min(1, (value - p.low) / (p.high - p.low)))}%`;

function addParameter(p, i) {
  const box = element("div", "parameter"), line = element("label", "line"), name = element("span", "", p.name);
  if (p.unit) name.append(" ", element("span", "unit", `(${p.unit})`));
  line.htmlFor = `parameter-${i}`;
  line.append(name, element("output"));
  const slider = Object.assign(element("input"), {
    type: "range", id: line.htmlFor, min: p.low, max: p.high, step: "any",
    oninput: event => slide(i, +event.target.value),
    onchange: () => chooseMember(shown.member), // let go: the thumbs fall on the member
    onkeydown: event => {
      const sign = { ArrowRight: 1, ArrowUp: 1, PageUp: 1, ArrowLeft: -1, ArrowDown: -1, PageDown: -1 }[event.key];
      if (!sign) return;
      event.preventDefault();
      step(i, sign);
    },
  });
  const ticks = element("div", "ticks"), drawn = new Set();
  for (const m of catalog.members) {
    const key = `${m.split} ${m.values[i]}`;
    if (drawn.has(key)) continue;
    drawn.add(key);
    const tick = element("i", m.split);
    tick.style.left = percent(p, m.values[i]);
    ticks.append(tick);
  }
  ticks.append(element("i", "current"));
  box.append(line, slider, ticks);
  $("parameters").append(box);
}

function addChoices() {
  $("appearance-field").hidden = catalog.appearances.length < 2;
  for (const split of SPLITS) {
    const group = Object.assign(document.createElement("optgroup"), { label: split });
    catalog.members.forEach((m, i) => {
      if (m.split === split) group.append(new Option(`${m.name}: ${m.values.map(text).join(", ")}`, i));
    });
    if (group.children.length) $("member").append(group);
  }
  $("background-field").hidden = Boolean(catalog.background);
}

function listen() {
  $("appearance").onchange = event => { shown.appearance = +event.target.value; show(); };
  $("member").onchange = event => chooseMember(+event.target.value);
  for (const button of document.querySelectorAll("button"))
    button.onclick = () => {
      for (const choice of ["background", "size"]) if (button.dataset[choice]) shown[choice] = button.dataset[choice];
      show();
    };
  const stage = $("stage");
  let last = null;
  stage.onpointerdown = event => {
    if (event.button !== 0) return;
    last = [event.clientX, event.clientY];
    lookFrom(shown.view);
    stage.setPointerCapture(event.pointerId);
  };
  stage.onpointermove = event => {
    if (!last) return;
    const across = Math.PI / Math.max(240, Math.min(stage.clientWidth, stage.clientHeight)); // half a turn per picture
    turn((event.clientX - last[0]) * across, (event.clientY - last[1]) * across);
    last = [event.clientX, event.clientY];
  };
  stage.onpointerup = stage.onpointercancel = () => { last = looking = null; };
  const keys = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  stage.onkeydown = event => {
    if (!keys[event.key]) return;
    event.preventDefault();
    nudge(...keys[event.key]);
  };
  $("globe").onclick = chooseOnGlobe;
  window.onhashchange = () => { readAddress(); show(); };
}

function start() {
  document.title = $("title").textContent = catalog.title;
  const count = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;
  $("counts").textContent = `${count(catalog.members.length, "member")}, ${count(catalog.parameters.length, "parameter")}`;
  if (!catalog.members.length) {
    say("The catalog has no members yet.");
    for (const section of document.querySelectorAll("aside section, aside > p, #caption")) section.hidden = true;
    return;
  }
  catalog.parameters.forEach(addParameter);
  addChoices();
  // Without an address: the first training member, from the side, a little above.
  shown.member = Math.max(0, catalog.members.findIndex(m => m.split === "train"));
  shown.view = nearestView(unit([1, -0.6, 0.5]), [0, 0, 1]);
  readAddress();
  listen();
  show();
}

start();
