// ---- the grid: small multiples at the present view; only those in sight are elements of the page

const LABEL = 44, GUTTER = 10; // px

let listed = { member: [], appearance: [] }; // the grid's cells
const made = new Map(); // place in the grid -> its button
let focused = 0;

const gridChoices = () => [
  ["members", "Members"],
  ...(catalog.appearances.length > 1 ? [["rows", "Members × appearances"]] : []),
  ...dimensions.map(d => [`along ${d.name}`, `Along ${d.name}`]),
];

function cellsOfGrid() {
  const here = state.sides[0];
  if (state.show === "rows") {
    return { member: selection.rows.map(row => rows.member[row]), appearance: selection.rows.map(row => rows.appearance[row]) };
  }
  const i = dimensions.findIndex(d => state.show === `along ${d.name}`);
  if (i >= 0) {
    const numbers = along(i, here), same = key => numbers.map(() => here[key]);
    if (dimensions[i].of === "appearance") return { member: same("member"), appearance: numbers };
    return { member: numbers, appearance: numbers.map(m => keepToAppearances({ ...here, member: m }).appearance) };
  }
  return { member: selection.members, appearance: selection.members.map(m => shownAppearance(m, here.appearance)) };
}

// The wanted appearance, or the first that is brushed, of a member that does not show it.
function shownAppearance(m, wantedOne) {
  const offered = appearancesOf(m);
  return offered.includes(wantedOne) ? wantedOne : offered.find(a => passes(m, a)) ?? offered[0];
}

const columns = () => Math.max(1, Math.floor(($("cells").clientWidth + GUTTER) / (state.cell + GUTTER)));
const rowHeight = () => state.cell + LABEL + GUTTER;

function showGrid() {
  if (state.mode !== "grid") return;
  const key = [state.show, state.show === "rows" ? "" : state.sides[0].appearance, selection.version,
    state.show.startsWith("along") ? state.sides[0].member : ""].join(" ");
  if ($("grid").dataset.key !== key) {
    $("grid").dataset.key = key;
    listed = cellsOfGrid();
    focused = 0;
  }
  const count = listed.member.length;
  $("grid-count").textContent = `${count.toLocaleString("en")} picture${count === 1 ? "" : "s"} at view ${state.view}`;
  $("cells").style.height = `${Math.ceil(count / columns()) * rowHeight()}px`;
  fillGrid();
}

function fillGrid() {
  const across = columns(), top = $("grid").scrollTop - $("cells").offsetTop;
  const from = Math.max(0, Math.floor(top / rowHeight()) - 1) * across;
  const to = Math.min(listed.member.length, (Math.ceil((top + $("grid").clientHeight) / rowHeight()) + 1) * across);
  for (const [place, button] of made)
    if (place < from || place >= to) {
      button.remove();
      made.delete(place);
    }
  for (let place = from; place < to; place++) placeCell(place, across);
}

function placeCell(place, across) {
  const shown = { member: listed.member[place], appearance: listed.appearance[place] };
  let button = made.get(place);
  if (!button) {
    button = newCell(place);
    made.set(place, button);
    $("cells").append(button);
  }
  button.style.left = `${(place % across) * (state.cell + GUTTER)}px`;
  button.style.top = `${Math.floor(place / across) * rowHeight()}px`;
  button.style.width = `${state.cell}px`;
  button.tabIndex = place === focused ? 0 : -1;
  const here = state.sides[0];
  button.toggleAttribute("aria-current", shown.member === here.member && shown.appearance === here.appearance);
  const frame = button.querySelector(".frame"), image = button.querySelector("img"), address = addressOf(shown, viewFor(shown.member));
  frame.dataset.background = state.background;
  frame.style.height = `${state.cell}px`;
  if (catalog.background) frame.style.background = catalog.background;
  if (image.getAttribute("src") !== address) image.src = address;
  button.querySelector(".name").textContent = cellTitle(shown);
  button.querySelector(".values").textContent = cellValues(shown);
  button.querySelector("i").className = splitOf(shown.member);
  button.title = [memberTitle(shown.member), catalog.appearances[shown.appearance].title, splitOf(shown.member)].join("; ");
  button.setAttribute("aria-label", button.title);
}

function cellTitle(shown) {
  const d = dimensions.find(each => state.show === `along ${each.name}`);
  return d ? `${d.name} ${text(valueOf(d, shown), d)}` : memberNames[shown.member];
}

function cellValues(shown) {
  if (state.show === "rows") return catalog.appearances[shown.appearance].title;
  if (state.show !== "members") return memberNames[shown.member];
  return dimensions.filter(d => d.of === "member").map(d => text(valueOf(d, shown), d)).join(", ");
}

function newCell(place) {
  const image = element("img", {
    alt: "", decoding: "async", onerror: () => { frame.dataset.missing = "missing or damaged"; }, onload: () => { delete frame.dataset.missing; },
  });
  const frame = element("span", { class: "frame" }, image);
  return element("button", { class: "cell", onclick: () => openCell(place), onkeydown: event => moveInGrid(event, place) },
    frame, element("span", { class: "name" }), element("i"), element("span", { class: "values" }));
}

function openCell(place) {
  const chosen = { member: listed.member[place], appearance: listed.appearance[place] };
  state.view = viewFor(chosen.member);
  state.sides[0] = chosen;
  chooseMode("one");
  panes[0].stage.focus({ preventScroll: true });
}

function moveInGrid(event, place) {
  const across = columns(), page = across * Math.max(1, Math.floor($("grid").clientHeight / rowHeight()));
  const to = {
    ArrowRight: place + 1, ArrowLeft: place - 1, ArrowDown: place + across, ArrowUp: place - across,
    PageDown: place + page, PageUp: place - page, Home: 0, End: listed.member.length - 1,
  }[event.key];
  if (to === undefined) return;
  event.preventDefault();
  focused = Math.max(0, Math.min(listed.member.length - 1, to));
  const top = $("cells").offsetTop + Math.floor(focused / across) * rowHeight();
  const visible = $("grid");
  if (top < visible.scrollTop) visible.scrollTop = top;
  if (top + rowHeight() > visible.scrollTop + visible.clientHeight) visible.scrollTop = top + rowHeight() - visible.clientHeight;
  fillGrid();
  made.get(focused).focus({ preventScroll: true });
}

function listenToGrid() {
  $("grid").onscroll = fillGrid;
}
