// States that are kept beside the stage: seen again at a click, played one after the other, saved as a film or as a session.

import { button, element, menu } from "../web/elements.js";
import { addressOf, stateOf } from "./address.js";
import { group } from "./groups.js";
import { journey, stateBetween } from "./journey.js";
import { saveFile } from "./making.js";
import { cameraOf } from "./orbit.js";
import { current, messageOf } from "./state.js";
import { described } from "./words.js";

const SIDE = 72; // pixels of a small picture
const SECONDS = 2, RATE = 24, MOST_FRAMES = 480; // from one to the next; frames a second and of a film, which the program takes
const MOST_BYTES = 1e6; // of a session

/** The panel: { box, stop() }; `explorer.snapshots` are { address, picture } and outlive it. */
export function snapshotsPanel(explorer) {
  const { facts } = explorer, kept = explorer.snapshots ??= [];
  const list = element("ul", { class: "snapshots" });
  const state = ({ address }) => stateOf(address, facts).state;
  let playing = 0;

  const keep = button("Keep this", () => {
    kept.push({ address: addressOf(explorer.state, facts), picture: smallOf(explorer.panes[0].canvas) });
    show();
  }, { id: "keep" });
  const play = button("Play", () => playing ? stop() : start(), { id: "play-snapshots", "aria-pressed": false });
  const form = menu("Film", "journey-form", "mp4", [["mp4", "MP4"], ["gif", "GIF"]]);
  const film = facts.exports ? null : explorer.making.button("Save film", "save-journey", filmOf, () => kept.length > 1);
  const session = button("Save session", () => saveFile({ name: `${facts.title}-session.json`, blob: new Blob([JSON.stringify(kept.map(({ address }) => address), null, 1)], { type: "application/json" }) }), { id: "save-session" });
  const file = element("input", { type: "file", accept: "application/json", id: "open-session", onchange: () => open(file.files[0]) });

  function show() {
    list.replaceChildren(...kept.map((one, i) => element("li", {},
      element("button", { type: "button", class: "snapshot", onclick: () => go(one), title: described(current(state(one)), facts), "aria-label": `Show snapshot ${i + 1}: ${described(current(state(one)), facts)}` }, one.picture ?? `${i + 1}`),
      button("×", () => { kept.splice(i, 1); show(); }, { class: "plain", "aria-label": `Remove snapshot ${i + 1}` }))));
    for (const needy of [play, form.querySelector("select")]) needy.disabled = kept.length < 2;
    explorer.making.enable();
    session.disabled = !kept.length;
  }

  function go({ address }) { location.hash = address; }

  function start() {
    const stops = kept.map(state), began = performance.now();
    play.setAttribute("aria-pressed", true);
    playing = requestAnimationFrame(step);

    function step(now) {
      const seconds = Math.max(0, now - began) / 1000, place = Math.min(seconds / SECONDS, stops.length - 1), i = Math.min(Math.floor(place), stops.length - 2);
      if (!play.isConnected) return;
      explorer.travel(stateBetween(stops[i], stops[i + 1], place - i, facts));
      if (place < stops.length - 1) playing = requestAnimationFrame(step);
      else stop();
    }
  }

  function stop() {
    cancelAnimationFrame(playing);
    playing = 0;
    play.setAttribute("aria-pressed", false);
  }

  /** The request of a film through all that is kept. */
  function filmOf() {
    const kind = form.querySelector("select").value, steps = Math.min(SECONDS * RATE, Math.floor((MOST_FRAMES - 1) / (kept.length - 1)));
    const { size, background, annotations } = explorer.exportable("png", 1);
    const frames = journey(kept.map(state), steps, facts).map(one => ({ setting: messageOf(current(one), facts), camera: cameraOf(one.orbit, size) }));
    const { settings: [setting], camera } = explorer.request(false);
    return { kind, settings: [setting], camera, size, background, annotations, frames };
  }

  async function open(chosen) {
    try {
      if (chosen.size > MOST_BYTES) throw new Error("it is too large");
      const addresses = JSON.parse(await chosen.text());
      if (!Array.isArray(addresses) || !addresses.every(one => typeof one === "string" && one.startsWith("#"))) throw new Error("it does not list links");
      kept.push(...addresses.map(address => ({ address, picture: null })));
      show();
    } catch (error) {
      explorer.say(`${chosen.name} is not a session: ${error.message}`);
    }
  }

  show();
  return group("Snapshots", list, element("div", { class: "buttons" }, keep, play, film, session), film && form,
    element("label", { class: "field", for: "open-session" }, element("span", {}, "Open session"), file));
}

/** A small copy of a picture. */
function smallOf(canvas) {
  const scale = SIDE / Math.max(canvas.width, canvas.height), small = element("canvas", { width: Math.round(canvas.width * scale), height: Math.round(canvas.height * scale), "aria-hidden": "true" });
  small.getContext("2d").drawImage(canvas, 0, 0, small.width, small.height);
  return small;
}
