// What can be taken away: pictures, films, Gaussians, a link, the code.

import { exported } from "./connection.js";
import { button, element, menu, section } from "./elements.js";

const PICTURES = { png: "PNG, parameters inside", exr: "EXR, parameters inside", ply: "Gaussians, 3DGS .ply", python: "Python that draws it" };
const SWEEPS = { sheet: "Sheet, PNG", gif: "Animation, GIF", mp4: "Film, MP4" };

/** Saves what the explorer shows. */
export function exportPanel(explorer) {
  const say = text => explorer.say(text), { state } = explorer;
  const offered = state.mode === "sweep" ? { ...SWEEPS, ...PICTURES } : PICTURES;
  const kinds = menu("As", "export-kind", undefined, Object.entries(offered));
  const saving = button("Save", async () => {
    saving.disabled = true;
    say("Making it…");
    try {
      const made = await exported({ ...explorer.exportable(), kind: kinds.querySelector("select").value, sweep: state.mode === "sweep" ? state.sweep : null });
      save(made);
      say(`${made.name}: ${(made.blob.size / 1024).toFixed(0)} kB`);
    } catch (error) {
      say(error.message);
    } finally {
      saving.disabled = false;
    }
  }, { id: "export", class: "primary" });
  const link = button("Copy link", async () => {
    explorer.writeAddress();
    await explorer.copy(location.href, "link");
  }, { id: "copy-link" });
  return section("Export", kinds, element("div", { class: "buttons" }, saving, link));
}

function save({ name, blob }) {
  const address = URL.createObjectURL(blob), anchor = element("a", { href: address, download: name });
  document.body.append(anchor);
  anchor.click();
  anchor.remove();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}
