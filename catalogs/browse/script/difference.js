// ---- the difference of two pictures, by compositing alone: a page from the file system may draw pixels, not read them

async function showDifference() {
  const shown = state.mode === "compare" && state.gain > 0;
  $("difference").hidden = !shown;
  $("panes").dataset.count = state.mode !== "compare" ? 1 : shown ? 3 : 2;
  if (!shown) return;
  const stage = $("difference").querySelector(".stage"), seen = state.sides;
  const addresses = seen.map(of => addressOf(of, viewFor(of.member)));
  const key = [...addresses, state.gain, state.background].join(" ");
  if (stage.dataset.key === key) return;
  stage.dataset.key = key;
  stage.dataset.size = state.size;
  stage.setAttribute("aria-busy", "true");
  const [left, right] = await Promise.allSettled(addresses.map(decodedPicture));
  if (stage.dataset.key !== key) return;
  const canvas = stage.querySelector("canvas");
  canvas.hidden = !(left.value && right.value);
  if (!canvas.hidden) drawDifference(canvas, left.value, right.value, state.gain);
  stage.setAttribute("aria-busy", "false");
}

function drawDifference(canvas, left, right, gain) {
  const width = canvas.width = left.naturalWidth, height = canvas.height = left.naturalHeight;
  const pen = canvas.getContext("2d"), other = new OffscreenCanvas(width, height), otherPen = other.getContext("2d");
  const backdrop = catalog.background ?? { black: "#000", white: "#fff", dark: token("paper") }[state.background] ?? "#000";
  for (const [each, image] of [[pen, left], [otherPen, right]]) {
    each.fillStyle = backdrop;
    each.fillRect(0, 0, width, height);
    each.drawImage(image, 0, 0, width, height);
  }
  pen.globalCompositeOperation = "difference";
  pen.drawImage(other, 0, 0);
  pen.globalCompositeOperation = "lighter";
  for (let reached = 1; reached < gain; reached *= 2) pen.drawImage(canvas, 0, 0);
}
