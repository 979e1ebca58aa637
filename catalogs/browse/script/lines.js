// ---- parallel coordinates: a line per member and appearance; those outside the brushes are grey

const BUDGET = 8; // ms of a frame for drawing lines
const BATCH = 256; // lines per stroke
const REACH = 14; // px from the pointer to a line
const MARGIN = { top: 46, bottom: 40, side: 56 };
const CATEGORIES = 12; // on an axis at most
const NONE = 16; // px below an axis: lines of appearances that have no such value

const kinds = [...new Set(catalog.appearances.map(a => a.kind))];
const presentSplits = catalog.splits.filter((_, i) => memberSplits.includes(i));

// An axis is a dimension, or has categories 0, 1, ...
const axes = [
  ...dimensions,
  ...categories("appearance", "appearance", kinds, catalog.appearances.map(a => kinds.indexOf(a.kind))),
  ...categories("split", "member", presentSplits, memberSplits.map(i => presentSplits.indexOf(catalog.splits[i]))),
];

// The first category is at the top.  A single one needs no axis, and too many can't be distinguished on one.
function categories(name, of, names, numbers) {
  if (names.length < 2 || names.length > CATEGORIES) return [];
  const column = Float64Array.from(numbers, number => names.length - 1 - number);
  const low = -0.5, high = names.length - 0.5;
  return [{ name, unit: "", of, column, places: column, low, high, first: low, last: high, categories: names.toReversed() }];
}

// ---- what the brushes select

const everyRow = Int32Array.from({ length: rows.count }, (_, row) => row);
const selection = { version: 0, brushed: false, mask: new Uint8Array(rows.count).fill(1), rows: everyRow, members: everyMember };

function passes(m, a) {
  const of = { member: m, appearance: a };
  return axes.every((axis, i) => {
    const value = axis.column[of[axis.of]], [least, most] = state.brushes[i] ?? [-Infinity, Infinity];
    return !state.brushes[i] || (value >= least && value <= most);
  });
}

function select() {
  const { mask } = selection, memberIn = new Uint8Array(memberNames.length);
  mask.fill(1);
  axes.forEach((axis, i) => {
    if (!state.brushes[i]) return;
    const [least, most] = state.brushes[i], { column } = axis, index = rows[axis.of];
    for (let row = 0; row < rows.count; row++) {
      const value = column[index[row]];
      if (!(value >= least && value <= most)) mask[row] = 0;
    }
  });
  const selected = everyRow.filter(row => mask[row]);
  for (const row of selected) memberIn[rows.member[row]] = 1;
  Object.assign(selection, {
    version: selection.version + 1, brushed: state.brushes.some(Boolean), rows: selected, members: everyMember.filter(m => memberIn[m]),
  });
}

// ---- where lines run

const plot = { width: 0, height: 0, x: [], y: [] }; // y: per axis a column like the axis' own, in px

const axisY = (axis, value) => {
  const bottom = plot.height - MARGIN.bottom;
  return Number.isNaN(value) ? bottom + NONE : bottom - (bottom - MARGIN.top) * (placeOf(axis, value) - axis.first) / width(axis);
};

function axisPlace(axis, y) {
  const bottom = plot.height - MARGIN.bottom, part = (bottom - y) / (bottom - MARGIN.top);
  return axis.first + part * width(axis); // beyond the axis too
}

function layOut() {
  const { clientWidth, clientHeight } = $("plot");
  Object.assign(plot, { width: clientWidth, height: clientHeight });
  const between = (clientWidth - 2 * MARGIN.side) / Math.max(1, axes.length - 1);
  $("plot").style.setProperty("--between", `${between}px`);
  plot.x = axes.map((_, i) => axes.length === 1 ? clientWidth / 2 : MARGIN.side + i * between);
  plot.y = axes.map(axis => Float32Array.from(axis.column, value => axisY(axis, value)));
}

const lineY = (i, row) => plot.y[i][rows[axes[i].of][row]];

function trace(pen, row) {
  for (let i = 0; i < axes.length; i++) {
    const x = plot.x[i], y = lineY(i, row);
    if (i) pen.lineTo(x, y); else pen.moveTo(axes.length === 1 ? x - 12 : x, y);
  }
  if (axes.length === 1) pen.lineTo(plot.x[0] + 12, lineY(0, row));
}

// ---- drawing, a batch per stroke and a few milliseconds per frame, in an order that looks like the whole from the start

const shuffled = (() => {
  const order = everyRow.slice();
  let seed = 1;
  for (let i = order.length - 1; i > 0; i--) {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    const k = seed % (i + 1);
    [order[i], order[k]] = [order[k], order[i]];
  }
  return order;
})();

const opacity = count => Math.min(0.9, Math.max(0.05, 9 / Math.sqrt(count || 1)));

function* strokes(pen, colorOf, colors) {
  const batches = colors.map(() => []);
  const stroke = color => {
    pen.strokeStyle = colors[color];
    pen.beginPath();
    for (const row of batches[color]) trace(pen, row);
    pen.stroke();
    batches[color] = [];
  };
  for (const row of shuffled) {
    const color = colorOf(row);
    if (color < 0 || batches[color].push(row) < BATCH) continue;
    stroke(color);
    yield;
  }
  for (let color = 0; color < colors.length; color++) stroke(color);
}

const jobs = new Map(); // layer -> what is left to stroke

function drawLayer(layer, count, colorOf, colors) {
  const pen = sharpPen($(layer), plot.width, plot.height);
  pen.lineWidth = 1;
  pen.globalAlpha = opacity(count);
  if (!jobs.size) requestAnimationFrame(goOn);
  jobs.set(layer, strokes(pen, colorOf, colors));
  $("plot").setAttribute("aria-busy", "true");
}

function goOn() {
  const ends = performance.now() + BUDGET;
  for (const [layer, work] of jobs)
    while (performance.now() < ends)
      if (work.next().done) {
        jobs.delete(layer);
        break;
      }
  if (jobs.size) requestAnimationFrame(goOn);
  else $("plot").setAttribute("aria-busy", "false");
}

function drawBackdrop() {
  drawLayer("every-line", rows.count, () => 0, [token("line")]);
}

function drawSelected() {
  drawLayer("brushed-lines", selection.rows.length, row => selection.mask[row] ? memberSplits[rows.member[row]] : -1, catalog.splits.map(token));
}

// ---- the present line, and the one under the pointer

let hovered = -1;

// Rows lie in the order of members.
const rowOf = ({ member, appearance }) => rows.appearance.indexOf(appearance, rows.member.indexOf(member));

function drawMarked() {
  const pen = sharpPen($("marked-lines"), plot.width, plot.height);
  const marks = [...(state.mode === "compare" ? state.sides : [cell()]).map(seen => [rowOf(seen), "ink"]), [hovered, "accent"]];
  for (const [row, color] of marks) {
    if (row < 0) continue;
    pen.lineWidth = 2;
    pen.strokeStyle = token(color);
    pen.beginPath();
    trace(pen, row);
    pen.stroke();
  }
}

function nearestLine(x, y) {
  let i = plot.x.findLastIndex(at => at <= x);
  if (axes.length > 1) i = Math.max(0, Math.min(axes.length - 2, i));
  const k = Math.min(i + 1, axes.length - 1), part = k === i ? 0 : Math.max(0, Math.min(1, (x - plot.x[i]) / (plot.x[k] - plot.x[i])));
  return lowest(selection.rows, row => Math.abs(lineY(Math.max(0, i), row) * (1 - part) + lineY(k, row) * part - y), REACH);
}

function rowTitle(row) {
  const seen = { member: rows.member[row], appearance: rows.appearance[row] };
  const values = dimensions.filter(d => !Number.isNaN(valueOf(d, seen))).map(d => `${d.name} ${text(valueOf(d, seen), d)}`);
  const look = catalog.appearances.length > 1 ? [catalog.appearances[seen.appearance].name] : [];
  return [memberNames[seen.member], ...look, ...values].join(", ");
}

function hover(row) {
  if (row === hovered) return;
  hovered = row;
  $("line-title").textContent = row < 0 ? "" : rowTitle(row);
  $("plot").style.cursor = row < 0 ? "" : "pointer";
  drawMarked();
}

function listenToLines() {
  const plotArea = $("plot"), position = event => {
    const box = plotArea.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  plotArea.onpointermove = event => { if (!event.target.closest(".axis")) hover(nearestLine(...position(event))); else hover(-1); };
  plotArea.onpointerleave = () => hover(-1);
  plotArea.onclick = event => {
    if (event.target.closest(".axis")) return;
    const row = nearestLine(...position(event));
    if (row >= 0) chooseCell({ member: rows.member[row], appearance: rows.appearance[row] });
  };
}
