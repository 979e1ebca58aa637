// ---- pictures: fetched and decoded before they replace what is on the screen

const KEPT = 400; // pictures prefetched and kept decoded at most

const decoded = new Map(); // address -> Image, oldest first

function fetched(address) {
  const image = decoded.get(address) ?? Object.assign(new Image(), { src: address });
  decoded.delete(address);
  decoded.set(address, image);
  if (decoded.size > KEPT) decoded.delete(decoded.keys().next().value);
  return image;
}

async function decodedPicture(address) {
  const image = fetched(address);
  try {
    await image.decode();
  } catch {
    decoded.delete(address);
    throw new Error(`${decodeURIComponent(address)} can't be shown: it is missing or damaged.`);
  }
  return image;
}

const panes = [...document.querySelectorAll(".pane[data-side]")].map(pane => ({
  pane,
  stage: pane.querySelector(".stage"),
  picture: pane.querySelector(".picture"),
  message: pane.querySelector(".message"),
  caption: pane.querySelector(".caption"),
  wanted: "",
}));

function say(message, pane = panes[0]) {
  pane.message.textContent = message;
  pane.message.hidden = !message;
}

async function showPicture(pane, cell, view) {
  const address = addressOf(cell, view);
  if (pane.wanted === address) return;
  pane.wanted = address;
  pane.stage.setAttribute("aria-busy", "true");
  let problem = "";
  try { await decodedPicture(address); } catch (error) { problem = error.message; }
  if (pane.wanted !== address) return; // something newer is on its way
  say(problem, pane);
  pane.picture.hidden = Boolean(problem);
  if (!problem) {
    pane.picture.src = address;
    prefetchAround(cell, view);
  }
  pane.stage.setAttribute("aria-busy", "false");
}

function prefetchAround(cell, view) {
  const points = viewpointsOf(cell.member), here = towards(points[view]);
  points.map((point, i) => [dot(point, here), i]).sort((a, b) => b[0] - a[0]).slice(1, 9)
    .forEach(([, near]) => fetched(addressOf(cell, near)));
}

const badge = (split, of) => element("span", { class: `badge ${split}` }, `${split} ${of}`);

// What is seen: the member's name, its parameters, the appearance where there are several, the view, and the splits.
function captionOf(cell, view) {
  const shown = dimensions.filter(d => !Number.isNaN(valueOf(d, cell)));
  return [
    element("b", {}, memberNames[cell.member]),
    ...shown.map(d => element("span", {}, `${d.name} `, element("b", {}, text(valueOf(d, cell), d)), d.unit && ` ${d.unit}`)),
    catalog.appearances.length > 1 && element("span", {}, catalog.appearances[cell.appearance].name), element("span", {}, `view ${view}`),
    badge(splitOf(cell.member), "member"), badge(catalog.splits[viewSplits[viewpointSet(cell.member)][view]], "view"),
  ].filter(Boolean);
}

// The explorer at these parameters, this appearance and this view: what it can't show of them it names.
function explorerAddress(cell, view) {
  const fields = new URLSearchParams(), shown = dimensions.filter(d => !Number.isNaN(valueOf(d, cell)));
  for (const d of shown.filter(({ of }) => of === "member")) fields.set(`a.p.${d.name}`, valueOf(d, cell));
  const of = Object.fromEntries(shown.filter(d => d.of === "appearance").map(d => [d.name, valueOf(d, cell)]));
  const show = (kind, name, value) => { fields.set("a.show", kind); fields.set(`a.${name}`, value); };
  if ("isovalue" in of) show("isovalue", "isovalue", of.isovalue);
  else if (!Object.keys(of).length && cell.appearance) show("field", "appearance", catalog.appearances[cell.appearance].name);
  for (const point of ["c1", "c2"]) {
    if (`${point}_value` in of) fields.set(`a.${point}`, `${of[`${point}_value`]},${of[`${point}_opacity`]}`);
  }
  fields.set("camera", viewpointsOf(cell.member)[view].join(","));
  return `${catalog.explorer}#${fields}`;
}

function showPanes() {
  const shown = state.mode === "compare" ? [0, 1] : [0];
  panes.forEach((pane, k) => {
    pane.pane.hidden = !shown.includes(k);
    if (pane.pane.hidden) return;
    const seen = state.sides[k], view = viewFor(seen.member);
    pane.caption.replaceChildren(...captionOf(seen, view));
    pane.picture.alt = [...pane.caption.children].map(part => part.textContent).join(", ");
    if (catalog.explorer) pane.caption.append(element("a", { href: explorerAddress(seen, view) }, "Explore"));
    pane.stage.dataset.background = state.background;
    pane.stage.dataset.size = state.size;
    if (catalog.background) pane.stage.style.background = catalog.background;
    if (state.mode === "compare") pane.pane.dataset.active = String(k === state.active);
    else delete pane.pane.dataset.active;
    showPicture(pane, seen, view);
  });
}
