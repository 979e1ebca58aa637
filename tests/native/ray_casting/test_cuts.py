"""Cuts through fields: kernels against the float64 reference, and what closed forms and whole pictures say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native import kernels
from native.ray_casting import Cut, SampledField, SurfaceCaster, VolumeCaster
from native.ray_casting.cuts import THICKNESS, sliced
from render.quality import psnr
from surrogate.ray_casting.reference import draw_isosurface_reference, draw_volume_reference
from tests.support.cast_cases import PEAKS, SMOOTH, far_away, gyroid, inside, punctured, seen

FIELD = gyroid()
LOW = np.array(FIELD.origin)
SIZE = (FIELD.size - 1) * FIELD.spacing
SURFACE = Isosurface("iso", 0.2, (0.9, 0.4, 0.1), 0.1, 0.6, 0.5, 35.0)


def box(*shares: float) -> tuple[Any, Any]:
    """Of the field's box, by shares of it: three of the lowest corner and three of the highest."""
    return tuple((LOW + SIZE * shares[:3]).tolist()), tuple((LOW + SIZE * shares[3:]).tolist())


def plane(axis: int, share: float) -> tuple[int, float]:
    return axis, float(LOW[axis] + SIZE[axis] * share)


CUTS = {
    "a part": Cut(box(0.2, 0.0, 0.3, 0.7, 0.6, 1.0)),
    "one axis": Cut(box(0.0, 0.0, 0.0, 0.31, 1.0, 1.0)),
    "wider than the field": Cut(box(-5.0, -0.1, -1e6, 7.0, 1.1, 1e6)),
    "thinner than a step": Cut(box(0.0, 0.0, 0.5, 1.0, 1.0, 0.5001)),
    "thinner than a step along every axis": Cut(box(0.5, 0.5, 0.5, 0.5001, 0.5001, 0.5001)),
    "partly outside": Cut(box(0.6, 0.6, 0.6, 3.0, 3.0, 3.0)),
    "a slice": Cut(None, plane(2, 0.37)),
    "a slice along samples": Cut(None, (0, FIELD.origin[0] + 12 * FIELD.spacing[0])),
    "a slice at the first face": Cut(None, plane(1, 0.0)),
    "a slice at the last face": Cut(None, (1, FIELD.origin[1] + 27 * FIELD.spacing[1])),
    "a slice in a box": Cut(box(0.1, 0.2, 0.0, 0.9, 0.7, 1.0), plane(2, 0.6)),
}
EMPTY = {
    "flat": Cut(box(0.0, 0.0, 0.4, 1.0, 1.0, 0.4)),
    "a line": Cut(box(0.0, 0.4, 0.4, 1.0, 0.4, 0.4)),
    "a point": Cut(box(0.3, 0.4, 0.4, 0.3, 0.4, 0.4)),
    "outside": Cut(box(1.2, 0.0, 0.0, 1.3, 1.0, 1.0)),
    "far outside": Cut(((1e300, 1e300, 1e300), (1.7e308, 1.7e308, 1.7e308))),
    "beside the face": Cut(box(-1.0, -1.0, -1.0, 0.0, 2.0, 2.0)),
    "a slice outside": Cut(None, plane(0, 1.01)),
    "a slice outside of the box": Cut(box(0.0, 0.0, 0.0, 0.5, 1.0, 1.0), plane(0, 0.6)),
}
CAMERAS = {"outside": seen(FIELD, 32), "inside": inside(FIELD, 32), "far away": far_away(FIELD, size=16)}


def cut_volume(field: SampledField, cut: Cut, appearance: VolumeRendering, camera: Camera) -> tuple[Any, Any]:
    """By the kernel and as the reference defines it."""
    if cut.plane is not None:
        appearance = sliced(appearance, field)
    bounds = cut.bounds(field)
    drawn = VolumeCaster.of(field, appearance, threads=1).within(bounds).draw(camera, threads=1)
    return drawn, draw_volume_reference(field, appearance, camera, bounds=bounds).numpy()


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("name", CUTS)
def test_the_kernel_cuts_as_the_reference_does(name: str, instruction_set: str, monkeypatch: Any) -> None:
    monkeypatch.setenv("GS_SURROGATE_INSTRUCTION_SET", instruction_set)
    for shaded, field in ((False, FIELD), (True, FIELD), (False, punctured())):
        for camera in CAMERAS.values():
            drawn, expected = cut_volume(field, CUTS[name], VolumeRendering("dvr", PEAKS, shaded), camera)
            errors = np.abs(drawn - expected).max(axis=2)
            assert np.percentile(errors, 99) < 3e-5
            assert np.sqrt(np.mean(errors**2)) < 1e-2  # of a slice the outermost pixels may miss or meet it


@pytest.mark.parametrize("name", EMPTY)
def test_nothing_is_seen_of_an_empty_box(name: str) -> None:
    cut = EMPTY[name]
    for camera in CAMERAS.values():
        for picture in cut_volume(FIELD, cut, VolumeRendering("dvr", SMOOTH), camera):
            assert not picture.any()
        surface = SurfaceCaster.of(FIELD, SURFACE).within(cut.bounds(FIELD))
        assert not surface.draw(camera).any()


def test_a_box_around_the_field_changes_no_bit() -> None:
    caster, surface = VolumeCaster.of(FIELD, VolumeRendering("dvr", SMOOTH)), SurfaceCaster.of(FIELD, SURFACE)
    bounds = CUTS["wider than the field"].bounds(FIELD)
    for camera in CAMERAS.values():
        np.testing.assert_array_equal(caster.within(bounds).draw(camera), caster.draw(camera))
        np.testing.assert_array_equal(surface.within(bounds).draw(camera), surface.draw(camera))


def test_a_box_along_samples_is_the_field_of_these_samples() -> None:
    values, spacing = FIELD.values[4:20, 3:17, 5:22], np.array(FIELD.spacing)
    part = replace(FIELD, values=values, origin=tuple(LOW + spacing * [5, 3, 4]))
    cut = Cut((part.origin, tuple(np.array(part.origin) + spacing * (part.size - 1))))
    for camera in CAMERAS.values():
        drawn, _ = cut_volume(FIELD, cut, VolumeRendering("dvr", SMOOTH), camera)
        assert psnr(drawn, VolumeCaster.of(part, VolumeRendering("dvr", SMOOTH)).draw(camera)) > 95


@pytest.mark.parametrize("name", [name for name in CUTS if "slice" not in name])
def test_surfaces_are_cut_where_the_reference_cuts_them(name: str) -> None:
    bounds, camera = CUTS[name].bounds(FIELD), seen(FIELD, 12)
    found = SurfaceCaster.of(FIELD, SURFACE).within(bounds).draw(camera)
    expected = draw_isosurface_reference(FIELD, SURFACE, camera, bounds=bounds).numpy()
    assert np.percentile(np.abs(found - expected), 99) < 1e-4
    assert psnr(found, expected) > 50  # samples on an edge may lie on either side of it


def test_cut_triangles_stay_inside_and_cover_what_is_there() -> None:
    whole = SurfaceCaster.of(FIELD, SURFACE).triangles
    bounds = CUTS["a part"].bounds(FIELD)
    halves = [bounds.copy(), bounds.copy()]
    halves[0][1, 0] = halves[1][0, 0] = bounds[:, 0].mean()
    cut, *parts = (whole.within(one) for one in (bounds, *halves))
    used = cut.places[np.unique(cut.corners)]
    assert (used >= bounds[0] - 1e-12).all()
    assert (used <= bounds[1] + 1e-12).all()

    def area(triangles: Any) -> float:
        a, b, c = (triangles.places[triangles.corners[:, k]] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    assert sum(map(area, parts)) == pytest.approx(area(cut), rel=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slice_has_the_colours_of_the_field_there(axis: int) -> None:
    z, y, x = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in (9, 8, 7)), indexing="ij")
    field = SampledField(
        (0.2 * x - 0.1 * y + 0.05 * z - 0.5).astype(np.float32)
    )  # trilinear, so that any place is known
    middle, place = np.array([3.0, 3.5, 4.0]), 2.3
    middle[axis] = place
    towards = np.eye(3)[axis] + 0.2 * np.eye(3)[(axis + 1) % 3]
    up = np.eye(3)[(axis + 2) % 3]
    camera = Camera.look_at(middle + 9.0 * towards, middle, vertical_fov_degrees=10.0, width=16, height=16, up=up)
    drawn, _ = cut_volume(field, Cut(None, (axis, place)), VolumeRendering("dvr", SMOOTH), camera)
    eye, rays = camera.rays()
    places = eye + rays * ((place + THICKNESS / 2 - eye[axis]) / rays[..., axis])[..., None]  # [H, W, 3]
    values = places @ np.array([0.2, -0.1, 0.05]) - 0.5
    np.testing.assert_allclose(drawn[..., :3], SMOOTH.colors(values), atol=1e-4)
    np.testing.assert_array_equal(drawn[..., 3], 1.0)


def test_a_slice_along_samples_shows_cells_of_one_side_beside_holes() -> None:
    values, holes = np.zeros((6, 6, 6), np.float32), np.zeros((6, 6, 6), bool)
    holes[2] = True  # cells from 1 to 3 along z are hidden
    field = SampledField(values, holes)
    appearance = VolumeRendering("dvr", SMOOTH)
    camera = Camera.look_at(
        (2.5, 2.6, 19.0), (2.5, 2.5, 3.0), vertical_fov_degrees=8, width=16, height=16, up=(0, 1, 0)
    )
    assert (cut_volume(field, Cut(None, (2, 3.0)), appearance, camera)[0][..., 3] == 1.0).all()
    assert not cut_volume(field, Cut(None, (2, 2.9)), appearance, camera)[0].any()
    assert not cut_volume(field, Cut(None, (2, 1.0)), appearance, camera)[0].any()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((((0, 0, 1), (1, 1, 0.5)),), "a box goes from a place to a higher one, got z 1 to 0.5"),
        ((((0, 0, 0), (1, float("nan"), 1)),), "got y 0 to nan"),
        ((((0, 0, 0), (float("inf"), 1, 1)),), "got x 0 to inf"),
        ((None, (3, 0.0)), "perpendicular to x, y or z"),
        ((None, (0, float("nan"))), "at a finite place"),
    ],
)
def test_other_cuts_are_refused(arguments: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Cut(*arguments)


def test_kernels_refuse_bounds_outside_of_the_field() -> None:
    caster = VolumeCaster.of(FIELD, VolumeRendering("dvr", SMOOTH))
    for bounds in ([[-1, 0, 0], [5, 5, 5]], [[0, 0, 0], [5, 5, 99]], [[5, 0, 0], [4, 5, 5]], [[np.nan] * 3, [5, 5, 5]]):
        with pytest.raises(ValueError, match="bounds must lie inside of the field"):
            caster.within(np.array(bounds, np.float64)).draw(CAMERAS["outside"])


def test_cuts_have_words() -> None:
    assert str(Cut(((0, 0, 0), (0.5, 1, 2)), (2, 0.25))) == "x = 0 to 0.5, y = 0 to 1, z = 0 to 2, slice at z = 0.25"
