// ---- state: what is shown, all of it also in the address

const $ = id => document.getElementById(id);
const MODES = ["one", "compare", "grid"];
const BACKGROUNDS = ["dark", "black", "white", "checker"];
const SIZES = ["fit", "actual"];
const GAINS = [0, 1, 2, 4, 8, 16]; // of the difference; 0: it is not shown
const CELLS = [96, 160, 256];
const PATIENCE = 300; // ms between two changes of the address: browsers refuse more

const state = {
  mode: "one",
  sides: [{ member: 0, appearance: 0 }, null], // left and right; the right one when it is first looked at
  active: 0, // the side that the controls belong to
  view: 0, // among the viewpoints of the active side's member
  background: "dark", size: "fit", gain: 0,
  show: "members", cell: 160, // of the grid
  lines: true,
  brushes: [], // per axis: null, or [least, most]
};
let wanted = []; // where the sliders stand, per dimension

const side = () => state.mode === "compare" ? state.active : 0;
const cell = () => state.sides[side()];
const viewpoints = () => viewpointsOf(cell().member);

// The view of another member that is nearest to the present one: members may have cameras of their own.
function viewFor(m) {
  if (viewpointSet(m) === viewpointSet(cell().member)) return state.view;
  const point = viewpoints()[state.view];
  return nearestView(viewpointsOf(m), towards(point), upOf(point));
}

function keepToAppearances(cell) {
  const offered = appearancesOf(cell.member);
  return offered.includes(cell.appearance) ? cell : { ...cell, appearance: offered[0] };
}

function chooseCell(chosen, keepSliders = false) {
  const kept = keepToAppearances(chosen);
  state.view = viewFor(kept.member);
  state.sides[side()] = kept;
  if (!keepSliders) wanted = valuesOf(kept);
  show();
}

function chooseView(view) {
  state.view = view;
  show();
}

function chooseMode(mode, active = 0) {
  if (mode === "compare") state.sides[1] ??= opposite(state.sides[0]);
  const before = cell(), after = state.sides[mode === "compare" ? active : 0];
  if (viewpointSet(before.member) !== viewpointSet(after.member)) state.view = viewFor(after.member);
  state.mode = mode;
  state.active = active;
  wanted = valuesOf(after);
  show();
}

// What to compare with, to begin with: the member that is farthest off, or else another appearance.
function opposite(cell) {
  const own = dimensions.filter(d => d.of === "member");
  const farthest = lowest(everyMember, m => appearancesOf(m).includes(cell.appearance)
    ? -own.reduce((far, d) => far + ((d.places[m] - placeOf(d, valueOf(d, cell))) / width(d)) ** 2, 0) : 0, 0);
  const other = appearancesOf(cell.member).find(a => a !== cell.appearance);
  return farthest >= 0 ? { ...cell, member: farthest } : { ...cell, appearance: other ?? cell.appearance };
}

// ---- the address: #member=...&appearance=...&view=...

function addressFields() {
  const [left, right] = state.sides, name = a => catalog.appearances[a].name;
  const fields = { member: memberNames[left.member], appearance: name(left.appearance), view: state.view };
  const unless = (usual, key, value = state[key]) => { if (value !== usual) fields[key] = value; };
  unless("one", "mode");
  if (state.mode === "compare") {
    Object.assign(fields, { "right.member": memberNames[right.member], "right.appearance": name(right.appearance) });
    unless(0, "active");
    unless(0, "gain");
  }
  if (state.mode === "grid") {
    unless("members", "show");
    unless(160, "cell");
  }
  unless("dark", "background");
  unless("fit", "size");
  unless("on", "lines", state.lines ? "on" : "off");
  axes.forEach((axis, i) => {
    if (state.brushes[i]) fields[`in.${axis.name}`] = state.brushes[i].map(value => +value.toPrecision(9)).join("..");
  });
  return fields;
}

let writing = null, written = -PATIENCE;

function writeAddress() {
  writing ??= setTimeout(writeAddressNow, Math.max(0, written + PATIENCE - performance.now()));
}

function writeAddressNow() {
  clearTimeout(writing);
  writing = null;
  written = performance.now();
  history.replaceState(null, "", `#${new URLSearchParams(addressFields())}`);
}

function readAddress() {
  const fields = new URLSearchParams(location.hash.slice(1));
  const choice = (key, known, usual) => known.find(item => String(item) === fields.get(key)) ?? usual;
  const cellAt = (prefix, usual) => {
    const place = (key, names, otherwise) => fields.has(prefix + key) ? Math.max(0, names.indexOf(fields.get(prefix + key))) : otherwise;
    return keepToAppearances({
      member: place("member", memberNames, usual.member),
      appearance: place("appearance", catalog.appearances.map(a => a.name), usual.appearance),
    });
  };
  state.sides[0] = cellAt("", state.sides[0]);
  state.mode = choice("mode", MODES, "one");
  state.active = choice("active", [0, 1], 0);
  state.gain = choice("gain", GAINS, 0);
  if (fields.has("right.member")) state.sides[1] = cellAt("right.", state.sides[0]);
  if (state.mode === "compare") state.sides[1] ??= opposite(state.sides[0]);
  state.background = choice("background", BACKGROUNDS, "dark");
  state.size = choice("size", SIZES, "fit");
  state.show = choice("show", gridChoices().map(([value]) => value), "members");
  state.cell = choice("cell", CELLS, 160);
  state.lines = choice("lines", ["on", "off"], "on") === "on";
  state.brushes = axes.map(axis => brushFrom(fields.get(`in.${axis.name}`), axis));
  const view = Number(fields.get("view") ?? NaN), count = viewpoints().length;
  state.view = Number.isInteger(view) && view >= 0 && view < count ? view : Math.min(state.view, count - 1);
  wanted = valuesOf(cell());
}

function brushFrom(field, axis) {
  const [least, most] = (field ?? "").split("..").map(part => part ? Number(part) : NaN);
  return least <= most && most >= axis.low && least <= axis.high ? [Math.max(least, axis.low), Math.min(most, axis.high)] : null;
}
