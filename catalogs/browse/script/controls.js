// ---- controls: a slider per dimension, menus, tabs, background and size

const OFFERED = 400; // members in the menu at most

const percent = (d, value) => `${100 * Math.max(0, Math.min(1, (placeOf(d, value) - d.first) / width(d)))}%`;

function slide(i, value) {
  wanted[i] = value;
  chooseNearest(i, wanted, true);
}

function chooseNearest(i, values, keepSliders, allowed = () => true) {
  const { of, column } = dimensions[i];
  const found = nearest(of, candidatesOf(of, cell()), values, i, number => !Number.isNaN(column[number]) && allowed(number));
  if (found >= 0) chooseCell({ ...cell(), [of]: found }, keepSliders);
}

function step(i, sign) {
  const here = valuesOf(cell()), { column, low } = dimensions[i];
  if (Number.isNaN(here[i])) chooseNearest(i, here.with(i, low), false);
  else chooseNearest(i, here, false, number => sign * (column[number] - here[i]) > 0);
}

function addSlider(d, i) {
  const id = `parameter-${i}`;
  const name = element("span", { title: d.log && "on a logarithmic scale" }, d.name, d.unit && " ", d.unit && element("span", { class: "unit" }, `(${d.unit})`));
  const slider = element("input", {
    type: "range", id, min: d.first, max: d.last, step: "any",
    oninput: event => slide(i, valueAt(d, +event.target.value)),
    onchange: () => chooseCell(cell()), // let go: the thumbs fall on the member
    onkeydown: event => {
      const sign = { ArrowRight: 1, ArrowUp: 1, PageUp: 1, ArrowLeft: -1, ArrowDown: -1, PageDown: -1 }[event.key];
      if (!sign) return;
      event.preventDefault();
      step(i, sign);
    },
  });
  const ticks = element("div", { class: "ticks", "aria-hidden": "true" }, element("canvas"), element("i", { class: "current" }));
  $("parameters").append(element("div", { class: "parameter" }, element("label", { class: "line", for: id }, name, element("output")), slider, ticks));
}

// A tick per value that is stored, in the colour of its split; as many members as there may be, a column of pixels is drawn once.
function drawTicks(d, i) {
  const canvas = $("parameters").children[i].querySelector("canvas");
  const pixels = canvas.clientWidth, height = canvas.clientHeight;
  if (!pixels) return;
  const pen = sharpPen(canvas, pixels, height), drawn = new Uint8Array(4 * (pixels + 1));
  const colors = [...catalog.splits, "quiet"].map(token);
  for (let number = 0; number < d.column.length; number++) {
    const x = Math.round(pixels * (d.places[number] - d.first) / width(d));
    const split = d.of === "member" ? memberSplits[number] : 3;
    if (!(x >= 0) || drawn[4 * x + split]) continue;
    drawn[4 * x + split] = 1;
    pen.fillStyle = colors[split];
    pen.fillRect(Math.min(x, pixels - 2), 1, 2, 6);
  }
}

function showSliders() {
  const offered = appearancesOf(cell().member);
  dimensions.forEach((d, i) => {
    const box = $("parameters").children[i], slider = box.querySelector("input"), value = valueOf(d, cell());
    const current = box.querySelector(".current");
    slider.value = Number.isNaN(wanted[i]) ? d.first : placeOf(d, wanted[i]);
    slider.disabled = d.of === "appearance" && !offered.some(a => !Number.isNaN(d.column[a]) && d.column[a] !== value);
    slider.setAttribute("aria-valuetext", Number.isNaN(value) ? "none" : `${text(value, d)} ${d.unit}`.trim());
    box.querySelector("output").textContent = text(value, d);
    box.toggleAttribute("data-none", Number.isNaN(value));
    current.hidden = Number.isNaN(value);
    current.style.left = percent(d, value);
  });
}

function showAppearances() {
  const menu = $("appearance"), offered = appearancesOf(cell().member), numbers = offered.join();
  if (menu.dataset.offered !== numbers) {
    menu.dataset.offered = numbers;
    menu.replaceChildren(...grouped(offered, i => catalog.appearances[i].title, i => catalog.appearances[i].group));
  }
  menu.value = cell().appearance;
  menu.title = catalog.appearances[cell().appearance].title; // long titles are cut short in the menu
}

function grouped(numbers, title, groupOf) {
  const made = [], groups = new Map();
  for (const i of numbers) {
    const group = groupOf(i), option = new Option(title(i), i);
    if (!group) {
      made.push(option);
      continue;
    }
    if (!groups.has(group)) {
      groups.set(group, element("optgroup", { label: group }));
      made.push(groups.get(group));
    }
    groups.get(group).append(option);
  }
  return made;
}

const memberTitle = m => `${memberNames[m]}: ${dimensions.filter(d => d.of === "member").map(d => text(d.column[m], d)).join(", ")}`;

// The brushed members and the present one; of too many those around it.
function showMembers() {
  const menu = $("member"), here = cell().member, brushed = selection.members;
  let place = brushed.indexOf(here);
  const from = Math.max(0, Math.min((place < 0 ? 0 : place) - OFFERED / 2, brushed.length - OFFERED));
  const window = brushed.slice(from, from + OFFERED);
  const offered = place < 0 ? [here, ...window] : window, key = offered.join();
  if (menu.dataset.offered !== key) {
    menu.dataset.offered = key;
    menu.replaceChildren(...grouped(offered, memberTitle, splitOf));
  }
  menu.value = here;
  const number = place < 0 ? "not brushed" : `${(place + 1).toLocaleString("en")} of ${brushed.length.toLocaleString("en")}`;
  $("member-place").textContent = selection.brushed && place >= 0 ? `${number} brushed` : number;
  $("previous").disabled = brushed.length === 0 || place === 0;
  $("next").disabled = brushed.length === 0 || place === brushed.length - 1;
}

function stepMember(sign) {
  const brushed = selection.members, place = brushed.indexOf(cell().member);
  const next = place < 0 ? 0 : Math.max(0, Math.min(brushed.length - 1, place + sign));
  chooseCell({ ...cell(), member: brushed[next] });
}

function findMember(typed) {
  const exact = memberNames.indexOf(typed), found = exact >= 0 ? exact : memberNames.findIndex(name => name.includes(typed));
  $("find").setAttribute("aria-invalid", String(found < 0));
  if (found >= 0) chooseCell({ ...cell(), member: found });
}

function showChoices() {
  for (const key of ["background", "size"])
    for (const button of document.querySelectorAll(`button[data-${key}]`))
      button.setAttribute("aria-pressed", String(button.dataset[key] === state[key]));
  for (const k of [0, 1]) $(`side-${k}`).setAttribute("aria-pressed", String(state.active === k));
  $("side-field").hidden = $("gain-field").hidden = $("swap").hidden = state.mode !== "compare";
  $("show-field").hidden = $("cell-field").hidden = state.mode !== "grid";
  $("size-field").hidden = state.mode === "grid";
  $("gain").value = state.gain;
  $("show").value = state.show;
  $("cell").value = state.cell;
}

function showTabs() {
  markTab(document.querySelector("[role=tablist]"), `tab-${state.mode}`);
  $("view").setAttribute("aria-labelledby", `tab-${state.mode}`);
  $("view").dataset.mode = state.mode;
  $("panes").hidden = state.mode === "grid";
  $("grid").hidden = state.mode !== "grid";
}

function swapSides() {
  state.sides.reverse();
  chooseMode("compare", 1 - state.active);
}

function listenToControls() {
  $("appearance").onchange = event => chooseCell({ ...cell(), appearance: +event.target.value });
  $("member").onchange = event => chooseCell({ ...cell(), member: +event.target.value });
  $("previous").onclick = () => stepMember(-1);
  $("next").onclick = () => stepMember(1);
  $("find").onchange = event => { if (event.target.value) findMember(event.target.value); };
  for (const k of [0, 1]) $(`side-${k}`).onclick = () => chooseMode("compare", k);
  $("swap").onclick = swapSides;
  for (const key of ["background", "size"])
    for (const button of document.querySelectorAll(`button[data-${key}]`))
      button.onclick = () => { state[key] = button.dataset[key]; show(); };
  for (const key of ["gain", "cell"]) $(key).onchange = event => { state[key] = +event.target.value; show(); };
  $("show").onchange = event => { state.show = event.target.value; show(); };
}

function addChoices() {
  const choose = mode => chooseMode(mode, state.mode === mode ? state.active : 0);
  document.querySelector("header").append(tabs("View mode", "tab", "view", "one", [["one", "One picture"], ["compare", "Compare"], ["grid", "Grid"]], choose));
  dimensions.forEach(addSlider);
  $("appearance-field").hidden = catalog.appearances.length < 2;
  $("find-field").hidden = memberNames.length <= OFFERED;
  $("background-field").hidden = Boolean(catalog.background);
  for (const [value, title] of gridChoices()) $("show").append(new Option(title, value));
}
