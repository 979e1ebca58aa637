// What can be taken away: pictures, comparisons, films, Gaussians, a link, the code.

import { button, element, menu } from "../web/elements.js";
import { group } from "./groups.js";

const GAUSSIANS = ["ply", "glb", "spz"], FIELDS = "vti", REFIT = 3000; // steps by which Gaussians are fitted for other viewers
const PICTURES = { png: "PNG, parameters inside", exr: "EXR, parameters inside", ply: "Gaussians, 3DGS .ply", glb: "Fitted Gaussians, glTF .glb", spz: "Fitted Gaussians, .spz", [FIELDS]: "Fields, VTK .vti", html: "Page without a program, .html", python: "Python that draws it" };
const COMPARISONS = { comparison: "Comparison, PNG" };
const SWEEPS = { sheet: "Sheet, PNG", gif: "Animation, GIF", mp4: "Film, MP4" };
const SCALES = [1, 2];

/** Saves what the explorer shows. */
export function exportPanel(explorer) {
  const { mode } = explorer.state, { making } = explorer;
  const offered = explorer.facts.exports ?? { ...(mode === "sweep" ? SWEEPS : mode === "compare" && explorer.state.against !== "three" ? COMPARISONS : {}), ...PICTURES };
  if (!explorer.facts.model.gaussians) for (const kind of GAUSSIANS) delete offered[kind];
  if (!explorer.facts.model.representations.some(({ name }) => name === "field")) delete offered[FIELDS];
  const kinds = menu("As", "export-kind", undefined, Object.entries(offered), () => resize());
  const sizes = menu("Size", "export-scale", undefined, []), chosen = box => box.querySelector("select");
  function resize() {
    const kind = chosen(kinds).value, scale = chosen(sizes).value, data = [...GAUSSIANS, FIELDS, "html"].includes(kind), fixed = data || (kind === "comparison" && explorer.state.against === "truth");
    const options = (fixed ? [1] : SCALES).map(times => element("option", { value: times, selected: String(times) === scale }, explorer.exportSize(kind, times).join("×")));
    chosen(sizes).replaceChildren(...options);
    sizes.hidden = data;
  }
  resize();
  chosen(sizes).onfocus = resize; // the window may have changed
  const saving = making.button("Save", "export", () => {
    const kind = chosen(kinds).value, request = explorer.exportable(kind, Number(chosen(sizes).value));
    return { ...request, ...(GAUSSIANS.includes(kind) && kind !== "ply" && { refit: REFIT }) };
  });
  const link = button("Copy link", async () => {
    explorer.writeAddress();
    await explorer.copy(location.href, "link");
  }, { id: "copy-link" });
  return group("Export", kinds, sizes, element("div", { class: "buttons" }, saving, link), making.box);
}
