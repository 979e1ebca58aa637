"""Pages without a program against the engine: accuracy of both ways to draw, size, and time of scripts.

    python -m research.benchmarks.explorer.alone RUN [RUN ...] [--pictures 20] [--field] [--write]

Prints Markdown.  Each RUN is exported as a page, which Chromium opens with software graphics; `--field` puts the emulated field
into each that has one.  Random parameters are drawn at random stored views of 256² and 512² pixels by the graphics card's shaders
and by scripts, and compared on white with `surrogate.using(...)`.  Rows are Gaussians and the emulated field, of runs that follow
isovalues their surfaces too.  Milliseconds of scripts are medians in the page: of another view, and of other parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from catalogs.vocabulary.variations import IsovalueVariation, Variation
from research.benchmarks.page import RESULTS, command_line, made_by, publish, table
from surrogate import Surrogate
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting.page_field import field_of_page
from surrogate.explore.run import Run
from surrogate.model.representation import FIELD, GAUSSIANS, WORDS
from tests.support.browsers import FLAGS, find_browser
from tests.support.drawn_pages import decibels, drawn, field_drawn, opened

SIDES = (256, 512)
HEADER = [
    "run",
    "drawn by",
    "MB: model",
    "page",
    "pixels",
    "card, dB: mean / worst",
    "scripts, dB: mean / worst",
    "scripts, ms: view / parameters",
]
ALL_MODES = 10_000
TIMES = """async ([cases, kind]) => {
  const { model } = await import("draw/local.js"), { Scripts } = await import("draw/scripts.js");
  const { figureFor } = await import("draw/model.js"), { FieldScripts } = await import("draw/field_scripts.js");
  const own = kind === "field" ? new FieldScripts(model.fields) : new Scripts(figureFor(model, cases[0].parameters));
  const median = times => times.sort((a, b) => a - b)[times.length >> 1], views = [], points = [];
  for (const { parameters, visualization, camera } of cases) {
    const start = performance.now();
    if (kind === "field") own.set(parameters, visualization);
    else own.setParameters(parameters);
    own.draw(camera);
    const middle = performance.now();
    own.draw(camera);
    points.push(middle - start);
    views.push(performance.now() - middle);
  }
  return [median(views), median(points)];
}"""


@dataclass(frozen=True)
class Subject:
    """A way to draw a run: a representation, perhaps of isosurfaces."""

    representation: str
    surfaces: Variation | None

    def __str__(self) -> str:
        return WORDS[self.representation] + ("" if self.surfaces is None else ", isosurfaces")


def subjects_of(surrogate: Surrogate, with_field: bool) -> list[Subject]:
    """All that a page draws, but for mean images."""
    ways = [name for name in surrogate.representations if name == GAUSSIANS or (name == FIELD and with_field)]
    surfaces = [None, *(v for v in surrogate.variations if isinstance(v, IsovalueVariation))]
    return [Subject(way, variation) for way in ways for variation in surfaces]


def cases_of(run: Run, subject: Subject, side: int, pictures: int) -> tuple[list[dict[str, Any]], list[Any]]:
    """Random parameters and views for the page, and the pictures that the engine draws of them."""
    surrogate, random = run.surrogate.using(subject.representation), np.random.default_rng(0)
    cases, expected = [], []
    for _ in range(pictures):
        values = surrogate.space.denormalize(random.uniform(-1.0, 1.0, len(surrogate.space))).tolist()
        parameters: dict[str, Any] = dict(zip(surrogate.space.names, values, strict=True))
        camera = run.cameras[int(random.integers(len(run.cameras)))].resized(side, side)
        visualization = {}
        if subject.surfaces is not None:
            (bounds,) = subject.surfaces.space.parameters
            visualization = {bounds.name: float(random.uniform(bounds.low, bounds.high))}
        case = {"parameters": parameters, "visualization": visualization, "camera": camera.to_json()}
        if subject.representation == GAUSSIANS:
            case = {"parameters": parameters | visualization, "camera": camera.to_json()}
        cases.append(case)
        expected.append(surrogate.at(parameters | visualization).render(camera, background=WHITE))
    return cases, expected


def row_of(run: Run, page: Page, subject: Subject, side: int, pictures: int, size: float) -> list[str]:
    """A row of a page of a size (MB): one way to draw, and one size of pictures."""
    cases, expected = cases_of(run, subject, side, pictures)
    draw, scores = drawn if subject.representation == GAUSSIANS else field_drawn, []
    for engine in ("card", "scripts"):
        found = [picture for case in cases for picture in draw(page, [case], engine)]
        each = [decibels(*pair) for pair in zip(found, expected, strict=True)]
        scores.append(f"{np.mean(each):.1f} / {min(each):.1f}")
    view, parameters_too = page.evaluate(TIMES, [cases, subject.representation])
    model = f"{run.surrogate.sizes[subject.representation]:.2f}"
    times = f"{view:.0f} / {parameters_too:.0f}"
    return [run.title, str(subject), model, f"{size:.2f}", f"{side}²", *scores, times]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("explorer.alone", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--pictures", type=int, default=20, help="pictures of each run and size")
    parser.add_argument("--field", action="store_true", help="put the emulated field into each page")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/explorer.md")
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
            has_field = options.field or field_of_page(run.surrogate, None) is not None
            opened(page, run.surrogate, Path(folder), run.title, ALL_MODES if has_field else None)
            size = (Path(folder) / "page.html").stat().st_size / 1e6
            for subject in subjects_of(run.surrogate, has_field):
                rows += [row_of(run, page, subject, side, options.pictures, size) for side in SIDES]
            page.close()
        browser.close()
    command = f"explorer.alone {' '.join(map(str, options.runs))} --pictures {options.pictures}"
    command += " --field" if options.field else ""
    body = f"{table(HEADER, rows)}\n<sub>{made_by(command)}</sub>"
    publish(body, RESULTS / "explorer.md", "alone", write=options.write)


if __name__ == "__main__":
    main()
