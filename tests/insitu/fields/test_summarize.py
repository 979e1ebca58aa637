"""The field's summary against what it must be on fields whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from insitu.fields import summarize as module
from insitu.fields.summarize import summarize, value_range
from render import to_grid

SPHERE = Isosurface("sphere", 0.6)
NOWHERE = Isosurface("none", -1e30)


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


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 1e9), (1e40, 0.0), (1e-300, 0.0)])
def test_the_summary_of_a_field_in_another_unit_is_the_same(scale: float, offset: float) -> None:
    def moved(values):
        return scale * np.asarray(values, dtype=np.float64) + offset

    plain, function = distance(), TransferFunction(((0, 0, 0, 1), (2, 1, 0, 0)), ((0.0, 0.0), (2.0, 0.5)), 0.5)
    colors = tuple((float(moved(v)), *rgb) for v, *rgb in function.color_points)
    opacities = tuple((float(moved(v)), o) for v, o in function.opacity_points)
    other = [
        VolumeRendering("dvr", TransferFunction(colors, opacities, 0.5)),
        Isosurface("iso", float(moved(0.6))),
    ]
    here = summarize(grid_of(plain), [VolumeRendering("dvr", function), SPHERE], (0.5, 2.0))
    there = summarize(grid_of(moved(plain)), other, tuple(moved([0.5, 2.0])))
    assert (there.minimum, there.maximum) == (moved(plain).min(), moved(plain).max())
    np.testing.assert_allclose(there.histogram, here.histogram, atol=2)
    np.testing.assert_allclose(there.points, here.points, atol=1e-5)
    np.testing.assert_allclose(there.point_opacities, here.point_opacities, atol=1e-5)
    np.testing.assert_allclose((there.point_values - offset) / scale, here.point_values, atol=1e-5)


def test_points_far_from_the_origin_keep_their_places() -> None:
    grid = to_grid(distance(), spacing=0.1, origin=(5e6, -3e6, 1e6))
    near = to_grid(distance(), spacing=0.1)
    moved, kept = (summarize(g, [SPHERE], (0.0, 2.0)) for g in (grid, near))
    np.testing.assert_allclose(moved.points - grid.origin, kept.points, atol=1e-5)
    np.testing.assert_allclose(moved.even_points - grid.origin, kept.even_points, atol=1e-5)
    np.testing.assert_array_equal(moved.even_values, kept.even_values)


# ---- points that fill the box


def cells_of(points: np.ndarray, count: int) -> np.ndarray:
    """The number of points in each of `count`^3 equal boxes of [-1, 1]^3."""
    return np.histogramdd(points, bins=count, range=[(-1.0, 1.0)] * 3)[0]


def interpolated(values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Trilinear values of samples on [-1, 1]^3 at points (M, 3) x, y, z."""
    axes = [np.linspace(-1.0, 1.0, n) for n in values.shape]
    return RegularGridInterpolator(axes, values.astype(np.float64))(points[:, ::-1].clip(-1.0, 1.0))


def test_even_points_fill_the_box_better_than_chance() -> None:
    summary = summarize(grid_of(distance()), [SPHERE], (0.0, 2.0))
    assert summary.even_points.shape == (2000, 3)
    counts = cells_of(summary.even_points, 5)  # 16 a cell: the variance of a random draw would be 16
    assert counts.sum() == 2000
    assert counts.var() < 8.0
    np.testing.assert_allclose(summary.even_values, interpolated(distance(), summary.even_points), atol=1e-5)


def test_even_points_differ_from_field_to_field_and_never_for_the_same_one() -> None:
    fields = [distance(), distance(), 1.1 * distance(), distance()[::-1] ** 2]
    first, again, *others = (summarize(grid_of(f), [SPHERE], (0.0, 2.0)).even_points for f in fields)
    assert np.array_equal(first, again)
    assert all(np.abs(first - other).max() > 0.1 for other in others)
    together = np.concatenate([first, *others])
    assert cells_of(together, 10).min() > 0  # 6 a cell


def test_even_points_do_not_depend_on_appearances_and_change_no_other_point() -> None:
    shown = [SPHERE, ramp(((0.0, 0.0), (2.0, 0.5)))]
    grid = grid_of(distance())
    both, none = (summarize(grid, a, (0.0, 2.0)) for a in (shown, [NOWHERE]))
    assert np.array_equal(both.even_points, none.even_points)
    without = summarize(grid, shown, (0.0, 2.0), even_points=0)
    assert (without.even_points.shape, without.even_values.shape) == ((0, 3), (0,))
    for name in ("points", "point_values", "point_opacities", "histogram"):
        assert getattr(both, name).tobytes() == getattr(without, name).tobytes()


@pytest.mark.parametrize("kept", [1.0, 0.5, 0.1, 0.001, 0.0])
def test_even_points_stay_out_of_cells_with_a_hole(kept: float) -> None:
    values, slabs = distance(), round(kept * 23)
    values[slabs + 1 :] = np.nan  # `slabs` layers of whole cells are left
    grid = grid_of(values, nan="transparent")
    summary = summarize(grid, [SPHERE], (0.0, 2.0))
    assert len(summary.even_points) == (2000 if slabs else 0)
    if slabs:
        top = -1.0 + 2.0 * slabs / 23
        assert summary.even_points[:, 2].max() <= top + 1e-6
        share = (summary.even_points[:, 2] < (top - 1.0) / 2).mean()
        assert share == pytest.approx(0.5, abs=0.02)


def test_where_nearly_everything_is_hole_there_are_fewer_even_points() -> None:
    values = np.full((40, 40, 40), np.nan)
    values[20:23, 20:23, 20:23] = 1.0  # 8 of 59,319 cells
    summary = summarize(grid_of(values, nan="transparent"), [NOWHERE], (0.0, 2.0))
    assert 8 < len(summary.even_points) < 40
    assert (summary.even_values == 1.0).all()


@pytest.mark.parametrize(
    ("values", "type_kept"),
    [
        (np.full((2, 2, 2), 7.0), "float32"),
        (1e9 + distance(), "float64"),
        (1e300 * distance(), "float64"),
        (np.arange(24**3, dtype=np.int64).reshape(24, 24, 24) + 2**40, "float64"),
    ],
    ids=["constant", "offset", "huge", "integers"],
)
def test_even_values_of_any_kind_of_field(values: np.ndarray, type_kept: str) -> None:
    low, high = float(values.min()), float(values.max())
    summary = summarize(grid_of(values), [NOWHERE], (low, high if high > low else low + 1.0))
    assert summary.even_values.dtype == type_kept
    error = np.abs(summary.even_values - interpolated(values, summary.even_points))
    assert error.max() <= 1e-4 * (high - low) + 1e-7 * max(abs(low), abs(high)) * (type_kept == "float32")
