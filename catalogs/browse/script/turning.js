// ---- turning: from picture to picture by dragging, by keys, and on the globe of viewpoints

const ROLL = 0.5; // cosine of the largest roll that a drag follows from picture to picture
const GLOBE = 120;

let looking = null; // while dragging: {direction, up}, between the viewpoints

function turn(right, down) {
  // Along the axes of the picture on the screen.  Only where pictures roll at once, over a pole, does the hand keep its own axes:
  // else it would be sent back and forth.
  looking = turned(looking, right, down);
  const view = nearestView(viewpoints(), looking.direction, looking.up);
  if (view === state.view) return;
  const pictured = across(upOf(viewpoints()[view]), looking.direction);
  if (dot(pictured, looking.up) > ROLL) looking.up = pictured;
  chooseView(view);
}

function lookFrom(view) {
  const point = viewpoints()[view];
  looking = { direction: towards(point), up: upOf(point) };
}

function nudge(right, down) {
  const before = state.view;
  lookFrom(before);
  for (let i = 0; i < 30 && state.view === before; i++) turn(right * 0.05, down * 0.05);
  looking = null;
}

function listenToStage(stage, k) {
  let last = null;
  const activate = () => { if (state.mode === "compare" && state.active !== k) chooseMode("compare", k); };
  stage.onpointerdown = event => {
    if (event.button !== 0) return;
    activate();
    last = [event.clientX, event.clientY];
    lookFrom(state.view);
    stage.setPointerCapture(event.pointerId);
  };
  stage.onpointermove = event => {
    if (!last) return;
    const halfTurn = Math.max(240, Math.min(stage.clientWidth, stage.clientHeight));
    const angle = Math.PI / halfTurn;
    turn((event.clientX - last[0]) * angle, (event.clientY - last[1]) * angle);
    last = [event.clientX, event.clientY];
  };
  stage.onpointerup = stage.onpointercancel = () => { last = looking = null; };
  const keys = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  stage.onkeydown = event => {
    if (!keys[event.key]) return;
    event.preventDefault();
    activate();
    nudge(...keys[event.key]);
  };
}

function globePoints() {
  const middle = viewpoints()[state.view], direction = towards(middle), up = upOf(middle), aside = cross(up, direction);
  const half = GLOBE / 2, radius = half - 8;
  return viewpoints().map(point => ({
    x: half + radius * dot(point, aside), y: half - radius * dot(point, up), depth: dot(point, direction),
  }));
}

function drawGlobe() {
  const pen = sharpPen($("globe"), GLOBE, GLOBE), half = GLOBE / 2;
  const circle = (x, y, radius) => { pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); };
  pen.strokeStyle = token("line");
  circle(half, half, half - 4);
  pen.stroke();
  const splits = viewSplits[viewpointSet(cell().member)], colors = catalog.splits.map(token);
  globePoints().forEach(({ x, y, depth }, i) => {
    pen.globalAlpha = depth > 0 ? 0.35 + 0.6 * depth : 0.12;
    pen.fillStyle = colors[splits[i]];
    circle(x, y, 1.8);
    pen.fill();
  });
  pen.globalAlpha = 1;
  pen.strokeStyle = token("ink");
  pen.lineWidth = 1.5;
  circle(half, half, 5);
  pen.stroke();
}

function chooseOnGlobe(event) {
  const points = globePoints();
  chooseView(lowest(points.keys(), i => points[i].depth > 0 ? Math.hypot(points[i].x - event.offsetX, points[i].y - event.offsetY) : Infinity));
}

function showView() {
  const [x, y, z] = viewpoints()[state.view];
  $("view-number").max = viewpoints().length - 1;
  if (document.activeElement !== $("view-number")) $("view-number").value = state.view;
  $("view-count").textContent = `of ${viewpoints().length}`;
  $("phi").textContent = `${(Math.atan2(y, x) * 180 / Math.PI).toFixed(1)}°`;
  $("theta").textContent = `${(Math.acos(Math.max(-1, Math.min(1, z))) * 180 / Math.PI).toFixed(1)}°`;
  drawGlobe();
}

function listenToViews() {
  panes.forEach(({ stage }, k) => listenToStage(stage, k));
  $("globe").onclick = chooseOnGlobe;
  $("view-number").onchange = event => {
    const view = Math.round(Number(event.target.value));
    chooseView(Math.max(0, Math.min(viewpoints().length - 1, view || 0)));
    event.target.value = state.view;
  };
}

// ---- drawing

const styles = getComputedStyle(document.documentElement);
const token = name => styles.getPropertyValue(`--${name}`);

// A pen in CSS pixels on a canvas that has as many as the screen; what was on it is gone.
function sharpPen(canvas, width, height) {
  const scale = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  return pen;
}
