// Mouse, fingers and keys on the picture, as changes of the orbit.

import { panned, turned, zoomed, zoomedAt } from "./orbit.js";

const STEP = Math.PI / 36; // per key

/** Let hands on `stage` move the camera; `get()` is the orbit, `set(orbit)` takes the next, `home` the first one. */
export function listen(stage, get, set, home, rest) {
  const pointers = new Map(), turn = (right, down) => set(turned(get(), right, down));
  stage.onpointerdown = event => {
    if (event.button > 2 || event.target.closest("button, input")) return;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    stage.setPointerCapture(event.pointerId);
    stage.focus({ preventScroll: true });
  };
  stage.onpointermove = event => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], side = sideOf(stage.querySelector("canvas"));
    const right = (now[0] - before[0]) / side, down = (now[1] - before[1]) / side;
    if (pointers.size === 2) pinch(event.pointerId, before, now, right, down);
    else if (event.shiftKey || event.buttons & 6) set(panned(get(), right, down));
    else turn(Math.PI * right, Math.PI * down);
    pointers.set(event.pointerId, now);
  };
  const leave = event => { if (pointers.delete(event.pointerId) && !pointers.size) rest(); };
  stage.onpointerup = stage.onpointercancel = leave;
  stage.oncontextmenu = event => event.preventDefault();
  stage.addEventListener("wheel", event => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1, factor = Math.exp(Math.max(-1, Math.min(1, 0.0015 * lines * event.deltaY)));
    set(zoomedAt(get(), factor, home, ...placeOf(event)));
  }, { passive: false });
  stage.ondblclick = event => {
    if (event.target.closest("button, input")) return;
    const [right, down] = placeOf(event);
    set(panned(get(), -right, -down));
    rest();
  };
  stage.onkeydown = event => {
    const arrow = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowDown: [0, 1], ArrowUp: [0, -1] }[event.key];
    const factor = { "+": 0.9, "=": 0.9, "-": 1 / 0.9 }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey || !(arrow || factor || event.key === "Home")) return;
    event.preventDefault();
    if (arrow && event.shiftKey) set(panned(get(), 0.03 * arrow[0], 0.03 * arrow[1]));
    else if (arrow) turn(STEP * arrow[0], STEP * arrow[1]);
    else if (factor) set(zoomed(get(), factor, home));
    else set(home);
  };

  /** [right, down] of a pointer from the middle of the picture below it, in shares of its shorter side. */
  function placeOf({ clientX, clientY, target }) {
    const picture = target.closest(".pane")?.querySelector("canvas") ?? stage.querySelector("canvas"), box = picture.getBoundingClientRect();
    return [clientX - box.left - box.width / 2, clientY - box.top - box.height / 2].map(apart => apart / sideOf(picture));
  }

  function pinch(moved, before, now, right, down) {
    const [, other] = [...pointers].find(([id]) => id !== moved);
    const apart = point => Math.max(20, Math.hypot(point[0] - other[0], point[1] - other[1]));
    set(panned(zoomed(get(), apart(before) / apart(now), home), right / 2, down / 2));
  }
}

/** Of the shorter side of what a canvas shows, in pixels of the page: a picture of another shape has margins. */
function sideOf({ clientWidth, clientHeight, width, height }) {
  return Math.max(40, Math.min(width, height) * Math.min(clientWidth / width, clientHeight / height));
}
