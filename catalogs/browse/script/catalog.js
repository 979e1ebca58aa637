// ---- the catalog, in columns: members and appearances go by their numbers

const catalog = JSON.parse(document.getElementById("catalog").textContent);
const HANDLED = 4; // a parameter under the hand counts this much more in "nearest"
const ALONG = 12; // pictures along a parameter whose members lie on no grid

const { names: memberNames } = catalog.members;
const memberSplits = Uint8Array.from(catalog.members.splits, Number);
const viewSplits = catalog.view_splits.map(digits => Uint8Array.from(digits, Number));
const everyMember = Int32Array.from(memberNames, (_, i) => i);
const appearancesOf = m => catalog.appearance_sets[catalog.members.appearances ? catalog.members.appearances[m] : 0];
const viewpointSet = m => catalog.members.viewpoints ? catalog.members.viewpoints[m] : 0;
const viewpointsOf = m => catalog.viewpoints[viewpointSet(m)];
const towards = point => point.slice(0, 3);
const upOf = point => point.slice(3, 6);
const splitOf = m => catalog.splits[memberSplits[m]];
const text = (value, d) => Number.isNaN(value) ? "–" : String(+(+value).toPrecision(precision(value, d.high - d.low, 6)));

const addressOf = (cell, view) =>
  ["members", memberNames[cell.member], catalog.appearances[cell.appearance].name, catalog.files[view]]
    .map(encodeURIComponent).join("/");

// Sliders, axes and distances go by places on a dimension's scale: the values themselves, or their logarithms.
const placeOf = (d, value) => d.log ? Math.log10(value) : value;
const valueAt = (d, place) => d.log ? 10 ** place : place;
const width = d => d.last - d.first;

// A dimension is a parameter of simulations (a value per member) or of visualizations (a value per appearance, or NaN).
const dimensions = [
  ...catalog.parameters.map((p, i) => dimension(p, "member", catalog.members.values[i])),
  ...catalog.visualization.map(p => dimension(p, "appearance", p.values)),
];

function dimension({ name, unit, low, high, scale }, of, values) {
  const column = Float64Array.from(values, value => value ?? NaN);
  for (const value of column) {
    if (value < low) low = value; // members out of bounds are recorded all the same
    if (value > high) high = value;
  }
  const d = { name, unit, of, column, low, high, log: scale === "log" };
  return { ...d, places: d.log ? column.map(Math.log10) : column, first: placeOf(d, low), last: placeOf(d, high) };
}

const valueOf = (dimension, cell) => dimension.column[cell[dimension.of]];
const valuesOf = cell => dimensions.map(d => valueOf(d, cell));

function gap(a, b) {
  const missing = Number.isNaN(a) + Number.isNaN(b);
  return missing === 0 ? a - b : missing === 1 ? 1 : 0;
}

// Which of the items has the least of a measure that is below `least`; -1 for none.
function lowest(items, measure, least = Infinity) {
  let best = -1;
  for (const item of items) {
    const far = measure(item);
    if (far < least) { least = far; best = item; }
  }
  return best;
}

// Of the members or appearances `numbers` that nearest to the wanted values of all dimensions of its kind; -1 for none.
function nearest(kind, numbers, wanted, handled, allowed = () => true) {
  const compared = dimensions.flatMap((d, i) => d.of === kind
    ? [{ places: d.places, at: placeOf(d, wanted[i]) / width(d), scale: 1 / width(d), weight: i === handled ? HANDLED : 1 }] : []);
  return lowest(numbers, number => {
    let far = 0;
    for (const { places, at, scale, weight } of compared) far += weight * gap(places[number] * scale, at) ** 2;
    return allowed(number) ? far : Infinity;
  });
}

const candidatesOf = (kind, cell) => kind === "member" ? everyMember : appearancesOf(cell.member);

// The members or appearances that differ from the cell's in one dimension only; where these are few, those nearest to a line along it.
function along(i, cell) {
  const d = dimensions[i], { of, column } = d, values = valuesOf(cell), candidates = candidatesOf(of, cell);
  const others = dimensions.filter((other, k) => k !== i && other.of === of);
  const same = number => others.every(d => Math.abs(gap(d.places[number], placeOf(d, valueOf(d, cell)))) <= 1e-6 * width(d));
  let found = [...candidates].filter(number => !Number.isNaN(column[number]) && same(number));
  if (found.length < 3) {
    const targets = Array.from({ length: ALONG }, (_, k) => valueAt(d, d.first + width(d) * k / (ALONG - 1)));
    const here = Number.isNaN(values[i]) ? [] : [cell[of]];
    found = [...new Set([...here, ...targets.map(target =>
      nearest(of, candidates, values.with(i, target), i, number => !Number.isNaN(column[number])))])].filter(number => number >= 0);
  }
  return found.sort((a, b) => column[a] - column[b]);
}

// Every member in every appearance that it has: a line of the parallel coordinates each.
const rows = (() => {
  let count = 0;
  for (const m of everyMember) count += appearancesOf(m).length;
  const member = new Int32Array(count), appearance = new Int32Array(count);
  let row = 0;
  for (const m of everyMember)
    for (const a of appearancesOf(m)) { member[row] = m; appearance[row++] = a; }
  return { count, member, appearance };
})();

// Two pictures may be taken from one place with the camera rolled: `up` decides between those only.
function nearestView(points, direction, up) {
  return lowest(points.keys(), i => -dot(points[i], direction) - 1e-3 * dot(upOf(points[i]), up));
}
