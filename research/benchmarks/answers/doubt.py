"""Intervals of pictures' PSNR, and maps of expected errors, against test members.

    python -m research.benchmarks.answers.doubt RUN [RUN ...] [--views 4] [--write]

Each RUN is a folder with an emulated field, whose catalog is there. Prints Markdown. Test members are shown at test
views, in the base appearance and one other of each kind. Columns are the rank correlation of expected and true PSNR of
members, the mean absolute difference for pictures and the coverage, each beside that of the lookup among near
measurements. The last is the area between the sparsification curves of map and truth, over the mean error. A map without
knowledge has about 0.5.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from research.benchmarks.page import DOCS, command_line, fill, made_by, table
from surrogate.answers.doubt import Doubt
from surrogate.answers.maps import error_map
from surrogate.answers.unseen import cases_of
from surrogate.evaluation.metrics import WHITE, composite, foreground, psnr
from surrogate.evaluation.scoring import spread
from surrogate.explore.reliability.expectation import Expectation, measure
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.splatting.threads import one_torch_thread

FRACTIONS = np.linspace(0.0, 0.95, 20)  # of pixels that are taken away
FEWEST, SAME = 4, 0.2  # members and dB, of which a rank says something
HEADER = [
    "run",
    "shown",
    "members",
    "PSNR, dB",
    "Spearman (lookup)",
    "off, dB (lookup)",
    "half width, dB (lookup)",
    "promised",
    "covers (lookup)",
    "sparsification (image gradient)",
    "interval / map, ms beside drawing",
]


@dataclass(frozen=True)
class TestPicture:
    """One picture of a test member: the truth, the interval, and what the lookup says, dB; NaN where it says nothing."""

    member: str
    truth: float
    expected: float
    half: float
    share: float
    lookup: float
    said: float
    sparse: float
    gradient: float
    milliseconds: tuple[float, float]


def pictures_of(run: Run, views: int) -> dict[str, list[TestPicture]]:
    """Those of a run, by kind."""
    surrogate, catalog = run.surrogate, run.catalog
    assert catalog is not None
    assert surrogate.field is not None
    doubt, expectation = Doubt.of(surrogate, catalog), measure(replace(run, folder=None))  # both anew
    found: dict[str, list[TestPicture]] = {}
    for case in cases_of(surrogate.field, [member for member in catalog.members if member.split == "test"]):
        tested = [view for view, split in enumerate(case.member.view_splits) if split == "test"]
        for view in (tested[i] for i in spread(len(tested), views)):
            camera, setting = case.member.cameras[view], Setting(case.member.parameters, case.varied)
            stored = catalog.image(case.member, case.appearance, view)
            truth = composite(stored, catalog.plan.background or WHITE)
            seconds = [time.perf_counter()]
            picture = surrogate.at(case.parameters, outside="allow").render(camera)
            seconds.append(time.perf_counter())
            interval = doubt.interval(case.parameters, camera)
            seconds.append(time.perf_counter())
            errors = error_map(doubt, case.parameters, camera)
            seconds.append(time.perf_counter())
            drawing, asking, mapping = np.diff(seconds) * 1e3
            displayed = composite(picture, catalog.plan.background or WHITE)
            wrong = np.abs(displayed - truth).mean(-1)
            mask = foreground(stored, catalog.plan.background)
            slopes = np.linalg.norm(np.gradient(displayed.mean(-1)), axis=0)
            found.setdefault(case.kind, []).append(
                TestPicture(
                    case.member.name,
                    psnr(truth, displayed),
                    np.nan if interval.psnr is None else interval.psnr,
                    np.nan if interval.psnr is None or interval.low is None else interval.psnr - interval.low,
                    interval.share or np.nan,
                    *_lookup(expectation, setting, run),
                    sparsification(errors[mask], wrong[mask]),
                    sparsification(slopes[mask], wrong[mask]),
                    (max(asking - drawing, 0.0), max(mapping - drawing, 0.0)),
                )
            )
    return found


def _lookup(expectation: Expectation, setting: Setting, run: Run) -> tuple[float, float]:
    expected = expectation.at(setting, run.surrogate)
    return expected.psnr or np.nan, expected.error or np.nan


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


def row_of(run: str, kind: str, found: Sequence[TestPicture]) -> list[str]:
    """A row of the table."""
    members = sorted({one.member for one in found})
    values = {
        name: np.array([getattr(one, name) for one in found])
        for name in ("truth", "expected", "half", "lookup", "said")
    }
    means = {
        name: np.array([np.mean([getattr(one, name) for one in found if one.member == m]) for m in members])
        for name in ("truth", "expected", "lookup")
    }
    off, lookup = np.abs(values["truth"] - values["expected"]), np.abs(values["truth"] - values["lookup"])

    def rank(name: str) -> str:
        both = np.isfinite(means[name])
        first, second = means["truth"][both], means[name][both]
        if len(first) < FEWEST or min(first.std(), second.std()) < SAME:
            return "-"
        return f"{spearmanr(first, second)[0]:.2f}"

    asking, mapping = np.median([one.milliseconds for one in found], axis=0)
    sparse, slopes = np.nanmean([(one.sparse, one.gradient) for one in found], axis=0)
    return [
        run,
        kind.replace("_", " "),
        str(len(members)),
        f"{values['truth'].mean():.1f} ± {means['truth'].std():.1f}",
        f"{rank('expected')} ({rank('lookup')})",
        f"{_mean(off)} ({_mean(lookup)})",
        f"{_mean(values['half'])} ({_mean(values['said'])})",
        f"{np.nanmean([one.share for one in found]):.0%}",
        f"{_within(off, values['half'])} ({_within(lookup, values['said'])})",
        f"{sparse:.2f} ({slopes:.2f})",
        f"{asking:.0f} / {mapping:.0f}",
    ]


def _mean(values: NDArray[np.float64]) -> str:
    known = values[np.isfinite(values)]
    return f"{known.mean():.2f}" if len(known) else "-"


def _within(off: NDArray[np.float64], half: NDArray[np.float64]) -> str:
    said = np.isfinite(off) & np.isfinite(half)
    return f"{(off[said] <= half[said]).mean():.0%}" if said.any() else "-"


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("answers.doubt", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--views", type=int, default=4, help="test views of each test member and appearance")
    parser.add_argument("--write", action="store_true", help="write the table into docs/answers.md")
    options = parser.parse_args(arguments)
    rows, words = [], " ".join(map(str, options.runs))
    for run in map(Run.open, options.runs):
        rows += [row_of(run.title, kind, found) for kind, found in pictures_of(run, options.views).items()]
    body = f"{table(HEADER, rows)}\n<sub>{made_by(f'answers.doubt {words} --views {options.views}')}</sub>"
    print(body)
    if options.write:
        fill(DOCS / "answers.md", "doubt", body)


if __name__ == "__main__":
    main()
