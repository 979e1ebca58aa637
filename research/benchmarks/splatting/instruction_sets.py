"""Differences of results between machines: scenes trained and scored with the instruction sets of older processors.

    python -m research.benchmarks.splatting.instruction_sets SCENE... [--sets avx2 baseline] [--seeds 2] [--runs
    runs] [--records research/records]

Trains scenes by their own settings with successive seeds, as `python -m research.studies repeat` does,
while the kernels and torch use no later instructions than the set has.  The scenes' data sets must exist.  Each training
is recorded at once, a recorded one is skipped, and `python -m research.benchmarks.results` writes the table.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.scene import Scene
from native import kernels
from research.benchmarks.page import PROJECT, command_line, stopwatch
from research.studies.repeats.run import repeat
from research.studies.repeats.seeds import Scores, load_scores
from surrogate.settings import TrainingSettings

FOLDER = "instruction_sets"  # of a scene's records, and of the models
TORCH = {"avx512": "avx512", "avx2": "avx2", "baseline": "default"}  # what torch calls them


def emulated(name: str) -> dict[str, str]:
    """The environment in which kernels and torch use no later instructions than those of the set `name`.

    Raises ValueError for a set that this machine lacks.
    """
    if name not in kernels.instruction_sets():
        raise ValueError(f"this machine has the instruction sets {', '.join(kernels.instruction_sets())}, not {name!r}")
    return {"GS_SURROGATE_INSTRUCTION_SET": name} | ({"ATEN_CPU_CAPABILITY": TORCH[name]} if name in TORCH else {})


def load(records: Path, settings: Mapping[str, Any]) -> dict[str, list[Scores]]:
    """Stored scores of a scene with these settings, by set and seed; `records` is the folder of its records."""
    folders = sorted(path for path in (records / FOLDER).glob("*") if path.is_dir())
    by_set = {folder.name: load_scores(folder, settings=settings) for folder in folders}
    return {name: scores for name, scores in by_set.items() if scores}


def measure(path: Path, name: str, seeds: int, runs: Path, records: Path) -> None:
    """Train a scene with an instruction set, in its own process, because torch chooses one per process.

    Raises ValueError where this machine lacks the set or training fails.
    """
    environment = emulated(name)
    if environment.items() <= os.environ.items():
        scene = Scene.load(path)
        run, folder = scene.run_directory(runs), records / scene.name / FOLDER / name
        settings = TrainingSettings.from_table(scene.training)
        repeat(settings, Catalog.open(run / "catalog.cdb"), run / FOLDER / name, records=folder, seeds=seeds)
        return
    options = ["--sets", name, "--seeds", seeds, "--runs", runs.resolve(), "--records", records.resolve()]
    words = [sys.executable, "-m", "research.benchmarks.splatting.instruction_sets", path.resolve(), *options]
    if subprocess.run(
        [*map(str, words)], cwd=PROJECT, env=os.environ | environment, stdout=subprocess.DEVNULL
    ).returncode:
        raise ValueError(f"{path}: training with {name} failed, as is said above")


def in_words(scores: Mapping[str, list[Scores]]) -> str:
    """A line for each set, for the terminal."""
    lines = []
    for name, seeds in scores.items():
        psnr = [one.cells["psnr"]["unseen_views"]["unseen_parameters"] for one in seeds]
        lines.append(f"{name}: {', '.join(f'{value:.2f}' for value in psnr)} dB")
    return "\n".join(lines)


def main() -> None:
    """Train, keep and print."""
    parser, say = command_line("splatting.instruction_sets", __doc__), stopwatch()
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument(
        "--sets", nargs="+", default=list(kernels.instruction_sets()[1:]), help="default: all but the best"
    )
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of the data sets (default: runs)")
    parser.add_argument(
        "--records", type=Path, default=PROJECT / "research" / "records", help="folder of the scenes' records"
    )
    given = parser.parse_args()
    try:
        for path in given.scenes:
            for name in given.sets:
                say(f"{path.stem}, {name}")
                measure(path, name, given.seeds, given.runs, given.records)
            scene = Scene.load(path)
            print(
                in_words(load(given.records / scene.name, TrainingSettings.from_table(scene.training).to_json())),
                flush=True,
            )
    except (ValueError, OSError, RuntimeError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
