"""Parameters read from stored pictures of test members, against the true ones.

    python -m research.benchmarks.answers.inverse RUN [RUN ...] [--pictures 1 3] [--write]

Each RUN is a folder whose catalog is there. Prints Markdown. Errors are shares of a parameter's range, on its scale. A
local minimum is a solution whose pictures are farther off than those at the true parameters, by 5 %. Seconds are
processor seconds of an answer, calibration aside.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from catalogs.store.catalog import Catalog
from research.benchmarks.page import DOCS, command_line, fill, made_by, table
from surrogate.answers.inverse import FIT_SIDE, residuals_of
from surrogate.answers.posterior import calibration_of, solved
from surrogate.answers.targets import smallest, stored_target
from surrogate.evaluation.scoring import spread
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

HEADER = ["run", "pictures", "parameter", "error, median / 90th", "width", "covered", "local minima", "s"]


def rows_of(title: str, surrogate: Surrogate, catalog: Catalog, pictures: int) -> list[list[str]]:
    """Rows of the table, one for each parameter."""
    space, calibration = surrogate.space, calibration_of(surrogate, catalog, pictures, None)
    errors, widths, covered, minima, seconds = [], [], [], [], []
    for member in (one for one in catalog.members if one.split == "test"):
        views = [view for view, split in enumerate(member.view_splits) if split == "test"]
        targets = [stored_target(catalog, member.name, views[i]) for i in spread(len(views), pictures)]
        started = time.process_time()
        answer = solved(surrogate, targets, catalog, calibration)
        seconds.append(time.process_time() - started)
        each = answer.parameters
        truth = space.normalize(space.values(member.parameters, outside="allow"))
        best, low, high = (space.normalize([getattr(one, name) for one in each]) for name in ("value", "low", "high"))
        errors.append(np.abs(best - truth) / 2.0)
        widths.append([one.width for one in each])
        covered.append((low <= truth) & (truth <= high))
        residuals = residuals_of(surrogate, smallest(targets, FIT_SIDE), catalog.plan.background)
        costs = (residuals(np.stack([best, truth])) ** 2).mean(1)
        minima.append(costs[0] > 1.05 * costs[1])
    return [
        [
            title if j == 0 else "",
            str(pictures) if j == 0 else "",
            name,
            " / ".join(f"{100.0 * value:.1f}" for value in np.quantile(np.array(errors)[:, j], [0.5, 0.9])) + " %",
            f"{np.mean(np.array(widths)[:, j]):.0%}",
            f"{np.mean(np.array(covered)[:, j]):.0%}",
            f"{sum(minima)} of {len(minima)}" if j == 0 else "",
            f"{math.fsum(seconds) / len(seconds):.1f}" if j == 0 else "",
        ]
        for j, name in enumerate(space.names)
    ]


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("answers.inverse", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--pictures", nargs="+", type=int, default=[1, 3], help="numbers of pictures of a member")
    parser.add_argument("--write", action="store_true", help="write the table into docs/answers.md")
    options = parser.parse_args(arguments)
    rows = []
    for run in map(Run.open, options.runs):
        assert run.catalog is not None
        for pictures in options.pictures:
            rows += rows_of(run.title, run.surrogate, run.catalog, pictures)
    words = " ".join(map(str, (*options.runs, "--pictures", *options.pictures)))
    body = f"{table(HEADER, rows)}\n<sub>{made_by(f'answers.inverse {words}')}</sub>"
    print(body)
    if options.write:
        fill(DOCS / "answers.md", "inverse", body)


if __name__ == "__main__":
    main()
