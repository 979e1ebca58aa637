"""The field's summary against what it must be on fields whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.appearance import Isosurface, TransferFunction, VolumeRendering
from insitu import summarize as module
from insitu.summarize import summarize, value_range
from render import to_grid

SPHERE = Isosurface("sphere", 0.6)


def distance(size: int = 24) -> np.ndarray:
    """Distance from the origin on [-1, 1]^3, with other spacings by axis, (z, y, x)."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (size, size + 3, size + 6)), indexing="ij")
    return np.sqrt(x**2 + y**2 + z**2)


def grid_of(values: np.ndarray, nan: str = "refuse"):
    spacing = [2.0 / (n - 1) for n in reversed(values.shape)]
    return to_grid(values, spacing=spacing, origin=(-1.0, -1.0, -1.0), nan=nan)


def ramp(opacities: tuple[tuple[float, float], ...]) -> VolumeRendering:
    return VolumeRendering("dvr", TransferFunction(((0, 0, 0, 1), (2, 1, 0, 0)), opacities, 0.5))


def test_points_lie_on_the_isosurface_and_cover_it_evenly() -> None:
    summary = summarize(grid_of(distance()), [SPHERE], (0.0, 2.0))
    radii = np.linalg.norm(summary.points, axis=1)
    assert len(radii) == 4000
    assert np.abs(radii - 0.6).max() < 0.01  # linear interpolation of a curved field on an edge
    assert np.abs(summary.points.mean(axis=0)).max() < 0.05
    assert (summary.point_values == np.float32(0.6)).all()
    assert (summary.point_opacities == 1.0).all()


def test_points_follow_opacity_wherever_it_is() -> None:
    shell = ramp(((0.0, 0.0), (0.4, 0.0), (0.41, 0.9), (0.6, 0.9), (0.61, 0.0), (2.0, 0.0)))
    summary = summarize(grid_of(distance()), [shell], (0.0, 2.0))
    radii = np.linalg.norm(summary.points, axis=1)
    assert np.mean((radii > 0.33) & (radii < 0.68)) > 0.99  # jitter reaches half a voxel out of the shell
    volume = 4.1888 * (0.6**3 - 0.4**3)
    inner = np.mean(radii < 0.5) / np.mean(radii > 0)
    assert inner == pytest.approx(4.1888 * (0.5**3 - 0.4**3) / volume, abs=0.03)


def test_appearances_share_the_points() -> None:
    summary = summarize(grid_of(distance()), [SPHERE, ramp(((0.0, 0.0), (2.0, 0.5)))], (0.0, 2.0), points=1001)
    assert len(summary.points) == 1001
    assert (summary.point_opacities == 1.0).sum() == 501


@pytest.mark.parametrize("appearance", [Isosurface("none", 9.0), ramp(((0.0, 0.0), (2.0, 0.0)))], ids=["iso", "dvr"])
def test_nothing_to_see_leaves_no_points(appearance) -> None:
    summary = summarize(grid_of(distance()), [appearance], (0.0, 2.0))
    assert summary.points.shape == (0, 3)
    assert summary.histogram.sum() == distance().size


def test_slabs_change_nothing_but_the_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    appearances = [SPHERE, ramp(((0.0, 0.0), (2.0, 0.5)))]
    whole = summarize(grid_of(distance()), appearances, (0.5, 1.5))
    monkeypatch.setattr(module, "SLAB_VOXELS", 1)
    sliced = summarize(grid_of(distance()), appearances, (0.5, 1.5))
    assert np.array_equal(whole.histogram, sliced.histogram)
    assert (whole.minimum, whole.maximum) == (sliced.minimum, sliced.maximum)
    assert whole.clipped_fraction == sliced.clipped_fraction
    assert np.abs(np.linalg.norm(sliced.points[:2000], axis=1) - 0.6).max() < 0.01
    assert np.sqrt((sliced.points[2000:] ** 2).sum(1)).mean() == pytest.approx(
        np.sqrt((whole.points[2000:] ** 2).sum(1)).mean(), abs=0.03
    )


def test_range_and_clipping_are_the_fields() -> None:
    values = distance()
    summary = summarize(grid_of(values), [SPHERE], (0.5, 1.0))
    assert summary.minimum == pytest.approx(values.min(), rel=1e-6)
    assert summary.maximum == pytest.approx(values.max(), rel=1e-6)
    assert summary.clipped_fraction == pytest.approx(np.mean((values < 0.5) | (values > 1.0)), abs=1e-9)


def test_holes_count_for_nothing() -> None:
    values = distance()
    values[: values.shape[0] // 2] = np.nan
    summary = summarize(grid_of(values, nan="transparent"), [SPHERE, ramp(((0.0, 0.5), (2.0, 0.5)))], (0.0, 2.0))
    assert summary.histogram.sum() == np.isfinite(values).sum()
    assert summary.points[:, 2].min() > -2.0 / (values.shape[0] - 1)


@pytest.mark.parametrize(
    ("appearances", "wanted"),
    [
        ([ramp(((-1.0, 0.1), (1.0, 0.2)))], (-1.0, 2.0)),
        ([ramp(((0.0, 0.1), (1.0, 0.2))), Isosurface("far", 5.0)], (0.0, 5.0)),
        ([Isosurface("far", 5.0)], (-3.0, 5.0)),
    ],
)
def test_the_value_range_is_what_is_shown(appearances, wanted) -> None:
    assert value_range(appearances, (-3.0, 4.0)) == wanted


def test_the_value_range_of_a_constant_has_a_width() -> None:
    assert value_range([Isosurface("flat", 2.0)], (2.0, 2.0)) == (1.5, 2.5)
