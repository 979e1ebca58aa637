"""A catalog of six members on a grid, and its server."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from catalogs.browse import CatalogServer, page_of
from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import ImportedImages, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import isovalue_family, transfer_function_family

SIZE = 64
GRID = [(x, y) for x in (0.0, 1.0, 2.0) for y in (-5.0, 5.0)]


def picture(seed: int, opaque: bool = False) -> np.ndarray:
    """Premultiplied noise in four smooth blocks and a transparent border, its own for every seed."""
    random = np.random.default_rng(seed)
    alpha = np.zeros((SIZE, SIZE, 1))
    alpha[8:-8, 8:-8] = 255 if opaque else random.integers(0, 256, (SIZE - 16, SIZE - 16, 1))
    color = random.integers(0, 256, (SIZE, SIZE, 3))
    return np.concatenate([color * alpha // 255, np.full_like(alpha, 255) if opaque else alpha], axis=2).astype(
        np.uint8
    )


def grid_plan(**changes: Any) -> CatalogPlan:
    values: dict[str, Any] = {
        "space": ParameterSpace((Parameter("x", 0.0, 2.0), Parameter("y<b>", -5.0, 5.0, "m/s"))),
        "appearances": (ImportedImages("first"), ImportedImages("second")),
        "cameras": tuple(orbit((1.0, 0.0, 0.0), 1.0, width=SIZE, height=SIZE, frequency=2)),
        "view_splits": tuple(view_splits(42)),
        "bounds": ((0.0, -1.0, -1.0), (2.0, 1.0, 1.0)),
    }
    return CatalogPlan(**{**values, **changes})


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    """Six members on a grid of two parameters, two appearances, 42 views."""
    catalog = Catalog.create(tmp_path_factory.mktemp("grid") / "grid.cdb", grid_plan())
    for number, (x, y) in enumerate(GRID):
        split = "test" if number == 5 else "train"
        with catalog.begin_member(f"m{number}", {"x": x, "y<b>": y}, split=split) as writer:
            for a, appearance in enumerate(catalog.appearance_names):
                for view in range(42):
                    writer.write_image(appearance, view, picture(10000 * number + 1000 * a + view))
    return catalog


FUNCTION = TransferFunction(
    ((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.0, 0.0), (0.3, 0.2), (0.6, 0.5), (1.0, 1.0)), 0.1
)
BASE = VolumeRendering("dvr", FUNCTION)
SHOWN = {"all": None, "some": ("dvr", "dvr-train-07", "iso=0.5"), "isosurfaces": ("iso=0.2", "iso=0.5")}


@pytest.fixture(scope="module")
def varied(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    """Three members of twelve views each: one shows all of 82 appearances, two show some."""
    functions = transfer_function_family(
        BASE, first_step=(0.1, 0.1), second_step=(0.1, 0.25), validation=1, test=1, unit="kg"
    )
    isovalues = isovalue_family("dvr", train=(0.2, 0.8), test=(0.5,))
    plan = grid_plan(
        appearances=(BASE, *functions.appearances, *isovalues.appearances),
        variations=(functions.variation, isovalues.variation),
        cameras=tuple(orbit((1.0, 0.0, 0.0), 1.0, width=8, height=8, frequency=1)),
        view_splits=tuple(view_splits(12)),
    )
    catalog = Catalog.create(tmp_path_factory.mktemp("varied") / "varied.cdb", plan)
    for number, (name, appearances) in enumerate(SHOWN.items()):
        with catalog.begin_member(name, {"x": float(number), "y<b>": 0.0}, appearances=appearances) as writer:
            for appearance, view in writer.missing():
                writer.write_image(appearance, view, np.full((8, 8, 4), view, np.uint8))
    return catalog


@contextmanager
def running(server: CatalogServer) -> Iterator[CatalogServer]:
    """The server, answering."""
    with server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def server(grid: Catalog) -> Iterator[CatalogServer]:
    with running(CatalogServer(grid.path, page_of(grid).encode())) as answering:
        yield answering
