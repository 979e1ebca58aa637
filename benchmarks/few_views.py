"""What fewer views cost, and what the fields' own values are worth then.

    python -m benchmarks.few_views SCENE [--views 42 92] [--runs runs] [--write]

Trains a scene by its own settings on the pictures of some of its training views, spread over the sphere, once as it is and once
from pictures alone, and scores each on the test images of the whole catalog.  The scene's data set must be there; models are kept
in RUNS/<scene>/few_views, and what is finished is not trained again.  Prints Markdown; `--write` puts it into docs/values.md.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.page import DOCS, command_line, fill, made_by, stopwatch, table
from catalogs.cameras import Camera
from catalogs.catalog import MEMBERS, Catalog
from catalogs.farthest import farthest_points
from catalogs.members import RECORD, ROWS, write_record
from catalogs.scene import Scene
from surrogate.evaluation.tables import number
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.studies.repeats.run import score_model
from surrogate.training.run import train

PAGE, PART, FOLDER = DOCS / "values.md", "few views", "few_views"
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
        write_record(replace(member, path=folder, view_splits=_without(member.view_splits, left)), made.plan)
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


def main() -> None:
    """Train, score, print."""
    parser, say = command_line("few_views", __doc__), stopwatch()
    parser.add_argument("scene", type=Path)
    parser.add_argument("--views", type=int, nargs="+", default=[42, 92])
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--write", action="store_true", help="into docs/values.md")
    given = parser.parse_args()
    try:
        scene = Scene.load(given.scene)
        run = scene.run_directory(given.runs)
        catalog, base = Catalog.open(run / "catalog.cdb"), TrainingSettings(**scene.training)
        rows = []
        for views in given.views:
            with tempfile.TemporaryDirectory(dir=run) as beside:
                few = thinned(catalog, Path(beside) / "catalog.cdb", views)
                for learnt, weight in (("pictures and values", base.loss.values), ("pictures alone", 0.0)):
                    say(f"{scene.name}, {views} views, {learnt}")
                    settings = base.changed(field_value_weight=weight)
                    surrogate = train(settings, few, run / FOLDER / f"{views}-{weight:g}")
                    rows.append(row(scene.name, views, learnt, surrogate, catalog))
                    print(" | ".join(rows[-1]), flush=True)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    made = made_by(f"few_views {given.scene} --views {' '.join(map(str, given.views))}")
    text = f"{table(HEADER, rows)}\n<sub>{made}, seed {base.seed}</sub>"
    print(text)
    if given.write:
        fill(PAGE, PART, text)


if __name__ == "__main__":
    main()
