"""The trainings of the comparison with published systems, and those that are missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from typing import NamedTuple

from research.benchmarks.results.gaps import Gap
from research.studies.baselines import hexplane_gaussians, visnerf
from research.studies.baselines.method import PRECISIONS
from research.studies.comparison.methods import CONTESTANTS, usual
from research.studies.comparison.result import ComparisonResult, MethodRow


class Trainings(NamedTuple):
    """Trainings of each method with `seeds` seeds on each of the scenes, for `minutes` minutes of `threads` threads together."""

    scenes: Sequence[str]
    minutes: float
    seeds: int
    methods: Sequence[str] = usual()
    threads: int = 1


SCENES = ("tgv", "cloverleaf", "nyx")
PROTOCOL = (
    Trainings(SCENES, 5.0, seeds=3),
    Trainings(SCENES, 30.0, seeds=1),
    Trainings(("cloverleaf-large",), 5.0, seeds=1),
    Trainings(("cloverleaf-large",), 30.0, seeds=1),
    Trainings(("tgv-iso",), 5.0, seeds=1, methods=usual("isovalue")),
    Trainings(("tgv-tf",), 5.0, seeds=1, methods=usual("transfer_function")),
    Trainings(
        ("cloverleaf",), 240.0, seeds=1, methods=(hexplane_gaussians.METHOD.name, visnerf.METHOD.name), threads=2
    ),
)


def gaps(results: Mapping[str, Sequence[ComparisonResult]], protocol: Sequence[Trainings] = PROTOCOL) -> list[Gap]:
    """The trainings without a result, by scene; failed ones are missing too."""
    return [gap for trainings in protocol for scene in trainings.scenes for gap in _gaps(scene, trainings, results)]


def _gaps(scene: str, trainings: Trainings, results: Mapping[str, Sequence[ComparisonResult]]) -> Iterator[Gap]:
    made = {(r.row, r.seed) for r in results.get(scene, ()) if r.minutes == trainings.minutes and not r.error}
    missing = {
        method: seeds for method in trainings.methods if (seeds := _missing_seeds(method, trainings.seeds, made))
    }
    if missing:
        options = f"--minutes {trainings.minutes:g} --seeds {trainings.seeds} --methods {','.join(missing)}"
        threads = f" --threads {trainings.threads}" * (trainings.threads > 1)
        what = "; ".join(_named(method, seeds) for method, seeds in missing.items())
        yield Gap(
            scene,
            f"{trainings.minutes:g} min: {what}",
            f"python -m research.studies compare scenes/{scene}.toml {options}{threads}",
        )


def _missing_seeds(method: str, seeds: int, made: Set[tuple[MethodRow, int]]) -> list[int]:
    """The missing seeds of a method, in the precision in which most are trained."""
    rows = [MethodRow(method, precision) for precision in PRECISIONS]
    return min(([seed for seed in range(seeds) if (row, seed) not in made] for row in rows), key=len)


def _named(method: str, seeds: Sequence[int]) -> str:
    plural = "s" * (len(seeds) > 1)
    return f"{CONTESTANTS[method].title.strip('*')} (seed{plural} {', '.join(map(str, seeds))})"
