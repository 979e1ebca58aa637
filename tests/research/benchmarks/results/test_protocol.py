"""Missing parts of the comparison are named with the command that makes them."""

from __future__ import annotations

from research.benchmarks.results.gaps import Gap
from research.benchmarks.results.protocol import PROTOCOL, Trainings, gaps
from research.studies.baselines.method import Precision
from research.studies.comparison.methods import usual
from research.studies.comparison.result import ComparisonResult

SOME = (
    Trainings(("one", "two"), 5.0, seeds=2, methods=("ours", "visnerf")),
    Trainings(("one",), 240.0, seeds=1, methods=("visnerf",), threads=2),
)


def result(
    method: str, minutes: float, seed: int, error: str = "", precision: Precision = "float32"
) -> ComparisonResult:
    return ComparisonResult(method, minutes, seed, "small", precision, "mark", error=error)


def test_what_no_result_is_of_is_missing() -> None:
    of_one = [
        result("ours", 5.0, 0),
        result("ours", 5.0, 1),
        result("visnerf", 5.0, 0),
        result("visnerf", 5.0, 1, error="Diverged: its loss is nan"),
        result("visnerf", 30.0, 0),
    ]
    command = "python -m research.studies compare scenes/{}.toml --minutes {} --seeds {} --methods {}"
    assert gaps({"one": of_one}, SOME) == [
        Gap("one", "5 min: ViSNeRF (seed 1)", command.format("one", 5, 2, "visnerf")),
        Gap(
            "two",
            "5 min: this surrogate (seeds 0, 1); ViSNeRF (seeds 0, 1)",
            command.format("two", 5, 2, "ours,visnerf"),
        ),
        Gap("one", "240 min: ViSNeRF (seed 0)", command.format("one", 240, 1, "visnerf") + " --threads 2"),
    ]


def test_all_seeds_are_asked_for_in_one_precision() -> None:
    asked = (Trainings(("one",), 5.0, seeds=3, methods=("insitunet",)),)
    found = [result("insitunet", 5.0, 0, precision="bfloat16"), *(result("insitunet", 5.0, seed) for seed in (1, 2))]
    assert [gap.what for gap in gaps({"one": found}, asked)] == ["5 min: InSituNet (seed 0)"]
    assert gaps({"one": [*found, result("insitunet", 5.0, 0)]}, asked) == []


def test_nothing_is_missing_once_all_is_there() -> None:
    whole = {
        scene: [
            result(method, trainings.minutes, seed)
            for trainings in PROTOCOL
            if scene in trainings.scenes
            for method in trainings.methods
            for seed in range(trainings.seeds)
        ]
        for scene in {scene for trainings in PROTOCOL for scene in trainings.scenes}
    }
    assert gaps(whole) == []
    assert len([gap for gap in gaps({}) if gap.what.startswith("5 min: ")]) == 6
    assert len(whole["cloverleaf"]) == 4 * len(usual()) + 2
