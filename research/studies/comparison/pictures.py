"""The same test images as rendered by every method, stored beside the records of results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files import durable
from catalogs.files.images import encode_png, read_image, to_bytes
from research.studies.comparison.result import FOLDER
from research.studies.comparison.task import ComparisonTask
from surrogate.evaluation.cases import Case
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.evaluation.predictor import Predictor

PICTURES, TRUTH = "pictures", "truth"  # the folder beside records, and the name of the catalog's own images
SHOWN = (1 / 3, 2 / 3)  # positions in the last cell of the images that are stored


def shown_cases(task: ComparisonTask) -> list[Case]:
    """The stored test images: fixed positions in the last cell, at unseen views and parameters."""
    cell = list(task.cells.values())[-1]
    return [cell[int(part * len(cell))] for part in SHOWN]


def keep_truth(records: Path, task: ComparisonTask) -> None:
    """Store the catalog's own images in a scene's records."""
    for number, case in enumerate(shown_cases(task)):
        _write(path_of(records, TRUTH, number), task.catalog.image(case.member, case.appearance, case.view), task)


def keep_drawn(records: Path, name: str, predictor: Predictor, task: ComparisonTask) -> None:
    """Store the images that a method renders; `name` is that of its result."""
    for number, case in enumerate(shown_cases(task)):
        [(_, draw)] = predictor.batches([case])
        _write(path_of(records, name, number), next(iter(draw(case))), task)


def path_of(records: Path, name: str, number: int) -> Path:
    """Path of a stored image: a PNG file, over the background."""
    return records / FOLDER / PICTURES / f"{name}.{number}.png"


def are_kept(records: Path, name: str) -> bool:
    """True if all images of the result `name`, or of `TRUTH`, are stored."""
    return all(path.is_file() for path in _paths(records, name))


def stored_images(records: Path, name: str) -> Sequence[NDArray[np.float32]]:
    """The images (H, W, 3), in [0, 1], of the result `name`, or of `TRUTH`; empty where one is missing."""
    if not are_kept(records, name):
        return []
    return [read_image(path, dtype="float32")[..., :3] for path in _paths(records, name)]


def _paths(records: Path, name: str) -> list[Path]:
    return [path_of(records, name, number) for number in range(len(SHOWN))]


def _write(path: Path, rgba: Any, task: ComparisonTask) -> None:
    durable.make_folder(path.parent)
    durable.replace(path, encode_png(to_bytes(composite(rgba, task.catalog.plan.background or WHITE))))
