"""A small ensemble beside the scenes, with a surrogate: two blobs, of which the second is seen through the first.

    python -m research.benchmarks.answers.blobs RUN

Makes the folder RUN.  Three parameters move one blob, widen the other, and change what lies in the dark (which no picture shows).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import fingerprint
from surrogate.storage.runs import RunRecord
from surrogate.training.run import train

SPACE = ParameterSpace(
    (Parameter("place", 0.0, 1.0), Parameter("width", 0.1, 0.4, scale="log"), Parameter("hidden", 0.0, 1.0))
)
MEMBERS = {"train": 24, "validation": 8, "test": 16}
SIDE = 32
FUNCTION = TransferFunction(
    ((0.0, 0.1, 0.2, 0.8), (1.0, 0.9, 0.5, 0.1), (2.0, 1.0, 1.0, 0.6)), ((0.0, 0.0), (0.3, 0.0), (2.0, 0.8)), 0.3
)


def field_at(place: float, width: float, hidden: float) -> NDArray[np.float32]:
    """The field [Z, Y, X] on the unit cube."""
    z, y, x = np.meshgrid(*[np.linspace(0.0, 1.0, SIDE)] * 3, indexing="ij")
    first = np.exp(-((x - 0.3 - 0.4 * place) ** 2 + (y - 0.4) ** 2 + (z - 0.5) ** 2) / 0.02)
    second = np.exp(-((x - 0.5) ** 2 + (y - 0.65) ** 2 + (z - 0.5 - 0.1 * np.sin(5.0 * place)) ** 2) / width**2)
    dark = 0.25 * hidden * np.cos(9.0 * z) ** 2  # below what the transfer function shows
    return np.maximum(first + second, dark).astype(np.float32)


def main(arguments: Sequence[str] | None = None) -> None:
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m research.benchmarks.answers.blobs", description=__doc__, formatter_class=form
    )
    parser.add_argument("run", type=Path, metavar="RUN")
    folder = parser.parse_args(arguments).run
    appearances = [VolumeRendering("dvr", FUNCTION)]
    views = ViewPlan(frequency=2, width=64, height=64)
    with insitu.Session(folder / "catalog.cdb", space=SPACE, appearances=appearances, views=views) as session:
        for seed, (split, count) in enumerate(MEMBERS.items()):
            for row in SPACE.latin_hypercube(count, seed):
                parameters = dict(zip(SPACE.names, map(float, row), strict=True))
                session.render_member(field_at(**parameters), parameters, spacing=(1.0 / (SIDE - 1),) * 3, split=split)
    catalog, settings = Catalog.open(folder / "catalog.cdb"), TrainingSettings()
    train(settings, catalog, folder / "surrogate", only_field=True)
    RunRecord("catalog.cdb", settings.to_json(), catalog.splits, fingerprint(settings, catalog)).save(folder)


if __name__ == "__main__":
    main()
