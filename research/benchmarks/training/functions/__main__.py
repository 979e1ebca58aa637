"""A surrogate under transfer functions that it was never trained with, against the field itself.

    python -m research.benchmarks.training.functions SCENE RUN [RUN ...] [--members N] [--views M] [--records DIRECTORY]

Reads or simulates test members of a scene again and renders them at test views. The transfer functions are seven that
depart from the trained one, and a narrow peak, which is reported separately. The images are stored in the first RUN's
folder. Each RUN holds one seed of the scene's surrogate. Prints Markdown, and stores a record of each seed in RUN, or
below DIRECTORY: in research/records, `python -m research.benchmarks.results` finds it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.scene import Scene
from research.benchmarks.page import command_line, made_by, stopwatch
from research.benchmarks.training.functions.departures import KNOWN_MARKS, TRAINED, Marks, departures
from research.benchmarks.training.functions.measured import FunctionScores, rows_table, save, shown
from research.benchmarks.training.functions.truth import TruthRequest, truth
from surrogate.evaluation.novelty import SeenValues
from surrogate.model import Surrogate
from surrogate.storage.runs import RunFolder


def base_of(catalog: Catalog, surrogate: Surrogate) -> VolumeRendering:
    """The appearance that was trained; raises ValueError unless it is a volume rendering."""
    name = str(surrogate.training["appearance"])
    base = next((a for a in catalog.plan.appearances if a.name == name), None)
    if not isinstance(base, VolumeRendering):
        raise ValueError(f"{catalog.path}: {name} is not a volume rendering, so it has no transfer function")
    return base


def functions_of(scene: Scene, base: VolumeRendering, seen: SeenValues | None) -> dict[str, TransferFunction]:
    """The trained function and the tested ones, by name."""
    marks = KNOWN_MARKS.get(scene.name)
    if marks is None:
        if seen is None:
            raise ValueError(f"scene {scene.name}: its members have no summaries, so their values are unknown")
        marks = Marks.of(seen, base.transfer_function)
    return {TRAINED: base.transfer_function, **departures(base.transfer_function, marks)}


def main() -> None:
    """Measure, print, and keep."""
    parser, say = command_line("training.functions", __doc__), stopwatch()
    parser.add_argument("scene", type=Path)
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    parser.add_argument("--members", type=int, default=6, help="test members, evenly spread (default: 6)")
    parser.add_argument("--views", type=int, default=4, help="test views of each, evenly spread (default: 4)")
    parser.add_argument("--records", type=Path, help="folder of the scenes' records; default: RUN itself")
    given = parser.parse_args()
    try:
        print(measured(given.scene, given.runs, given.members, given.views, given.records, say))
    except (ValueError, OSError) as error:
        parser.error(str(error))


def measured(
    scene: Path, runs: Sequence[Path], members: int, views: int, records: Path | None, say: Callable[[str], None]
) -> str:
    """The table in Markdown; records are stored on the way. Raises ValueError or OSError where something is missing."""
    description, opened = Scene.load(scene), [RunFolder.open(run) for run in runs]
    surrogates = [Surrogate.load(run.model) for run in opened]
    catalog = opened[0].catalog
    base, seen = base_of(catalog, surrogates[0]), SeenValues.of_training(catalog, surrogates[0])
    functions = functions_of(description, base, seen)
    for surrogate in surrogates:  # fails at once if impossible
        surrogate.under(functions[TRAINED], outside="allow", **surrogate.space.middle)
    numbers = [surrogate.training["settings"]["seed"] for surrogate in surrogates]
    if records is not None and len(set(numbers)) < len(numbers):
        raise ValueError(f"each RUN must hold another seed, whose record it is kept in, got the seeds {numbers}")
    wanted = TruthRequest.of(description, catalog, base, functions, members, views)
    pictures = truth(wanted, runs[0], say)
    names = [member.name for member in wanted.members]
    about = {"members": names, "views": list(wanted.views)}
    seeds: list[list[FunctionScores]] = []
    for run, surrogate in zip(runs, surrogates, strict=True):
        say(f"scoring {run}")
        begun = time.process_time()
        seeds.append(shown(surrogate, pictures, names, functions, seen))
        folder = run if records is None else records / description.name
        say(f"kept in {save(folder, surrogate, seeds[-1], about, time.process_time() - begun)}")
    text = (
        f"{len(names)} test members of `{description.name}` at {len(wanted.views)} test views each; {len(runs)} seeds."
    )
    command = f"training.functions {scene} {' '.join(map(str, runs))} --members {members} --views {views}"
    return f"{text}\n\n{rows_table(seeds)}\n<sub>{made_by(command)}</sub>"


if __name__ == "__main__":
    main()
