// ---- axes and brushes: drag on an axis, or move the two ends of its brush by keys or as numbers

const GRIP = 10; // px around an end of a brush
const BOTH = [1, 1]; // ends of a brush that move

function addAxis(axis, i) {
  const title = (axis.unit ? `${axis.name} (${axis.unit})` : axis.name) + (axis.log ? ", on a logarithmic scale" : "");
  const labels = axis.categories?.map((category, k) => element("div", { class: "category", "data-at": k, title: category }, category))
    ?? [element("div", { class: "most" }, text(axis.high, axis)), element("div", { class: "least" }, text(axis.low, axis))];
  const box = element("div", { class: "axis" }, element("div", { class: "axis-name", title }, axis.name), element("div", { class: "brush" }), ...labels,
    axis.column.some(Number.isNaN) && element("div", { class: "none" }, "none"), ...["least", "most"].map((which, end) => newHandle(axis, i, end, which)));
  listenToAxis(box, axis, i);
  $("plot").append(box);
  if (!axis.categories) addLimits(axis, i);
}

function newHandle(axis, i, end, which) {
  const onkeydown = event => {
    const unitStep = axis.categories ? 1 : width(axis) / 100, large = axis.categories ? 1 : 10 * unitStep;
    const [least, most] = rangeOf(i).map(value => placeOf(axis, value)), here = end ? most : least;
    const to = {
      ArrowUp: here + unitStep, ArrowRight: here + unitStep, ArrowDown: here - unitStep, ArrowLeft: here - unitStep,
      PageUp: here + large, PageDown: here - large, Home: axis.first, End: axis.last, Escape: end ? axis.last : axis.first,
    }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    brushPlaces(i, end ? [least, Math.max(least, to)] : [Math.min(to, most), most]);
  };
  const label = `${axis.name}, ${which} of the brush`;
  return element("div", { class: "handle", "data-end": which, tabindex: 0, role: "slider", "aria-orientation": "vertical", "aria-label": label, onkeydown });
}

const rangeOf = i => state.brushes[i] ?? [axes[i].low, axes[i].high];

// Values or categories from one to another: nothing where that is the whole axis.
function brush(i, range) {
  const { low, high } = axes[i], slack = 1e-9 * (high - low);
  const [least, most] = range.map(value => Math.max(low, Math.min(high, value)));
  state.brushes[i] = least <= low + slack && most >= high - slack ? null : [least, most];
  brushed();
}

const brushPlaces = (i, range) => brush(i, range.map(place => valueAt(axes[i], place)));

function clearBrushes() {
  state.brushes.fill(null);
  brushed();
}

let due = false;

// Drags come more often than frames.
function brushed() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    select();
    drawSelected();
    show();
  });
}

const snapped = (axis, [least, most]) => axis.categories
  ? [Math.round(least + 0.5) - 0.5, Math.max(Math.round(most + 0.5) - 0.5, Math.round(least + 0.5) + 0.5)] : [least, most];

function listenToAxis(box, axis, i) {
  let drag = null; // {from, range, moves}: from where, which brush was there, which of its ends are moved
  const at = event => axisPlace(axis, event.clientY - $("plot").getBoundingClientRect().top);
  box.onpointerdown = event => {
    if (event.button !== 0) return;
    const value = at(event), grip = GRIP * width(axis) / (plot.height - MARGIN.top - MARGIN.bottom);
    const range = state.brushes[i]?.map(end => placeOf(axis, end)) ?? null, near = end => range && Math.abs(range[end] - value) <= grip;
    const inside = range && value > range[0] && value < range[1];
    const moves = near(1) ? [0, 1] : near(0) ? [1, 0] : inside ? BOTH : null;
    drag = { from: value, range, moves, moved: false };
    box.setPointerCapture(event.pointerId);
    event.preventDefault();
  };
  box.onpointermove = event => {
    if (!drag) return;
    const value = at(event);
    let by = value - drag.from;
    drag.moved ||= Math.abs(by) > 0.01 * width(axis);
    if (!drag.moved) return;
    if (drag.moves === BOTH) by = Math.max(axis.first - drag.range[0], Math.min(axis.last - drag.range[1], by));
    const ends = drag.moves ? drag.range.map((end, k) => end + drag.moves[k] * by) : [drag.from, value];
    brushPlaces(i, snapped(axis, ends.sort((a, b) => a - b)));
  };
  box.onpointerup = event => {
    if (drag && !drag.moved) {
      // A click on a category brushes it; anywhere else it takes the brush away.
      const value = at(event), whole = snapped(axis, [value - 0.49, value - 0.49]);
      const same = drag.range && drag.range[0] === whole[0] && drag.range[1] === whole[1];
      brushPlaces(i, axis.categories && !same ? whole : [axis.first, axis.last]);
    }
    drag = null;
  };
  box.onpointercancel = () => { drag = null; };
}

function addLimits(axis, i) {
  const changed = (end, typed) => {
    const range = [...rangeOf(i)];
    range[end] = typed === "" ? (end ? axis.high : axis.low) : +typed;
    brush(i, range.sort((a, b) => a - b));
  };
  const [from, to] = ["from", "to"].map((which, end) => element("input", {
    type: "number", step: "any", min: axis.low, max: axis.high, "aria-label": `${axis.name} ${which}`, onchange: event => changed(end, event.target.value),
  }));
  $("limits").append(element("div", { class: "limits", "data-axis": i }, element("span", {}, axis.unit ? `${axis.name} (${axis.unit})` : axis.name), from, "to", to));
}

function placeAxes() {
  document.querySelectorAll(".axis").forEach((box, i) => {
    const axis = axes[i];
    box.style.left = `${plot.x[i]}px`;
    for (const label of box.querySelectorAll(".category")) label.style.top = `${axisY(axis, +label.dataset.at)}px`;
  });
}

const categoryAt = (axis, value) => axis.categories[Math.max(0, Math.min(axis.categories.length - 1, Math.round(value)))];

function showBrushes() {
  document.querySelectorAll(".axis").forEach((box, i) => {
    const axis = axes[i], range = rangeOf(i), [bottom, top] = range.map(value => axisY(axis, value));
    box.toggleAttribute("data-brushed", Boolean(state.brushes[i]));
    const shade = box.querySelector(".brush");
    shade.style.top = `${top}px`;
    shade.style.height = `${bottom - top}px`;
    box.querySelectorAll(".handle").forEach((handle, end) => {
      handle.style.top = `${end ? top : bottom}px`;
      Object.assign(handle, {
        ariaValueMin: axis.low, ariaValueMax: axis.high, ariaValueNow: range[end],
        ariaValueText: axis.categories ? categoryAt(axis, range[end] + (end ? -0.5 : 0.5)) : `${text(range[end], axis)} ${axis.unit}`.trim(),
      });
    });
  });
  for (const line of $("limits").children)
    [...line.querySelectorAll("input")].forEach((input, end) => {
      if (document.activeElement !== input) input.value = text(rangeOf(+line.dataset.axis)[end], axes[+line.dataset.axis]);
    });
  const lines = `line${rows.count === 1 ? "" : "s"}`, all = rows.count.toLocaleString("en");
  const part = selection.brushed ? `${selection.rows.length.toLocaleString("en")} of ` : "";
  $("line-count").textContent = `${part}${all} ${lines}${selection.brushed ? " brushed" : ""}`;
  $("reset").disabled = !selection.brushed;
}

function showLines() {
  $("lines-body").hidden = !state.lines;
  $("lines-toggle").setAttribute("aria-expanded", String(state.lines));
  $("lines").dataset.open = String(state.lines);
  if (!state.lines || $("lines").hidden) return;
  if ($("plot").clientWidth !== plot.width || $("plot").clientHeight !== plot.height) {
    layOut();
    placeAxes();
    drawBackdrop();
    drawSelected();
  }
  showBrushes();
  drawMarked();
}
