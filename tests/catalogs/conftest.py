"""A small catalog to play with: two members, twelve views of 16x12 pixels."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.files.digests import sealed
from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace

Draw = Callable[[int], NDArray[np.uint8]]


def make_plan(**changes: object) -> CatalogPlan:
    """A plan with one parameter, one volume rendering and one isosurface, twelve views."""
    function = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.0, 0.0), (1.0, 0.5)), 0.1)
    values: dict[str, object] = {
        "space": ParameterSpace((Parameter("Re", 100.0, 200.0), Parameter("Pr", 0.5, 2.0, "m"))),
        "appearances": (VolumeRendering("dvr", function), Isosurface("iso", 0.25)),
        "cameras": tuple(orbit((0.0, 0.0, 0.0), 1.7, width=16, height=12, frequency=1)),
        "view_splits": tuple(view_splits(12)),
        "bounds": ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
    }
    return CatalogPlan(**{**values, **changes})  # type: ignore[arg-type]


def small_plan() -> CatalogPlan:
    """Two views are enough: every kind of file and of moment is there."""
    whole = make_plan()
    return make_plan(cameras=whole.cameras[:2], view_splits=whole.view_splits[:2])


def picture(seed: int, height: int = 12, width: int = 16) -> NDArray[np.uint8]:
    """A valid premultiplied picture, its own for every seed."""
    random = np.random.default_rng(seed)
    alpha = random.integers(0, 256, (height, width, 1))
    return np.concatenate([random.integers(0, 256, (height, width, 3)) * alpha // 255, alpha], axis=2).astype(np.uint8)


def summary(seed: int = 0) -> FieldSummary:
    """A small summary."""
    random = np.random.default_rng(seed)
    points = random.random((5, 3)).astype(np.float32)
    values = random.random(5).astype(np.float32)
    edges = np.linspace(0.0, 1.0, 257)
    even = random.random((3, 3)).astype(np.float32)
    return FieldSummary(0.0, 1.0, 0.01, np.arange(256, dtype=np.int64), edges, points, values, values, even, even[:, 0])


def add_member(catalog: Catalog, name: str, reynolds: float, *, split: str = "train", seed: int = 0) -> None:
    """Write a whole member."""
    with catalog.begin_member(name, {"Re": reynolds, "Pr": 1.0}, split=split) as writer:
        for a, appearance in enumerate(catalog.appearance_names):
            for view in range(len(catalog.plan.cameras)):
                writer.write_image(appearance, view, picture(1000 * seed + 100 * a + view))
        writer.write_summaries({"": summary(seed)})


def rewrite_record(member: Path, **changes: object) -> None:
    """Change values in a member's record as a program would: with a right digest."""
    record = json.loads((member / "member.json").read_text())
    record.pop("digest")
    (member / "member.json").write_bytes(sealed({**record, **changes}))


@pytest.fixture(scope="session")
def small_catalog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A catalog of a training and a test member, to be copied."""
    return _small(tmp_path_factory.mktemp("catalogs")).path


@pytest.fixture
def catalog(tmp_path: Path, small_catalog: Path) -> Catalog:
    """A catalog of a training and a test member."""
    return Catalog.open(shutil.copytree(small_catalog, tmp_path / "small.cdb"))


@pytest.fixture
def created_catalog(tmp_path: Path) -> Catalog:
    """The same, as its creator has it open."""
    return _small(tmp_path)


def _small(folder: Path) -> Catalog:
    made = Catalog.create(folder / "small.cdb", make_plan())
    add_member(made, "first", 120.0, seed=1)
    add_member(made, "second", 180.0, split="test", seed=2)
    return made


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder in memory where the system has such a place, for tests that sync thousands of times."""
    memory = Path("/dev/shm")
    place = Path(tempfile.mkdtemp(dir=memory if os.access(memory, os.W_OK) else None))
    yield place
    shutil.rmtree(place)
