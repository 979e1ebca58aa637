// ---- all together

function show() {
  showTabs();
  showPanes();
  showDifference();
  showSliders();
  showAppearances();
  showMembers();
  showChoices();
  showView();
  showGrid();
  showLines();
  writeAddress();
}

function fitWindow() {
  dimensions.forEach(drawTicks);
  show();
}

function start() {
  document.title = $("title").textContent = catalog.title;
  const count = (n, word) => `${n.toLocaleString("en")} ${word}${n === 1 ? "" : "s"}`;
  $("counts").textContent = [
    count(memberNames.length, "member"), count(catalog.appearances.length, "appearance"), count(catalog.files.length, "view"),
  ].join(", ");
  if (!memberNames.length) {
    say("The catalog has no members yet.");
    document.body.dataset.empty = "true";
    return;
  }
  addChoices();
  axes.forEach(addAxis);
  $("plot").style.setProperty("--axes", axes.length);
  if (rows.count < 2) $("lines").hidden = true;
  // Without an address: the first training member, from the side, a little above.
  state.sides[0].member = Math.max(0, memberSplits.indexOf(0));
  state.sides[0] = keepToAppearances(state.sides[0]);
  state.view = nearestView(viewpoints(), unit([1, -0.6, 0.5]), [0, 0, 1]);
  readAddress();
  select();
  listenToViews();
  listenToControls();
  listenToGrid();
  listenToLines();
  $("reset").onclick = clearBrushes;
  $("lines-toggle").onclick = () => { state.lines = !state.lines; show(); };
  window.onhashchange = () => { readAddress(); brushed(); };
  window.onpagehide = document.onvisibilitychange = writeAddressNow;
  new ResizeObserver(fitWindow).observe(document.body);
  fitWindow();
}

start();
