"""Effect of fewer views, and value of the fields' own values in that case.

    python -m research.benchmarks.training.few_views SCENE... [--views 42 92] [--runs runs] [--write]

Trains scenes by their own settings on the images of some of their training views, spread over the sphere, once as they
are and once from images alone. Each is scored on the test images of the whole catalog. The scenes' data sets must
exist. Models are stored in RUNS/<scene>/few_views, and finished ones are not trained again. Prints Markdown; `--write`
puts it into docs/results/values.md.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from catalogs.store.catalog import MEMBERS, Catalog
from catalogs.store.members import RECORD, ROWS, read_member, write_record
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.farthest import farthest_points
from catalogs.vocabulary.scene import Scene
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from research.studies.repeats.run import score_model
from surrogate.evaluation.tables import number
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.training.run import train

PAGE, PART, FOLDER = RESULTS / "values.md", "few views", "few_views"
HEADER = ("scene", "views", "learnt from", "unseen views, dB", "unseen views and parameters, dB", "processor seconds")


def spread_views(cameras: Sequence[Camera], among: Sequence[int], count: int) -> list[int]:
    """`count` of the views `among`, in order, whose directions lie far apart; all where there are no more."""
    places = np.array([cameras[view].position for view in among])  # [V, 3]
    directions = places - places.mean(axis=0)  # [V, 3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return sorted(among[i] for i in farthest_points(directions, count))


def thinned(catalog: Catalog, path: Path, count: int) -> Catalog:
    """A catalog at `path` that shares the images of another, but of whose training views only `count` train; the others test.

    Raises ValueError where the members have cameras of their own.
    """
    plan = catalog.plan
    if not plan.cameras:
        raise ValueError(f"{catalog.path}: its members have cameras of their own")
    train = [view for view, split in enumerate(plan.view_splits) if split == "train"]
    left = set(train) - set(spread_views(plan.cameras, train, count))
    made = Catalog.create(path, replace(plan, view_splits=_without(plan.view_splits, left)))
    for member in catalog.members:
        folder = path / MEMBERS / member.name
        shutil.copytree(member.path, folder, copy_function=os.link, ignore=lambda *_: [RECORD, ROWS])
        thin = replace(member, path=folder, view_splits=_without(member.view_splits, left))
        write_record(thin, made.plan, read_member(member.path, plan)[1])
    made.rebuild_table()
    return made


def _without(splits: Sequence[str], left: set[int]) -> tuple[str, ...]:
    return tuple("test" if view in left else split for view, split in enumerate(splits))


def row(scene: str, views: int, learnt: str, surrogate: Surrogate, catalog: Catalog) -> list[str]:
    """Of the table."""
    psnr = score_model(surrogate, catalog)["cells"]["psnr"]["unseen_views"]
    seconds = surrogate.training["processor_seconds"]
    scores = [number(psnr[column]) for column in ("seen_parameters", "unseen_parameters")]
    return [f"`{scene}`", str(views), learnt, *scores, f"{seconds:.0f}"]


def measured(scene: Scene, run: Path, counts: Sequence[int], say: Callable[[str], None]) -> Iterator[list[str]]:
    """Train a scene's data set in the folder `run` on each number of views, and yield the rows of the table."""
    catalog, base = Catalog.open(run / "catalog.cdb"), TrainingSettings.from_table(scene.training)
    for count in counts:
        with tempfile.TemporaryDirectory(dir=run) as beside:
            few = thinned(catalog, Path(beside) / "catalog.cdb", count)
            for learnt, weight in (("pictures and values", base.field_value_weight), ("pictures alone", 0.0)):
                say(f"{scene.name}, {count} views, {learnt}")
                surrogate = train(base.changed(field_value_weight=weight), few, run / FOLDER / f"{count}-{weight:g}")
                yield row(scene.name, count, learnt, surrogate, catalog)


def main() -> None:
    """Train, score, print."""
    parser, say = command_line("training.few_views", __doc__), stopwatch()
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("--views", type=int, nargs="+", default=[42, 92])
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--write", action="store_true", help="into docs/results/values.md")
    given, rows = parser.parse_args(), list[list[str]]()
    try:
        for scene in map(Scene.load, given.scenes):
            for cells in measured(scene, scene.run_directory(given.runs), given.views, say):
                print(" | ".join(cells), flush=True)
                rows.append(cells)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    words = " ".join(map(str, (*given.scenes, "--views", *given.views)))
    text = f"{table(HEADER, rows)}\n<sub>{made_by(f'training.few_views {words}')}, the scenes' own seeds</sub>"
    publish(text, PAGE, PART, write=given.write)


if __name__ == "__main__":
    main()
