// Plays a parameter: from where it stands to its upper bound, back to the lower one, and so on, until it is stopped.

import { button } from "../web/elements.js";

const ONE_WAY = 6000; // milliseconds

/** A button that plays; `get()` and `set(share)` are the place between the bounds, 0 to 1.  Returns { box, stop() }. */
export function player(title, get, set) {
  const box = button("▶", () => timer ? stop() : start(), { class: "play", "aria-label": `Play ${title}`, "aria-pressed": false });
  let timer = 0, direction = 1, before = 0;

  function start() {
    [direction, before] = [get() < 1 ? 1 : -1, performance.now()];
    show(true);
    timer = requestAnimationFrame(step);
  }

  function step(now) {
    if (!box.isConnected) {
      timer = 0;
      return;
    }
    const share = get() + direction * (now - before) / ONE_WAY;
    before = now;
    if (share <= 0 || share >= 1) direction = share <= 0 ? 1 : -1;
    set(Math.max(0, Math.min(1, share)));
    timer = requestAnimationFrame(step);
  }

  function stop() {
    cancelAnimationFrame(timer);
    timer = 0;
    show(false);
  }

  function show(playing) {
    box.textContent = playing ? "❚❚" : "▶";
    box.setAttribute("aria-pressed", playing);
  }

  return { box, stop };
}
