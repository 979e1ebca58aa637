"""A sample distance that a trivial first member would spoil, and members that are harder than those it was chosen on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from insitu import Session
from render import choose_sample_distance, to_grid
from render.quality import psnr
from render.steepness import mean_change
from tests.support.raymarch import march

COLORS = ((-1.0, 0.1, 0.2, 0.9), (0.0, 0.9, 0.9, 0.8), (1.0, 0.9, 0.1, 0.0))
PEAKS = VolumeRendering("peaks", TransferFunction(COLORS, ((-0.2, 0.0), (0.1, 0.9), (0.4, 0.0), (1.0, 0.0)), 0.3))
SIZE, SPACING, TARGET = 24, 1 / 23, 40.0


def waves(number: float, size: int = SIZE) -> np.ndarray:
    """Values from -1 to 1 with `number` waves along each axis."""
    z, y, x = np.meshgrid(*[np.linspace(0, 2 * np.pi * number, size)] * 3, indexing="ij")
    return (np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)) / 1.5


def rest() -> np.ndarray:
    return np.full((SIZE, SIZE, SIZE), -0.9)


def session(path: Path, heard: list[str], **options: Any) -> Session:
    return Session(
        path / "a.cdb",
        space={"a": (0.0, 9.0)},
        appearances=PEAKS,
        views=ViewPlan(frequency=1, width=48, height=48),
        warn=lambda note: None if "are to learn from" in str(note) else heard.append(str(note)),
        **{"target_decibels": TARGET, **options},
    )


def decibels(catalog: Catalog, member: str, field: np.ndarray) -> float:
    """Of all stored pictures of a member against the float64 ray-marcher."""
    grid = to_grid(field, spacing=SPACING)
    views = range(0, len(catalog.plan.cameras), 12)
    truth = np.stack([march(grid, PEAKS, catalog.plan.cameras[v], SPACING / 16) for v in views])
    return psnr(catalog.images(member, "peaks", list(views)) / 255.0, truth)


def test_a_field_at_rest_does_not_fix_the_distance_for_those_that_move(tmp_path: Path) -> None:
    heard: list[str] = []
    with session(tmp_path, heard) as hook:
        hook.render_member(rest(), {"a": 0.0}, name="rest", spacing=(SPACING,) * 3)
        hook.render_member(waves(1.0), {"a": 1.0}, name="waves", spacing=(SPACING,) * 3)
    catalog = Catalog.open(tmp_path / "a.cdb")
    assert catalog.plan.provenance["measured_decibels"]["peaks"] < 60
    assert catalog.plan.provenance["sample_distances"]["peaks"] < SPACING
    assert decibels(catalog, "waves", waves(1.0)) > TARGET
    assert not [note for note in heard if "sample distance" in note]


def test_a_harder_member_is_measured_again_and_drawn_more_finely(tmp_path: Path) -> None:
    heard: list[str] = []
    with session(tmp_path, heard) as hook:
        hook.render_member(waves(0.75), {"a": 0.0}, spacing=(SPACING,) * 3)
        again = hook.render_member(0.95 * waves(0.75), {"a": 1.0}, spacing=(SPACING,) * 3)
        hard = hook.render_member(waves(3.0), {"a": 2.0}, name="hard", spacing=(SPACING,) * 3)
    catalog = Catalog.open(tmp_path / "a.cdb")
    planned = catalog.plan.provenance["sample_distances"]["peaks"]
    assert again.warnings == ()
    assert len(heard) == 1
    assert f"peaks: the catalog's sample distance {planned:g} gives" in heard[0]
    record = json.loads((hard.path / "member.json").read_text())["provenance"]
    assert record["warnings"] == heard
    assert record["sample_distances"]["peaks"] < planned
    assert decibels(catalog, "hard", waves(3.0)) > TARGET


def test_a_given_distance_is_never_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("render.quality.mean_change", None)
    heard: list[str] = []
    with session(tmp_path, heard, target_decibels=None, sample_distance=SPACING) as hook:
        hook.render_member(waves(0.5), {"a": 0.0}, spacing=(SPACING,) * 3)
        hook.render_member(waves(3.0), {"a": 1.0}, spacing=(SPACING,) * 3)
    assert heard == []


def test_a_first_member_that_shows_enough_keeps_its_own_distance(tmp_path: Path) -> None:
    """As before there was a check: existing scenes keep their distances bit for bit."""
    with session(tmp_path, []) as hook:
        hook.render_member(waves(1.0), {"a": 0.0}, spacing=(SPACING,) * 3)
    plan = Catalog.open(tmp_path / "a.cdb").plan
    grid = to_grid(waves(1.0), spacing=SPACING)
    own = choose_sample_distance(grid, PEAKS, plan.cameras, TARGET)
    assert plan.provenance["sample_distances"] == {"peaks": own.distance}
    assert plan.provenance["measured_changes"]["peaks"] == pytest.approx(
        mean_change(grid, PEAKS.transfer_function), rel=1e-3
    )
