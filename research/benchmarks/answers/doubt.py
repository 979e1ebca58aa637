"""Intervals of pictures' PSNR, and maps of expected errors, against test members.

    python -m research.benchmarks.answers.doubt RUN [RUN ...] [--views 4] [--calibrating 8] [--write]

Each RUN is a folder of a run whose catalog is there. Prints Markdown. Test members are shown at test views, in the base
appearance and one other of each kind. Columns are the rank correlation of expected and true PSNR of members, the mean
absolute difference for pictures, the half width, and the share of pictures inside. Beside them, the same over random
splits of the unseen members: eight (`--calibrating`) of validation and test members calibrate, the others judge. The
last is the area between the sparsification curves of map and truth, over the mean error. A map without knowledge has about 0.5.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from catalogs.store.catalog import Catalog
from research.benchmarks.page import RESULTS, command_line, made_by, publish, table
from surrogate.answers.calibration import Calibration, Unseen
from surrogate.answers.doubt import Doubt
from surrogate.answers.maps import error_map
from surrogate.answers.unseen import Shown, agreement_of, by_member, cases_of, of_gaussians
from surrogate.evaluation.metrics import WHITE, composite, foreground, psnr
from surrogate.evaluation.scoring import spread
from surrogate.explore.run import Run
from surrogate.model.judged import judged
from surrogate.model.representation import FIELD
from surrogate.splatting.threads import one_torch_thread

FRACTIONS = np.linspace(0.0, 0.95, 20)  # of pixels that are taken away
FEWEST, SAME = 4, 0.2  # members and dB, of which a rank says something
SPLITS = 200
JUDGING = 8  # members at least, where that leaves half of all to calibrate
HEADER = [
    "run",
    "shown",
    "members",
    "PSNR, dB",
    "Spearman",
    "off, dB",
    "half width, dB",
    "promised",
    "covers",
    "random splits: off, half width, promised, covers",
    "sparsification (image gradient)",
    "interval / map, processor ms beside drawing",
]


@dataclass(frozen=True)
class TestPicture:
    """One picture of a test member: the truth, the interval, and how far opinions agree, dB; NaN where nobody says anything."""

    case: Shown
    truth: float
    expected: float
    half: float
    share: float
    agreement: float
    sparse: float
    gradient: float
    milliseconds: tuple[float, float]


def pictures_of(run: Run, doubt: Doubt, catalog: Catalog, views: int) -> dict[str, list[TestPicture]]:
    """Those of a run, by kind."""
    surrogate = run.surrogate
    pictures: dict[str, list[TestPicture]] = {}
    tested = [member for member in catalog.members if member.split == "test"]
    for case in cases_of(surrogate.base_appearance, surrogate.variations, tested):
        numbers = [view for view, split in enumerate(case.member.view_splits) if split == "test"]
        for view in (numbers[i] for i in spread(len(numbers), views)):
            pictures.setdefault(case.kind, []).append(_picture(run, doubt, catalog, case, view))
    return pictures


def _picture(run: Run, doubt: Doubt, catalog: Catalog, case: Shown, view: int) -> TestPicture:
    camera, behind = case.member.cameras[view], catalog.plan.background
    stored = catalog.image(case.member, case.appearance, view)
    truth = composite(stored, behind or WHITE)
    seconds = [time.process_time()]
    picture = run.surrogate.at(case.parameters, outside="allow").render(camera)
    seconds.append(time.process_time())
    member = doubt.at(case.parameters)
    interval = member.interval(camera)
    seconds.append(time.process_time())
    errors = error_map(doubt, case.parameters, camera)
    seconds.append(time.process_time())
    drawing, asking, mapping = np.diff(seconds) * 1e3
    displayed = composite(picture, behind or WHITE)
    wrong = np.abs(displayed - truth).mean(-1)
    mask = foreground(stored, behind)
    slopes = np.linalg.norm(np.gradient(displayed.mean(-1)), axis=0)
    return TestPicture(
        case,
        psnr(truth, displayed),
        np.nan if interval.psnr is None else interval.psnr,
        np.nan if interval.psnr is None or interval.low is None else interval.psnr - interval.low,
        interval.share or np.nan,
        agreement_of(member.opinions, camera, behind),
        sparsification(errors[mask], wrong[mask]),
        sparsification(slopes[mask], wrong[mask]),
        (max(asking - drawing, 0.0), max(mapping - drawing, 0.0)),
    )


def random_splits(unseen: Unseen, most: int, seed: int = 0) -> tuple[float, float, float, float]:
    """Mean error and half width (dB), promised and inside, where at most `most` members calibrate the others; NaN for too few."""
    random, count = np.random.default_rng(seed), len(unseen.truths)
    calibrating = min(most, max(count // 2, count - JUDGING))
    rows = []
    for _ in range(SPLITS):
        chosen = np.zeros(count, dtype=bool)
        chosen[random.permutation(count)[:calibrating]] = True
        calibration, others = Calibration.of(unseen.of(chosen)), unseen.of(~chosen)
        if calibration is None:
            return np.nan, np.nan, np.nan, np.nan
        expected = [calibration.line.expected(a, p) for a, p in zip(others.agreements, others.points, strict=True)]
        off = np.abs(others.truths - expected)
        rows.append((off.mean(), calibration.half, calibration.share, (off <= calibration.half).mean()))
    off, half, promised, covers = np.mean(rows, axis=0)
    return float(off), float(half), float(promised), float(covers)


def sparsification(expected: NDArray[np.floating], wrong: NDArray[np.floating]) -> float:
    """The area between two sparsification curves of N pixels, over the mean error; NaN without any error.

    A curve is the mean error of the pixels that are left when a fraction is taken away: those `expected` to be worst, or the worst.
    Ilg et al. 2018, "Uncertainty estimates and multi-hypotheses networks for optical flow", section 5.1.
    """
    if not len(wrong) or not wrong.mean() > 0.0:
        return float("nan")

    def curve(order: NDArray[np.int64]) -> NDArray[np.float64]:
        sums = np.append(0.0, np.cumsum(wrong[order], dtype=np.float64))
        kept = np.maximum((len(wrong) * (1.0 - FRACTIONS)).round().astype(int), 1)
        return sums[kept] / kept

    between = curve(np.argsort(expected, kind="stable")) - curve(np.argsort(wrong, kind="stable"))
    return float(between.mean() / wrong.mean())


def unseen_of(run: Run, doubt: Doubt, catalog: Catalog, kind: str, tested: Sequence[TestPicture]) -> Unseen | None:
    """Validation and test members' agreements and truths; None for pictures that are drawn from the field."""
    surrogate = run.surrogate
    using, space = surrogate.representation(kind), surrogate.space
    if using == FIELD:
        return None
    pictures = [one for one in of_gaussians(judged(surrogate, catalog), doubt.embeddings, catalog) if one.kind == kind]
    first = by_member([one for one in pictures if one.using == using])
    views = min(first.truths.shape[1], len(tested) // len({one.case.member.name for one in tested}))
    rows, points = [], []
    for name in dict.fromkeys(one.case.member.name for one in tested):
        own = [one for one in tested if one.case.member.name == name][:views]
        rows.append([(one.agreement, one.truth) for one in own])
        points.append(space.normalize(space.values(own[0].case.member.parameters, outside="allow")))
    second = np.array(rows)  # [M, V, 2]
    return Unseen(
        np.concatenate([first.points, points]),
        np.concatenate([first.agreements[:, :views], second[..., 0]]),
        np.concatenate([first.truths[:, :views], second[..., 1]]),
    )


def row_of(run: str, kind: str, tested: Sequence[TestPicture], unseen: Unseen | None, most: int) -> list[str]:
    """A row of the table."""
    members = sorted({one.case.member.name for one in tested})
    values = {name: np.array([getattr(one, name) for one in tested]) for name in ("truth", "expected", "half")}
    means = {
        name: np.array([np.mean([getattr(one, name) for one in tested if one.case.member.name == m]) for m in members])
        for name in ("truth", "expected")
    }
    off = np.abs(values["truth"] - values["expected"])
    asking, mapping = np.median([one.milliseconds for one in tested], axis=0)
    sparse, slopes = np.nanmean([(one.sparse, one.gradient) for one in tested], axis=0)
    said, splits = np.isfinite(off), np.full(4, np.nan) if unseen is None else np.array(random_splits(unseen, most))
    return [
        run,
        kind.replace("_", " "),
        str(len(members)),
        f"{values['truth'].mean():.1f} ± {means['truth'].std():.1f}",
        _rank(means["truth"], means["expected"]),
        _number(off[said]),
        _number(values["half"][said]),
        f"{np.nanmean([one.share for one in tested]):.0%}" if said.any() else "-",
        f"{(off[said] <= values['half'][said]).mean():.0%}" if said.any() else "-",
        f"{splits[0]:.2f}, {splits[1]:.2f}, {splits[2]:.0%}, {splits[3]:.0%}" if np.isfinite(splits).all() else "-",
        f"{sparse:.2f} ({slopes:.2f})",
        f"{asking:.0f} / {mapping:.0f}",
    ]


def _rank(truth: NDArray[np.float64], expected: NDArray[np.float64]) -> str:
    both = np.isfinite(truth) & np.isfinite(expected)
    first, second = truth[both], expected[both]
    if len(first) < FEWEST or min(first.std(), second.std()) < SAME:
        return "-"
    return f"{spearmanr(first, second)[0]:.2f}"


def _number(values: NDArray[np.float64]) -> str:
    return f"{values.mean():.2f}" if len(values) else "-"


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("answers.doubt", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--views", type=int, default=4, help="test views of each test member and appearance")
    parser.add_argument("--calibrating", type=int, default=8, metavar="N", help="members, in random splits")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/answers.md")
    options = parser.parse_args(arguments)
    rows, words = [], " ".join(map(str, options.runs))
    for run in map(Run.open, options.runs):
        if run.catalog is None:
            parser.error(f"{run.title}: {run.missing}")
        doubt = Doubt.of(run.surrogate, run.catalog)
        for kind, tested in pictures_of(run, doubt, run.catalog, options.views).items():
            unseen = unseen_of(run, doubt, run.catalog, kind, tested)
            rows.append(row_of(run.title, kind, tested, unseen, options.calibrating))
    command = f"answers.doubt {words} --views {options.views} --calibrating {options.calibrating}"
    body = f"{table(HEADER, rows)}\n<sub>{made_by(command)}</sub>"
    publish(body, RESULTS / "answers.md", "doubt", write=options.write)


if __name__ == "__main__":
    main()
