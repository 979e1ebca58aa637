"""Agreement of the explorer's expected error with measurements at test members.

    python -m research.benchmarks.explorer.expectation [RUN ...] [--views 8] [--write]

Each RUN is a folder such as runs/tgv-tf, by default all trained ones of the five scenes. Prints Markdown. The first
table led to the number of neighbours: each measurement is predicted from the others, without its member and setting.
The second is a report only: test members, in the base appearance and all their settings, at test views.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from research.benchmarks.page import DOCS, PROJECT, command_line, fill, made_by, table
from surrogate import Surrogate
from surrogate.evaluation.scoring import spread
from surrogate.explore.reliability.calibration import NEAREST, MeasuredFamily, families_of
from surrogate.explore.reliability.expectation import Expectation, measure
from surrogate.explore.reliability.measuring import psnr_of
from surrogate.explore.reliability.points import ISOSURFACES, appearances_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.splatting.threads import one_torch_thread

SCENES = ("tgv-dvr", "cloverleaf", "nyx", "tgv-iso", "tgv-tf")
TRIED = (1, 2, 3, 4, 5, 8, 15)


@dataclass(frozen=True, eq=False)
class ExpectationAgreement:
    """Expected and measured errors at T test members and appearances.

    Attributes
    ----------
    expected, measured : (T,) dB, the latter the mean over views.
    said : (T,) the announced mean absolute difference to single images, dB.
    single : (T,) the measured one, dB.
    distances : (T,) distances to the nearest training member.
    """

    expected: NDArray[np.float64]
    measured: NDArray[np.float64]
    said: NDArray[np.float64]
    single: NDArray[np.float64]
    distances: NDArray[np.float64]


def agreements(run: Run, expectation: Expectation, views: int) -> dict[str, ExpectationAgreement]:
    """Agreements by family, at `views` test views of each test member and appearance."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    surrogate, catalog = run.surrogate, run.catalog
    for member in (m for m in run.members if m.split == "test"):
        tested = [i for i, split in enumerate(member.view_splits) if split == "test"]
        chosen = [tested[i] for i in spread(len(tested), views)]
        for appearance, varied in appearances_of(surrogate).items():
            if appearance not in member.appearances or not chosen:
                continue
            setting = Setting(member.parameters, varied)
            expected, deformed = expectation.at(setting, surrogate), setting.member(surrogate)
            if expected.psnr is None or expected.training_distance is None:
                continue
            scores = [psnr_of(deformed, catalog, member, appearance, view) for view in chosen]
            family = "isosurfaces" if "isovalue" in varied else "transfer functions" if varied else "base"
            single = float(np.abs(np.array(scores) - expected.psnr).mean())
            row = (expected.psnr, float(np.mean(scores)), expected.error or np.nan, single, expected.training_distance)
            rows.setdefault(family, []).append(row)
    return {family: ExpectationAgreement(*np.array(values).T) for family, values in rows.items()}


def chosen_by(run: str, expectation: Expectation, surrogate: Surrogate) -> list[list[str]]:
    """Rows of the first table: mean absolute difference of left-out measurements for each number of neighbours."""
    families = {nearest: families_of(expectation.measured, surrogate, nearest) for nearest in TRIED}
    rows = []
    for key, measured in families[NEAREST].items():
        count = f"{measured.unseen.sum()} + {(~measured.unseen).sum()}"
        name = "isosurfaces" if key[0] == ISOSURFACES else "volume"
        gap = "" if measured.gap is None else f"{measured.gap:.2f}"
        rows.append([run, name, count, gap, *(_left_out(families[nearest][key]) for nearest in TRIED)])
    return rows


def _left_out(measured: MeasuredFamily) -> str:
    differences = measured.left_out - measured.adjusted
    return f"{np.nanmean(np.abs(differences)):.2f}" if np.isfinite(differences).any() else ""


def reported(run: str, agreements: Mapping[str, ExpectationAgreement]) -> list[list[str]]:
    """Rows of the second table."""
    return [
        [
            run,
            family,
            str(len(a.measured)),
            f"{a.expected.mean():.2f}",
            f"{a.measured.mean():.2f} ± {a.measured.std():.2f}",
            f"{np.abs(a.expected - a.measured).mean():.2f}",
            f"{a.single.mean():.2f} ({a.said.mean():.2f})",
            _correlation(a.expected, a.measured),
            _correlation(a.distances, a.measured),
        ]
        for family, a in agreements.items()
    ]


def _correlation(first: NDArray[np.float64], second: NDArray[np.float64]) -> str:
    if len(first) < 3 or min(first.std(), second.std()) < 1e-9:
        return ""
    return f"{np.corrcoef(first, second)[0, 1]:.2f}"


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("explorer.expectation", __doc__)
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN")
    parser.add_argument("--views", type=int, default=8, help="test views of each test member and appearance")
    parser.add_argument("--write", action="store_true", help="write the second table into docs/explorer.md")
    options = parser.parse_args(arguments)
    runs = options.runs or [run for s in SCENES if Surrogate.exists((run := PROJECT / "runs" / s) / "surrogate")]
    choices, reports, times = [], [], []
    for run in map(Run.open, runs):
        wall, processor = time.perf_counter(), time.process_time()
        expectation = measure(replace(run, folder=None))  # anew
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        times.append(f"{run.title} {wall:.1f} ({processor:.1f})")
        choices += chosen_by(run.title, expectation, run.surrogate)
        reports += reported(run.title, agreements(run, expectation, options.views))
    columns = [f"{k}{' (taken)' if k == NEAREST else ''}" for k in TRIED]
    choice = table(["run", "family", "validation + training", "gap, dB", *columns], choices)
    header = ["run", "shown", "cases", "expected, dB", "measured, dB", "mean absolute difference, dB"]
    body = table([*header, "of single pictures (said)", "correlation", "that of the distance to training"], reports)
    print(f"Mean absolute difference (dB) of what was left out, by the number of neighbours:\n\n{choice}")
    print(f"At test members and test views:\n\n{body}")
    print(
        f"Seconds that measuring took, wall clock (processor): {'; '.join(times)}.\n{made_by('explorer.expectation')}"
    )
    if options.write:
        fill(DOCS / "explorer.md", "expectation", f"{body}\n{made_by('explorer.expectation')}")


if __name__ == "__main__":
    main()
