"""Functions that were never trained have a row of each scene that was asked for them."""

from pathlib import Path

from research.benchmarks.results.functions import functions_section
from research.benchmarks.results.scenes import SceneResults
from research.benchmarks.training.functions.departures import PEAK, TRAINED
from research.benchmarks.training.functions.measured import KIND, VERSION, FunctionScores
from surrogate.storage.records import Provenance, Record

MADE = Provenance("bead", "", {"processor": "abacus", "cores": 1})


def seed(number: int, **psnr: float) -> tuple[Record, list[FunctionScores]]:
    names = {"peak": PEAK}
    rows = [FunctionScores(names.get(n, n), v, v - 5.0, None, 0.9, 20.0, None, 24) for n, v in psnr.items()]
    return Record(KIND, VERSION, {"seed": number}, {}, MADE), rows


def test_means_are_over_functions_and_deviations_over_seeds() -> None:
    seeds = [seed(i, trained=40.0 + i, half=36.0, ramp=24.0 + 2 * i, peak=10.0) for i in range(2)]
    scenes = [SceneResults("a", "A", Path("runs/a"), functions=seeds), SceneResults("b", "B", Path("runs/b"))]
    title, _, rows, source = functions_section(scenes)
    header, _, only = (line.strip("| ").split(" | ") for line in rows.splitlines())
    found = dict(zip(header, only, strict=True))
    assert found["mean"] == "**30.50 ± 0.71**"  # of 30 and 31
    assert found["worst function"] == "**25.00 ± 1.41** (ramp)"
    assert found["half"] == "36.00 ± 0.00 (20.0)"
    assert found[PEAK] == "10.00 ± 0.00 (20.0)"
    assert found[TRAINED] == "40.50 ± 0.71"
    assert (found["seeds"], found["images"]) == ("2", "24")
    assert "seeds 0, 1" in source
    assert "research.benchmarks.training.functions scenes/a.toml" in source
    assert title.startswith("## ")


def test_without_any_there_is_no_section() -> None:
    assert functions_section([SceneResults("b", "B", Path("runs/b"))]) == []
