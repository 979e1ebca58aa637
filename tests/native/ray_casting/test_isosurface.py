"""Isosurfaces by the ray caster: the kernel against the float64 reference, VTK's triangles and closed forms."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native import kernels
from native.ray_casting import SampledField, SurfaceCaster, draw_isosurface
from render import render_views
from render.grids import Grid
from render.quality import psnr
from surrogate.ray_casting.reference import draw_isosurface_reference
from tests.support.cast_cases import SMOOTH, far_away, gyroid, inside, punctured, seen, with_values

FIELD = gyroid()
SIDE = 16  # pixels
SHINY = Isosurface("iso", 0.2, (0.9, 0.4, 0.1), 0.1, 0.6, 0.5, 35.0)
THIN = SampledField(np.linspace(-1, 1, 8, dtype=np.float32).reshape(2, 2, 2), None, (0.5, 1.0, 2.0))

LEVELS = with_values(np.broadcast_to(np.arange(4, dtype=np.float32)[:, None, None], (4, 5, 6)).copy())


def outlying() -> SampledField:
    values = FIELD.values.copy()
    values[10, 10, 10], values[20, 14, 12] = 3e38, -3e38
    return with_values(values)


def scaled(scale: float, offset: float) -> SampledField:
    return with_values(scale * FIELD.values.astype(np.float64) + offset)


CASES: dict[str, tuple[SampledField, float, Camera]] = {
    "ordinary": (FIELD, 0.2, seen(FIELD, SIDE)),
    "another value and view": (FIELD, -0.6, seen(FIELD, SIDE, 3)),
    "holes": (punctured(), 0.2, seen(FIELD, SIDE)),
    "camera inside": (FIELD, 0.2, inside(FIELD, SIDE)),
    "a wide image": (FIELD, 0.2, seen(FIELD, 25, 30, 13)),
    "one pixel": (FIELD, 0.2, seen(FIELD, 1)),
    "one cell": (THIN, 0.1, seen(THIN, SIDE)),
    "through the faces": (LEVELS, 2.999999, seen(LEVELS, SIDE, 30)),
    "on the faces": (LEVELS, 3.0, seen(LEVELS, SIDE, 3)),
    "from far away": (FIELD, 0.2, far_away(FIELD, size=SIDE)),
    "beyond every value": (FIELD, 7.0, seen(FIELD, 9)),
    "constant at the isovalue": (with_values(np.full((4, 5, 6), 0.2, np.float32)), 0.2, seen(FIELD, 9)),
    "values far out": (outlying(), 0.2, seen(FIELD, SIDE)),
    "tiny values": (scaled(1e-200, 0.0), 0.2e-200, seen(FIELD, SIDE)),
    "a large offset": (scaled(1.0, 1e9), 1e9 + 0.2, seen(FIELD, SIDE)),
}


def surface(value: float) -> Isosurface:
    return replace(SHINY, isovalue=value)


@cache
def expected_of(name: str) -> Any:
    field, value, camera = CASES[name]
    return draw_isosurface_reference(field, surface(value), camera).numpy()


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("name", CASES)
def test_the_kernel_draws_what_the_reference_defines(name: str, instruction_set: str, monkeypatch: Any) -> None:
    monkeypatch.setenv("GS_SURROGATE_INSTRUCTION_SET", instruction_set)
    field, value, camera = CASES[name]
    found = SurfaceCaster.of(field, surface(value)).draw(camera)
    expected = expected_of(name)
    errors = np.abs(found - expected).max(axis=2)
    assert np.percentile(errors, 98) < 2e-5  # a sample on an edge may fall to either side, a sixteenth of a pixel
    assert errors.mean() < 1e-4


@pytest.mark.parametrize("name", ["ordinary", "another value and view", "holes", "a wide image", "values far out"])
def test_images_are_those_that_vtk_draws(name: str) -> None:
    field, value, camera = CASES[name]
    camera = camera.resized(7 * camera.width, 7 * camera.height)
    grid = Grid(field.filled, field.spacing, field.origin, field.holes)
    (expected,) = render_views(grid, surface(value), [camera], float_output=True, backend="vtk")
    assert expected[..., 3].max() > 0.99
    assert psnr(SurfaceCaster.of(field, surface(value)).draw(camera), expected) > 60


def test_a_linear_field_has_the_plane_that_vtk_draws() -> None:
    z, y, x = np.mgrid[0:9, 0:10, 0:11]
    field = SampledField((0.3 * x - 0.5 * y + 0.7 * z).astype(np.float32), None, (0.5, 1.0, 0.8), (1.0, 2.0, 3.0))
    camera = seen(field, 96)
    (expected,) = render_views(
        Grid(field.values, field.spacing, field.origin), surface(2.0), [camera], float_output=True, backend="vtk"
    )
    found = SurfaceCaster.of(field, surface(2.0)).draw(camera)
    inner = (expected[..., 3] == 1.0) & (found[..., 3] == 1.0)
    assert inner.mean() > 0.05
    np.testing.assert_allclose(found[inner], expected[inner], atol=2e-5)
    assert psnr(found, expected) > 55


@pytest.mark.parametrize("name", ["ordinary", "holes"])
def test_threads_change_no_bit(name: str) -> None:
    field, value, camera = CASES[name]
    first = SurfaceCaster.of(field, surface(value)).draw(camera, threads=1)
    np.testing.assert_array_equal(SurfaceCaster.of(field, surface(value)).draw(camera, threads=3), first)


@pytest.mark.parametrize("samples", [1, 2])
def test_fewer_samples_a_pixel_are_the_means_of_fewer_rays(samples: int) -> None:
    field, value, camera = CASES["ordinary"]
    found = SurfaceCaster.of(field, surface(value)).draw(camera, samples=samples)
    rays = SurfaceCaster.of(field, surface(value)).draw(camera.resized(SIDE * samples, SIDE * samples), samples=1)
    np.testing.assert_allclose(found, rays.reshape(SIDE, samples, SIDE, samples, 4).mean(axis=(1, 3)), atol=1e-6)


def test_bad_input_is_refused() -> None:
    camera = seen(FIELD, 4)
    with pytest.raises(TypeError, match="Isosurface, got VolumeRendering"):
        SurfaceCaster.of(FIELD, VolumeRendering("dvr", SMOOTH))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="samples must be 1, 2 or 4, got 3"):
        SurfaceCaster.of(FIELD, SHINY).draw(camera, samples=3)
    with pytest.raises(ValueError, match="NaN or infinite"):
        draw_isosurface(punctured().values, None, 1.0, 0.0, SHINY, camera)
