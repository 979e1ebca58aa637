"""Parameters read from stored pictures of members that nobody learnt from, against the true ones.

    python -m research.benchmarks.answers.inverse RUN [RUN ...] [--pictures 1 3 12] [--search N] [--write]

Each RUN is a folder whose catalog is there.  Validation and test members are judged alike, by models that have learnt from
neither.  Prints Markdown.  Errors are shares of a parameter's range, on its scale.  A local minimum is a solution whose pictures
are farther off than those at the true parameters, by 5 %.  Eight members drawn at random calibrate the intervals of the others,
many times: `covered` is the share of true parameters within them.  Seconds are processor seconds of an answer, calibration aside.
With `--search`, one picture of N members each is also read without its camera; the true view is left out of those searched.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from research.benchmarks.page import RESULTS, command_line, made_by, publish, table
from surrogate.answers.inverse import FIT_SIDE, Fit, best_fits
from surrogate.answers.inverse_calibration import MOST, InverseCalibration, targets_for
from surrogate.answers.posterior import answer_of
from surrogate.answers.residuals import Residuals, angle_between
from surrogate.answers.sampling import margins_of, widened
from surrogate.answers.targets import views_of
from surrogate.evaluation.scoring import spread
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.model.judged import judged
from surrogate.splatting.threads import one_torch_thread

HEADER = ["run", "pictures", "parameter", "error, median / 90th", "width", "covered", "local minima", "s"]
CAMERA_HEADER = ["run", "members", "camera off, median / 90th", "nearest solution", "solutions", "s"]
SPLITS = 200
FACTORS = 3  # on either side of that of all members, at which intervals are computed
REACH = 8.0  # times that factor

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Read:
    """A member as its pictures are read: normalized `truth` (P,), local solutions, and whether the best is a worse one."""

    truth: Array
    residuals: Residuals
    fits: list[Fit]
    minimum: bool
    seconds: float


def read_members(surrogate: Surrogate, catalog: Catalog, pictures: int) -> list[Read]:
    """Validation and test members, each by as many test views."""
    space, read = surrogate.space, []
    for number, member in enumerate(one for one in catalog.members if one.split in ("validation", "test")):
        views = [view for view, split in enumerate(member.view_splits) if split == "test"]
        targets = targets_for(catalog, member, views, pictures, 7 * number)
        started = time.process_time()
        residuals = Residuals.of(surrogate, targets, catalog.plan.background)
        fits = best_fits(residuals)
        seconds = time.process_time() - started
        truth = space.normalize(space.values(member.parameters, outside="allow"))
        (cost,) = residuals.at_most(FIT_SIDE).costs(truth[None])
        read.append(Read(truth, residuals, fits, fits[0].cost > 1.05 * cost, seconds))
    return read


def coverage(read: Sequence[Read]) -> tuple[Array, Array, float]:
    """Shares (P,) of true parameters in intervals by random splits, mean widths (P,), and seconds of one posterior."""
    whole = InverseCalibration.of([one.fits[0] for one in read], [one.truth for one in read])
    factors = whole.factor * np.geomspace(1.0 / REACH, REACH, 2 * FACTORS + 1)
    started = time.process_time()
    answers = [[answer_of(one.residuals, one.fits, replace(whole, factor=f)) for one in read] for f in factors]
    seconds = (time.process_time() - started) / (len(factors) * len(read))
    truths = np.stack([one.truth for one in read])
    ends = np.array([[answer.normalized for answer in row] for row in answers])  # [F, M, P, 2]
    random, shares, means = np.random.default_rng(0), [], []
    for _ in range(SPLITS):
        order = random.permutation(len(read))
        few = order[: min(MOST, len(read) // 2)]
        calibration = InverseCalibration.of([read[i].fits[0] for i in few], [truths[i] for i in few])
        nearest = int(np.abs(np.log(factors / calibration.factor)).argmin())
        others = order[len(few) :]
        low, high = np.moveaxis(widened(ends[nearest, others], margins_of(ends[nearest, few], truths[few])), -1, 0)
        shares.append(((low <= truths[others]) & (truths[others] <= high)).mean(0))
        means.append((high - low).mean(0) / 2.0)
    return np.mean(shares, axis=0), np.mean(means, axis=0), seconds


def rows_of(title: str, surrogate: Surrogate, catalog: Catalog, pictures: int) -> list[list[str]]:
    """Rows of the table, one for each parameter."""
    read = read_members(surrogate, catalog, pictures)
    covered, widths, posterior = coverage(read)
    errors = np.array([np.abs(one.fits[0].point - one.truth) / 2.0 for one in read])  # [M, P]
    seconds = float(np.mean([one.seconds for one in read])) + posterior
    return [
        [
            title if j == 0 else "",
            str(pictures) if j == 0 else "",
            name,
            " / ".join(f"{100.0 * value:.1f}" for value in np.quantile(errors[:, j], [0.5, 0.9])) + " %",
            f"{widths[j]:.0%}",
            f"{covered[j]:.0%}" + f"; all {covered.mean():.0%}" * (j == 0),
            f"{sum(one.minimum for one in read)} of {len(read)}" if j == 0 else "",
            f"{seconds:.1f}" if j == 0 else "",
        ]
        for j, name in enumerate(surrogate.space.names)
    ]


def camera_row(title: str, surrogate: Surrogate, catalog: Catalog, members: int) -> list[str]:
    """Errors in degrees of cameras that are searched: the best solution's, and the nearest solution's."""
    unseen = [one for one in catalog.members if one.split in ("validation", "test")]
    off, nearest, counts, seconds = [], [], [], []
    for number in spread(len(unseen), members):
        member = unseen[number]
        tests = [view for view, split in enumerate(member.view_splits) if split == "test"]
        (target,) = targets_for(catalog, member, tests, 1, 7 * number)
        true = target.camera
        assert true is not None
        others = [view for view in views_of(catalog) if angle_between(view, true) > 1e-3]
        started = time.process_time()
        residuals = Residuals.of(surrogate, [replace(target, camera=None)], catalog.plan.background, others)
        fits = best_fits(residuals)
        answer = answer_of(residuals, fits, InverseCalibration(fits[0].cost, 1.0, 0))
        seconds.append(time.process_time() - started)
        angles = [float(np.degrees(angle_between(camera, true))) for (camera,) in answer.cameras]
        off.append(angles[0])
        nearest.append(min(angles))
        counts.append(len(angles))
    both = (" / ".join(f"{v:.1f}°" for v in np.quantile(each, [0.5, 0.9])) for each in (off, nearest))
    return [title, str(len(off)), *both, f"{np.mean(counts):.1f}", f"{np.mean(seconds):.1f}"]


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("answers.inverse", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--pictures", nargs="*", type=int, default=[1, 3, 12], help="numbers of pictures of a member")
    parser.add_argument("--search", type=int, default=0, metavar="N", help="members whose camera is searched")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/answers.md")
    options = parser.parse_args(arguments)
    rows, cameras = [], []
    for run in map(Run.open, options.runs):
        assert run.catalog is not None
        surrogate = judged(run.surrogate, run.catalog)
        for pictures in options.pictures:
            rows += rows_of(run.title, surrogate, run.catalog, pictures)
        if options.search:
            cameras.append(camera_row(run.title, surrogate, run.catalog, options.search))
    words = " ".join(map(str, (*options.runs, "--pictures", *options.pictures)))
    words += f" --search {options.search}" if options.search else ""
    tables = ([table(HEADER, rows)] if rows else []) + ([table(CAMERA_HEADER, cameras)] if cameras else [])
    body = "\n".join(tables) + f"\n<sub>{made_by(f'answers.inverse {words}')}</sub>"
    publish(body, RESULTS / "answers.md", "inverse", write=options.write)


if __name__ == "__main__":
    main()
