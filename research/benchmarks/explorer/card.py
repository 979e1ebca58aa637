"""Frames a second of pages without a program, on this machine's graphics card and by scripts.

    python -m research.benchmarks.explorer.card RUN [RUN ...] [--seconds 2] [--browser PATH] [--headed] [--write]

Prints Markdown, to be sent from machines with graphics cards.  Each RUN is exported as a page, which a browser opens as people do,
without a server; `--browser` takes another one that is built on Chromium.  Frames are whole: one is asked for when the pixels of
the one before can be read.  The view turns, or a parameter goes from bound to bound.  Where `node` is installed, it runs the page's
own modules for the last column: the processor's part of a frame on a card, which moves the means and sorts them.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import Page, sync_playwright

from research.benchmarks.page import RESULTS, command_line, made_by, publish, table
from surrogate.explore.exporting.page import page_files
from surrogate.explore.run import Run
from surrogate.model.representation import GAUSSIANS
from tests.support.browsers import find_browser
from tests.support.drawn_pages import opened

SIDES = (512, 1024)
HEADER = ["run", "drawn by", "pixels", "view, frames/s", "parameter, frames/s", "processor, ms: view / parameter"]
RENDERER = """async () => {
  const { ways: { graphics } } = await import("draw/local.js");
  return graphics ? [graphics.renderer, graphics.software] : ["no graphics", true];
}"""
RATES = """async ([using, side, seconds]) => {
  const { frame } = await import("draw/local.js"), { explorer } = window, { facts } = explorer, [p] = facts.parameters;
  const canvas = Object.assign(document.createElement("canvas"), { width: 1, height: 1 }), size = [side, side];
  const context = canvas.getContext("2d", { willReadFrequently: true }), plain = explorer.request(false), rates = [];
  const { parameters } = plain.settings[0], between = share => p.low + share * (p.high - p.low);
  const turned = ({ position: [x, y, z], target: [a, b], ...rest }, angle) => {
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    const position = [a + cos * (x - a) - sin * (y - b), b + sin * (x - a) + cos * (y - b), z];
    return { ...rest, position, target: plain.camera.target };
  };
  const requests = [
    i => ({ camera: turned(plain.camera, i / 20), settings: [{ ...plain.settings[0], using }] }),
    i => ({ settings: [{ ...plain.settings[0], using, parameters: { ...parameters, [p.name]: between(i % 20 / 19) } }] }),
  ];
  for (const changed of requests) {
    let start = 0, count = -2; // the first frames compile shaders
    while (count < 3 || performance.now() - start < 1000 * seconds) {
      if (!count) start = performance.now();
      const { pictures: [bitmap] } = await frame({ ...plain, form: "jpeg", size, ...changed(count + 2) });
      context.drawImage(bitmap, 0, 0);
      context.getImageData(0, 0, 1, 1);
      bitmap.close();
      ++count;
    }
    rates.push(1000 * count / (performance.now() - start));
  }
  return rates;
}"""
PROCESSOR = """import { readFileSync } from "node:fs";
import { Cards } from "draw/cards.js";
import { modelOf } from "draw/model.js";
import { Order } from "draw/order.js";
const { record, facts } = JSON.parse(readFileSync("surrogate.json"));
const model = modelOf(new Uint8Array(readFileSync("model.safetensors")), null, record);
const [figure] = model.figures, { count, width } = figure.columns, rows = Math.ceil(count / 1024), fours = Math.ceil(width / 4);
const card = Object.assign(Object.create(Cards.prototype), {
  figure, count, rows, fours, graphics: { write: () => {} }, textures: {},
  order: new Order(count), means: new Float32Array(3 * count), reversed: new Uint32Array(1024 * rows),
});
const median = times => times.sort((a, b) => a - b)[times.length >> 1], views = [], parameters = [];
for (let i = 0; i < 120; ++i) {
  const values = Object.fromEntries(facts.parameters.map(p => [p.name, p.low + (i * 0.37 % 1) * (p.high - p.low)]));
  const angle = i / 9, start = performance.now();
  const modes = figure.embedding.modes(figure.pointOf(values));
  card.modesForLatents(modes);
  figure.emulated?.shifts(figure.pointOf(values));
  card.moveMeans(modes);
  const middle = performance.now();
  card.sort({ rotation: [0, 0, 0, 0, 0, 0, Math.cos(angle), Math.sin(angle), 0.2], translation: [0, 0, 4] });
  views.push(performance.now() - middle);
  parameters.push(performance.now() - start);
}
console.log(JSON.stringify({ count, times: [median(views.slice(20)), median(parameters.slice(20))] }));
"""


def processor_times(run: Run, folder: Path) -> tuple[int, list[float]]:
    """The number of a run's Gaussians, and milliseconds of the processor for another view and for other parameters, by node."""
    for name, content in page_files(run, modes=0).items():
        path = folder / ("node_modules" if name.endswith(".js") else "") / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    for room in ("draw", "explore", "web"):
        (folder / "node_modules" / room / "package.json").write_text('{"type": "module"}')
    (folder / "main.mjs").write_text(PROCESSOR)
    done = subprocess.run(["node", "main.mjs"], cwd=folder, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found["count"], found["times"]


def rows_of(run: Run, page: Page, seconds: float, processor: str) -> list[list[str]]:
    """All ways of an open page to draw, each at both sizes."""
    ways = page.evaluate("async () => (await import('draw/local.js')).ways.listed")
    rows = []
    for way in (one for one in ways if not one["name"].startswith("both")):
        for side in SIDES:
            view, parameter = page.evaluate(RATES, [way["name"], side, seconds])
            own = processor if way["name"] == f"{GAUSSIANS}-card" else ""
            rows.append([run.title, way["words"], f"{side}²", f"{view:.1f}", f"{parameter:.1f}", own])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("explorer.card", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--browser", default=find_browser(), metavar="PATH", help="a browser built on Chromium")
    parser.add_argument("--headed", action="store_true", help="open a window, where browsers use a card only then")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/explorer.md")
    options = parser.parse_args(arguments)
    if options.browser is None:
        parser.error("Chromium is not installed: name a browser with --browser")
    rows, renderer = [], ""
    with sync_playwright() as playwright, TemporaryDirectory() as name:
        folder = Path(name)
        browser = playwright.chromium.launch(executable_path=options.browser, headless=not options.headed)
        for path in options.runs:
            run = Run.open(path)
            processor = ""
            if shutil.which("node") and len(run.surrogate.gaussians):
                count, times = processor_times(run, folder / run.title)
                processor = f"{times[0]:.1f} / {times[1]:.1f} of {count:,}"
            page = browser.new_context().new_page()
            opened(page, run.surrogate, folder, run.title)
            renderer, is_software = page.evaluate(RENDERER)
            renderer += " (software: no graphics card)" if is_software else ""
            for row in rows_of(run, page, options.seconds, processor):
                rows.append([cell.replace("graphics card", "software card") if is_software else cell for cell in row])
            page.close()
        version = browser.version
        browser.close()
    command = f"explorer.card {' '.join(map(str, options.runs))} --seconds {options.seconds:g}"
    said = f"Renderer: {renderer}; Chromium {version}. {made_by(command)}"
    publish(f"{table(HEADER, rows)}\n<sub>{said}</sub>", RESULTS / "explorer.md", "card", write=options.write)


if __name__ == "__main__":
    main()
