// What can be taken away: pictures, comparisons, films, Gaussians, a link, the code.

import { exported } from "./connection.js";
import { group } from "./groups.js";
import { button, element, menu } from "../web/elements.js";

const GAUSSIANS = "ply", FIELDS = "vti";
const PICTURES = { png: "PNG, parameters inside", exr: "EXR, parameters inside", [GAUSSIANS]: "Gaussians, 3DGS .ply", [FIELDS]: "Fields, VTK .vti", html: "Page without a program, .html", python: "Python that draws it" };
const COMPARISONS = { comparison: "Comparison, PNG" };
const SWEEPS = { sheet: "Sheet, PNG", gif: "Animation, GIF", mp4: "Film, MP4" };
const SCALES = [1, 2];

/** Saves what the explorer shows. */
export function exportPanel(explorer) {
  const say = text => explorer.say(text), { mode } = explorer.state;
  const offered = explorer.facts.exports ?? { ...(mode === "sweep" ? SWEEPS : mode === "compare" ? COMPARISONS : {}), ...PICTURES };
  if (!explorer.facts.model.gaussians) delete offered[GAUSSIANS];
  if (!explorer.facts.model.representations.some(({ name }) => name === "field")) delete offered[FIELDS];
  const kinds = menu("As", "export-kind", undefined, Object.entries(offered), () => resize());
  const sizes = menu("Size", "export-scale", undefined, []), chosen = box => box.querySelector("select");
  function resize() {
    const kind = chosen(kinds).value, scale = chosen(sizes).value, data = [GAUSSIANS, FIELDS, "html"].includes(kind), fixed = data || (kind === "comparison" && explorer.state.against === "truth");
    const options = (fixed ? [1] : SCALES).map(times => element("option", { value: times, selected: String(times) === scale }, explorer.exportSize(kind, times).join("×")));
    chosen(sizes).replaceChildren(...options);
    sizes.hidden = data;
  }
  resize();
  chosen(sizes).onfocus = resize; // the window may have changed
  const saving = button("Save", async () => {
    saving.disabled = true;
    say("Making it…");
    try {
      const made = await exported(explorer.exportable(chosen(kinds).value, Number(chosen(sizes).value)));
      saveFile(made);
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
  return group("Export", kinds, sizes, element("div", { class: "buttons" }, saving, link));
}

/** Let the browser save a file. */
export function saveFile({ name, blob }) {
  const address = URL.createObjectURL(blob), anchor = element("a", { href: address, download: name });
  document.body.append(anchor);
  anchor.click();
  anchor.remove();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}
