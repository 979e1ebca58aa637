"""Pages without a program against the engine: accuracy of both ways to draw, size, and time of scripts.

    python -m research.benchmarks.explorer.alone RUN [RUN ...] [--pictures 20] [--write]

Prints Markdown.  Each RUN is exported as a page, which Chromium opens with software graphics.  Random parameters are drawn
at random stored views of 256² and 512² pixels by the graphics card's shaders and by scripts, and compared on white with
`surrogate.using("gaussians")`.  Milliseconds of scripts are medians in the page: of another view, and of other parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from research.benchmarks.page import DOCS, command_line, made_by, publish, table
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run
from surrogate.model.representation import GAUSSIANS
from tests.support.browsers import FLAGS, find_browser
from tests.support.drawn_pages import decibels, drawn, opened

SIDES = (256, 512)
HEADER = [
    "run",
    "Gaussians",
    "MB: model",
    "page",
    "pixels",
    "card, dB: mean / worst",
    "scripts, dB: mean / worst",
    "scripts, ms: view / parameters",
]
TIMES = """async cases => {
  const { model } = await import("draw/local.js"), { Scripts } = await import("draw/scripts.js");
  const own = new Scripts(model.figures[0]);
  const median = times => times.sort((a, b) => a - b)[times.length >> 1], views = [], points = [];
  for (const { parameters, camera } of cases) {
    const start = performance.now();
    own.setParameters(parameters);
    own.draw(camera);
    const middle = performance.now();
    own.draw(camera);
    points.push(middle - start);
    views.push(performance.now() - middle);
  }
  return [median(views), median(points)];
}"""


def rows_of(run: Run, page: Page, pictures: int) -> list[list[str]]:
    """A row for each size of pictures."""
    surrogate, rows = run.surrogate.using(GAUSSIANS), []
    for side in SIDES:
        random, cases, expected = np.random.default_rng(0), [], []
        for _ in range(pictures):
            values = surrogate.space.denormalize(random.uniform(-1.0, 1.0, len(surrogate.space))).tolist()
            parameters: dict[str, Any] = dict(zip(surrogate.space.names, values, strict=True))
            camera = run.cameras[int(random.integers(len(run.cameras)))].resized(side, side)
            cases.append({"parameters": parameters, "camera": camera.to_json()})
            expected.append(surrogate.at(parameters).render(camera, background=WHITE))
        scores = {}
        for engine in ("card", "scripts"):
            found = [picture for case in cases for picture in drawn(page, [case], engine)]
            each = [decibels(*pair) for pair in zip(found, expected, strict=True)]
            scores[engine] = f"{np.mean(each):.1f} / {min(each):.1f}"
        view, parameters_too = page.evaluate(TIMES, cases)
        size, whole = surrogate.sizes[GAUSSIANS], len(page_bytes(run)) / 1e6
        rows.append(
            [
                run.title,
                f"{len(surrogate.gaussians):,}",
                f"{size:.2f}",
                f"{whole:.2f}",
                f"{side}²",
                *scores.values(),
                f"{view:.0f} / {parameters_too:.0f}",
            ]
        )
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("explorer.alone", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--pictures", type=int, default=20, help="pictures of each run and size")
    parser.add_argument("--write", action="store_true", help="write the table into docs/explorer.md")
    options = parser.parse_args(arguments)
    program = find_browser()
    if program is None:
        parser.error("Chromium is not installed")
    rows = []
    with sync_playwright() as playwright, TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        for path in options.runs:
            run = Run.open(path)
            page = browser.new_context().new_page()
            opened(page, run.surrogate, Path(folder), run.title)
            rows += rows_of(run, page, options.pictures)
            page.close()
        browser.close()
    command = f"explorer.alone {' '.join(map(str, options.runs))} --pictures {options.pictures}"
    body = f"{table(HEADER, rows)}\n<sub>{made_by(command)}</sub>"
    publish(body, DOCS / "explorer.md", "alone", write=options.write)


if __name__ == "__main__":
    main()
