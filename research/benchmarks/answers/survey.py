"""Expectations of pages without a program, against test members and beside what the program itself says.

    python -m research.benchmarks.answers.survey RUN [RUN ...] [--views 4] [--write]

Prints Markdown. Test members are shown at test views in the base appearance, by each representation that is calibrated. The
columns give mean absolute difference, half width and coverage of the doubt, asked for each picture, and of the survey, which
interpolates between its points.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from research.benchmarks.page import RESULTS, command_line, made_by, publish, table
from surrogate.answers.doubt import Doubt
from surrogate.answers.survey import Survey
from surrogate.evaluation.metrics import WHITE, composite, psnr
from surrogate.evaluation.scoring import spread
from surrogate.explore.run import Run
from surrogate.model.representation import WORDS

HEADER = [
    "run",
    "drawn by",
    "pictures",
    "promised",
    "asked: off, half width (dB), covers",
    "page: off, half width (dB), covers",
    "seconds to survey",
]


def rows_of(run: Run, views: int) -> Iterator[list[str]]:
    """A row for each representation."""
    surrogate, catalog = run.surrogate, run.catalog
    if catalog is None:
        raise ValueError(f"{run.title} has no catalog: {run.missing}")
    doubt = Doubt.of(surrogate, catalog, run.folder)
    began = time.perf_counter()
    with TemporaryDirectory() as folder:
        survey = Survey.of(doubt, catalog, run.cameras, Path(folder))
    seconds = time.perf_counter() - began
    tested = [member for member in catalog.members if member.split == "test"]
    for using, expectation in survey.expectations.items():
        rows = []  # of truth, asked and surveyed PSNR
        for member in tested:
            drawn = surrogate.using(using).at(member.parameters, outside="allow")
            asked = doubt.at(member.parameters, using=using)
            point = surrogate.space.normalize(surrogate.space.values(member.parameters, outside="allow"))
            surveyed = survey.expected(point, using)
            numbers = [view for view, split in enumerate(member.view_splits) if split == "test"]
            for view in (numbers[i] for i in spread(len(numbers), views)):
                camera, behind = member.cameras[view], catalog.plan.background or WHITE
                truth = composite(catalog.image(member, surrogate.base_appearance, view), behind)
                interval = asked.interval(camera)
                if interval.psnr is not None:
                    rows.append((psnr(truth, composite(drawn.render(camera), behind)), interval.psnr, surveyed))
        off = np.abs(np.diff(np.array(rows)[:, [1, 0, 2]], axis=1)) if rows else np.full((1, 2), np.nan)
        halves = (doubt.calibrations[f"view {using}"].half, expectation.half)
        said = [f"{o.mean():.1f}, {half:.1f}, {(o <= half).mean():.0%}" for o, half in zip(off.T, halves, strict=True)]
        yield [run.title, WORDS[using], str(len(rows)), f"{expectation.share:.0%}", *said, f"{seconds:.0f}"]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("answers.survey", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--views", type=int, default=4, help="test views of each test member")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/explorer.md")
    options = parser.parse_args(arguments)
    rows = [row for path in options.runs for row in rows_of(Run.open(path), options.views)]
    command = f"answers.survey {' '.join(map(str, options.runs))} --views {options.views}"
    publish(
        f"{table(HEADER, rows)}\n<sub>{made_by(command)}</sub>", RESULTS / "explorer.md", "survey", write=options.write
    )


if __name__ == "__main__":
    main()
