"""Volume renderings by the ray caster: the kernel against the float64 twin, and both against VTK."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native import kernels
from native.ray_casting import SurfaceCaster, VolumeCaster, draw_volume
from native.ray_casting.fields import SampledField
from native.ray_casting.volume import HEADLIGHT
from render import render_views
from render.grids import Grid
from render.quality import psnr
from render.shaders import AMBIENT, DIFFUSE, SPECULAR, SPECULAR_POWER
from surrogate.ray_casting.reference import draw_volume_reference
from tests.support.cast_cases import SMOOTH, CastCase, cast_cases, far_away, gyroid, punctured, seen
from tests.support.raymarch import march

CASES = cast_cases()
RENDERED = [name for name, case in CASES.items() if case.rendered]


def drawn(case: CastCase, threads: int = 1) -> np.ndarray:
    caster = VolumeCaster.of(case.field, case.appearance, sample_distance=case.sample_distance, threads=threads)
    return caster.draw(case.camera, threads=threads)


@cache
def defined(name: str) -> np.ndarray:
    case = CASES[name]
    return draw_volume_reference(case.field, case.appearance, case.camera, sample_distance=case.sample_distance).numpy()


def grid_of(field: SampledField) -> Grid:
    return Grid(field.filled, field.spacing, field.origin, field.holes)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("name", CASES)
def test_the_kernel_draws_what_the_reference_defines(name: str, instruction_set: str, monkeypatch: Any) -> None:
    monkeypatch.setenv("GS_SURROGATE_INSTRUCTION_SET", instruction_set)
    found, expected = drawn(CASES[name]), defined(name)
    assert found.dtype == np.float32
    assert found.shape == expected.shape
    errors = np.abs(found - expected).max(axis=2)
    assert np.sqrt(np.mean(errors**2)) < 1e-5
    assert np.percentile(errors, 99) < 3e-5


@pytest.mark.parametrize("name", RENDERED)
def test_images_are_those_of_vtk(name: str) -> None:
    case = CASES[name]
    grid = grid_of(case.field)
    asked = {"sample_distance": case.sample_distance, "float_output": True, "backend": "vtk"}
    views = render_views(grid, case.appearance, [case.camera], **asked)
    assert psnr(drawn(case), next(views)) > 80


@pytest.mark.parametrize("name", ["smooth, shaded", "peaks", "holes", "camera inside", "camera inside, mostly empty"])
def test_the_reference_is_the_ray_marcher_of_render(name: str) -> None:
    case = CASES[name]
    expected = march(grid_of(case.field), case.appearance, case.camera, case.sample_distance)
    assert np.percentile(np.abs(defined(name) - expected), 99) < 2e-4  # where the marcher goes on behind what is opaque


@pytest.mark.parametrize("name", ["mostly empty", "holes, shaded", "a wide image"])
def test_threads_change_no_bit(name: str) -> None:
    first = drawn(CASES[name], 1)
    for threads in (2, 5):
        np.testing.assert_array_equal(drawn(CASES[name], threads), first)


def test_the_headlight_is_that_of_render() -> None:
    assert HEADLIGHT == (AMBIENT, DIFFUSE, SPECULAR, SPECULAR_POWER)


@pytest.mark.parametrize("step", [0.01, 0.37, 5.0])
@pytest.mark.parametrize(("opacity", "unit"), [(0.3, 0.2), (0.99, 0.05), (1e-6, 1e-4), (1.0, 0.5), (0.0, 1.0)])
def test_a_homogeneous_medium_has_the_stated_opacity_at_any_step(opacity: float, unit: float, step: float) -> None:
    transfer = TransferFunction(((0, 1, 0.5, 0), (1, 1, 0.5, 0)), ((0, opacity), (1, opacity)), unit)
    camera = Camera.look_at((-5.0, 0.7, 0.9), (1.0, 0.7, 0.9), vertical_fov_degrees=1e-3, width=1, height=1)
    values = np.full((3, 3, 3), 0.5, np.float32)
    place = ((0.5, 0.75, 1.0), (0.0, 0.0, 0.0))
    rgba = draw_volume(values, None, *place, VolumeRendering("flat", transfer), camera, sample_distance=step)[0, 0]
    alpha = -math.expm1(math.log1p(-opacity) / unit) if opacity < 1.0 else 1.0
    np.testing.assert_allclose(rgba, alpha * np.array([1.0, 0.5, 0.0, 1.0]), atol=1.3e-4 if alpha > 0.999 else 2e-6)


@pytest.mark.parametrize("distance", [1e13, 1e17, 1e100])
@pytest.mark.parametrize("kind", ["volume", "surface"])
def test_a_box_that_double_precision_does_not_resolve_is_drawn_somehow(distance: float, kind: str) -> None:
    field = gyroid()
    camera = replace(far_away(field, distance), fx=1e3 * distance, fy=1e3 * distance)
    volume, surface = VolumeRendering("dvr", SMOOTH, shaded=True), Isosurface("iso", 0.2)
    caster = VolumeCaster.of(field, volume) if kind == "volume" else SurfaceCaster.of(field, surface)
    image = caster.draw(camera)
    assert (image >= 0.0).all()
    assert (image <= 1.0).all()


def test_half_the_smallest_spacing_is_the_default_distance() -> None:
    field, appearance = gyroid(), VolumeRendering("dvr", SMOOTH)
    caster = VolumeCaster.of(field, appearance)
    assert caster.sample_distance == 0.5 * min(field.spacing)
    found = draw_volume(field.values, None, field.spacing, field.origin, appearance, seen(field))
    np.testing.assert_array_equal(found, caster.draw(seen(field)))


def nans() -> np.ndarray:
    values = gyroid().values.copy()
    values[3, 4, 5] = np.nan
    return values


GOOD = gyroid().values
REFUSED = {
    "NaN beside the holes": (
        {"values": nans(), "holes": np.zeros(GOOD.shape, bool)},
        "1 of 21504 .* = \\(3, 4, 5\\): mark",
    ),
    "infinity": ({"values": np.where(GOOD > 0.9, np.inf, GOOD)}, "NaN or infinite"),
    "nothing but holes": ({"holes": np.ones(GOOD.shape, bool)}, "every sample of the field is a hole"),
    "holes of another shape": ({"holes": np.ones((2, 2, 2), bool)}, "holes must be truth values of the shape"),
    "holes of numbers": ({"holes": np.zeros(GOOD.shape)}, "holes must be truth values"),
    "two axes": ({"values": GOOD[0]}, "values must have shape"),
    "a single slice": ({"values": GOOD[:1]}, "at least 2 samples"),
    "spacing of zero": ({"spacing": (1.0, 0.0, 1.0)}, "spacing must be positive"),
    "two spacings": ({"spacing": (1.0, 1.0)}, "spacing must be 3 numbers"),
    "an origin that is not finite": ({"origin": (0.0, np.nan, 0.0)}, "origin must be a finite number"),
    "a negative distance": ({"sample_distance": -1.0}, "sample_distance must be positive"),
    "millions of steps": (
        {"sample_distance": 1e-9},
        "sample_distance 1e-09 cuts .* choose a distance near the spacing",
    ),
}


@pytest.mark.parametrize(("wrong", "message"), REFUSED.values(), ids=REFUSED)
def test_bad_input_is_refused_in_one_sentence(wrong: dict[str, Any], message: str) -> None:
    given = {"values": GOOD, "holes": None, "spacing": 1.0, "origin": 0.0, **wrong}
    with pytest.raises(ValueError, match=message):
        draw_volume(**given, appearance=VolumeRendering("dvr", SMOOTH), camera=seen(gyroid(), 4))


def test_other_kinds_are_refused() -> None:
    with pytest.raises(TypeError, match="VolumeRendering, got Isosurface"):
        VolumeCaster.of(gyroid(), Isosurface("iso", 0.0))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="real numbers, got complex128"):
        SampledField(GOOD.astype(complex))


def test_values_in_holes_do_not_matter() -> None:
    field, appearance = punctured(), VolumeRendering("dvr", SMOOTH, shaded=True)
    other = np.where(field.holes, np.float32(0.7), field.values)
    images = [
        draw_volume(values, field.holes, field.spacing, field.origin, appearance, seen(field))
        for values in (field.values, other)
    ]
    np.testing.assert_array_equal(*images)
