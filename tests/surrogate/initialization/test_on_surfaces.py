"""Gaussians that start on emulated isosurfaces: spheres whose radius follows a parameter and the isovalue."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import torch

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import IsovalueVariation, VariationSetting
from surrogate.emulation import FieldEmulator
from surrogate.gaussians import Normalization
from surrogate.initialization.on_surfaces import OPACITY, EmulatedSurfaces
from surrogate.settings import TrainingSettings

SIZE, SIDE = 24, 0.25
CENTER = 0.5 * SIDE * (SIZE - 1)
POINTS = np.linspace(-1.0, 1.0, 5)[:, None]
SETTINGS = TrainingSettings(gaussians=600)
NORMALIZATION = Normalization.of_box(((0.0, 0.0, 0.0), (2.0 * CENTER,) * 3))
ISOVALUES = (0.0, 0.2, 0.5)


def radius(point: float, isovalue: float) -> float:
    return 1.8 + 0.15 * point - isovalue


def emulator(holes: bool = False) -> FieldEmulator:
    """Of members that are the radius less the distance from the centre."""
    z, y, x = np.mgrid[:SIZE, :SIZE, :SIZE] * SIDE - CENTER
    distances = np.sqrt(x**2 + y**2 + z**2)
    fields = np.stack([radius(p, 0.0) - distances for p in POINTS[:, 0]]).astype(np.float32)
    if holes:
        fields[:, : SIZE // 2] = np.nan
    return FieldEmulator.fit(POINTS, fields, (SIDE,) * 3, (0.0, 0.0, 0.0))


def variation(*isovalues: float) -> IsovalueVariation:
    space = ParameterSpace((Parameter("isovalue", min(isovalues), max(isovalues)),))
    return IsovalueVariation("dvr", space, tuple(VariationSetting(f"iso={v:g}", (v,), "train") for v in isovalues))


@cache
def started(*isovalues: float, holes: bool = False) -> Any:
    surfaces = EmulatedSurfaces.of(emulator(holes), variation(*isovalues))
    assert surfaces is not None
    return surfaces.start(SETTINGS, NORMALIZATION)


def at(start: Any, point: float, isovalue: float) -> Any:
    """Places (N, 3) from the centre in world units, unit normals (N, 3) and opacities (N,)."""
    gaussians, deformation = start
    place = torch.tensor([point, *variation(*ISOVALUES).normalize((isovalue,))]).float()
    moved = deformation.deformed(gaussians, place)
    away = moved.means.double().numpy() * NORMALIZATION.extent + NORMALIZATION.center - CENTER
    normals = torch.nn.functional.normalize(moved.colors, dim=1).numpy()
    return away, normals, moved.opacity_logits.sigmoid().numpy()


@pytest.mark.parametrize(("point", "isovalue"), [(-1.0, 0.0), (0.0, 0.2), (0.3, 0.35), (1.0, 0.5)])
def test_they_lie_on_the_surface_of_any_member_and_isovalue(point: float, isovalue: float) -> None:
    away, normals, opacities = at(started(*ISOVALUES), point, isovalue)
    distances = np.linalg.norm(away, axis=1)
    assert np.abs(distances - radius(point, isovalue)).mean() < 0.1 * SIDE
    assert np.percentile(np.abs(distances - radius(point, isovalue)), 95) < 0.3 * SIDE
    assert (-(normals * away).sum(axis=1) / distances).min() > 0.9, "normals are gradients"
    assert abs(np.median(opacities) - OPACITY) < 0.05


def test_all_directions_have_some() -> None:
    away, _, _ = at(started(*ISOVALUES), 0.0, 0.0)
    assert np.abs(np.mean(away / np.linalg.norm(away, axis=1, keepdims=True), axis=0)).max() < 0.15


def test_they_are_faint_where_no_surface_is_near() -> None:
    start = started(0.0, 0.2, 5.0)
    place = torch.tensor([0.0, 1.0])
    assert start[1].deformed(start[0], place).opacity_logits.sigmoid().max() < 0.3


@pytest.mark.slow
def test_none_starts_beside_holes() -> None:
    away, _, _ = at(started(*ISOVALUES, holes=True), 0.0, 0.2)
    assert away[:, 2].min() > -1.5 * SIDE


@pytest.mark.slow
def test_a_seed_decides_all() -> None:
    first, second = started(*ISOVALUES), started.__wrapped__(*ISOVALUES)
    for one, other in zip(first, second, strict=True):
        assert all(torch.equal(t, other.tensors()[n]) for n, t in one.tensors().items())


def test_without_surfaces_there_is_no_start() -> None:
    assert EmulatedSurfaces.of(emulator(), variation(5.0, 6.0)) is None
