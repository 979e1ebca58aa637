"""Facts for the page are true, complete, finite, and plain JSON whatever the names are."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import OBLIQUE, Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.quantity import Quantity
from surrogate import Surrogate
from surrogate.appearance.scale import ValueScale
from surrogate.explore import facts as module
from surrogate.explore.color_maps import NAMES
from surrogate.explore.facts import facts, orbit_of
from surrogate.explore.run import Run
from tests.support.blobs import Blobs
from tests.support.field_blobs import BLOBS, FUNCTION, STEPS, field_catalog, summary
from tests.support.models import following, plain
from tests.support.stored_ensembles import MakeCatalog

HOSTILE = '</script><img src=x onerror="alert(1)">"\'&\u2028\ud800'


@pytest.fixture(scope="module")
def surrogate() -> Surrogate:
    return following()


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return field_catalog(tmp_path_factory.mktemp("facts") / "field.cdb", summaries=True)


@pytest.fixture(scope="module")
def told(surrogate: Surrogate, catalog: Catalog) -> dict[str, Any]:
    return facts(Run("blobs", surrogate, catalog=catalog))


def variation(told: dict[str, Any], kind: str) -> dict[str, Any]:
    return next(v for v in told["variations"] if v["kind"] == kind)


def test_it_is_plain_json(told: dict[str, Any], surrogate: Surrogate) -> None:
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    alone = facts(Run("alone", surrogate))
    assert json.loads(json.dumps(alone, allow_nan=False)) == alone
    assert set(alone) == set(told)


def test_every_part_is_documented(told: dict[str, Any]) -> None:
    assert module.__doc__ is not None
    assert all(f"\n    {name} " in module.__doc__ for name in told)


def test_parameters_have_the_marks_of_members(told: dict[str, Any]) -> None:
    bounds = {"low": 0.0, "high": 1.0, "least": -1.0, "most": 2.0}
    marks = {"train": [0.0, 0.5, 1.0], "validation": [0.3]}
    assert told["parameters"] == [{"name": "p", "unit": "", "scale": "linear", **bounds, **marks}]


def test_logarithmic_parameters_go_as_far_in_ratios(surrogate: Surrogate) -> None:
    space = ParameterSpace((Parameter("nu", 1e-4, 1e-2, "m²/s", "log"),))
    (found,) = facts(Run("log", replace(plain(), space=space)))["parameters"]
    assert (found["scale"], found["unit"]) == ("log", "m²/s")
    assert (found["least"], found["most"]) == pytest.approx((1e-6, 1.0))


def test_members_are_listed_with_their_values(told: dict[str, Any]) -> None:
    assert told["members"][3] == {"name": "member-3", "split": "validation", "values": [0.3]}
    assert len(told["members"]) == 4
    assert told["truth"] is True
    assert told["size"] == [BLOBS.size, BLOBS.size]


def test_isovalues(told: dict[str, Any]) -> None:
    found = variation(told, "isovalue")
    assert (found["low"], found["high"], found["train"], found["validation"]) == (
        0.1,
        0.8,
        [0.1, 0.3, 0.55, 0.8],
        [0.4],
    )
    assert (found["least"], found["most"]) == pytest.approx((-0.6, 1.5))
    assert (found["label"], found["unit"], found["scale"]) == ("", "", "linear")


def test_fields_have_their_name_and_unit(
    surrogate: Surrogate, catalog: Catalog, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CatalogPlan, "quantity", lambda *_: Quantity("Q", "1/s²"))
    told = facts(Run("named", surrogate, catalog=catalog))
    assert {variation(told, kind)["label"] for kind in ("isovalue", "transfer_function")} == {"Q (1/s²)"}


def test_transfer_functions(told: dict[str, Any]) -> None:
    found = variation(told, "transfer_function")
    points = {point["name"]: point for point in found["points"]}
    assert [points[name]["origin"] for name in points] == [1.0, 0.3, 2.0, 0.5]
    assert [point["high"] - point["origin"] for point in found["points"]] == pytest.approx(STEPS.tolist())
    assert (points["c1_opacity"]["least"], points["c2_opacity"]["most"]) == (
        0.0,
        1.0,
    )  # opacities, however far they could go
    assert (points["c1_value"]["least"], points["c2_value"]["most"]) == pytest.approx(
        (0.003, 2.997)
    )  # between the ends
    assert found["function"] == {
        "color_points": [list(point) for point in FUNCTION.color_points],
        "opacity_points": [list(point) for point in FUNCTION.opacity_points],
        "opacity_unit_distance": FUNCTION.opacity_unit_distance,
    }
    assert found["free"]
    assert found["knots"] == [0.0, 1.0, 1.5, 2.0, 3.0]
    assert [each["name"] for each in found["color_maps"]] == list(NAMES)
    place, *color = found["color_maps"][0]["points"][0]
    assert place == 0.0
    assert color == pytest.approx([0x44 / 255, 0x01 / 255, 0x54 / 255], abs=1 / 255)


def test_fields_are_named_base_first(tmp_path: Path, surrogate: Surrogate) -> None:
    from catalogs.vocabulary.variations import field_variation
    from surrogate.deformation.visualization import Visualization

    of_field = Visualization(field_variation("dvr", appearances=("speed", "other")), surrogate.deformation)
    told = facts(Run("fields", replace(surrogate, visualizations=(of_field,))))
    assert told["variations"] == [{"kind": "field", "names": ["dvr", "speed", "other"]}]


def test_the_histogram_is_of_all_members_and_logarithmic(told: dict[str, Any]) -> None:
    histogram = told["histogram"]
    assert (histogram["edges"][0], histogram["edges"][-1]) == FUNCTION.bounds
    assert (len(histogram["edges"]), len(histogram["heights"])) == (65, 64)
    edges = ValueScale.of_function(FUNCTION).values(np.linspace(0.0, 1.0, 65))
    stored = summary(BLOBS)
    below = np.interp(
        edges, stored.bin_edges, np.concatenate([[0.0], 4.0 * np.cumsum(stored.histogram)])
    )  # of 4 members
    heights = np.log1p(np.diff(below))
    np.testing.assert_allclose(histogram["edges"], edges)
    np.testing.assert_allclose(histogram["heights"], heights / heights.max(), atol=1e-9)


def test_damaged_summaries_are_left_out(tmp_path: Path, surrogate: Surrogate) -> None:
    catalog = field_catalog(tmp_path / "field.cdb", summaries=True)
    for member in catalog.members[:-1]:
        (member.path / "field.npz").write_bytes(b"no archive")
    assert facts(Run("", surrogate, catalog=catalog))["histogram"] is not None
    (catalog.members[-1].path / "field.npz").unlink()
    assert facts(Run("", surrogate, catalog=catalog))["histogram"] is None


def orbiting(orbit: dict[str, Any], size: int) -> Camera:
    """The camera that the page makes of an orbit."""
    position = np.array(orbit["target"]) + orbit["distance"] * np.array(orbit["direction"])
    return Camera.look_at(
        position, orbit["target"], vertical_fov_degrees=orbit["field"], width=size, height=size, up=orbit["up"]
    )


def assert_same(first: Camera, second: Camera) -> None:
    np.testing.assert_allclose(first.world_to_camera, second.world_to_camera, atol=1e-9)
    assert first.fx == pytest.approx(second.fx, rel=1e-9)


def test_the_page_makes_the_stored_cameras_of_their_orbits(catalog: Catalog) -> None:
    for camera in catalog.plan.cameras:
        orbit = orbit_of(camera, np.zeros(3))
        assert_same(orbiting(orbit, BLOBS.size), camera)
        np.testing.assert_allclose(orbit["target"], [0.0, 0.0, 0.0], atol=1e-9)


def test_the_first_camera_is_the_stored_one_seen_from_above_and_aside(told: dict[str, Any], catalog: Catalog) -> None:
    towards = [camera.position @ OBLIQUE / np.linalg.norm(camera.position) for camera in catalog.plan.cameras]
    assert_same(orbiting(told["camera"], BLOBS.size), catalog.plan.cameras[int(np.argmax(towards))])
    np.testing.assert_allclose(told["camera"]["target"], [0.0, 0.0, 0.0], atol=1e-9)


def own_cameras(path: Path) -> Catalog:
    """Two members whose cameras look past the middle, and differ in one."""
    blobs, (first, second, third) = Blobs(), Blobs().cameras()[:3]
    aside = Camera.look_at(2.0 * third.position, (0.2, 0, 0), vertical_fov_degrees=20, width=32, height=32)
    plan = CatalogPlan(blobs.space, (ImportedImages("dvr"),), (), (), blobs.bounds)
    catalog = Catalog.create(path, plan)
    for p, cameras in ((0.0, (first, second)), (1.0, (second, aside))):
        with catalog.begin_member(f"m{p:g}", {"p": p}, cameras=cameras, view_splits=("train", "test")) as writer:
            for view in range(2):
                writer.write_image("dvr", view, np.zeros((32, 32, 4), np.float32))
    return Catalog.open(path)


def test_members_may_have_cameras_of_their_own(tmp_path: Path) -> None:
    catalog = own_cameras(tmp_path / "own.cdb")
    told = facts(Run("own", plain(), catalog=catalog))
    cameras = [*catalog.members[0].cameras, catalog.members[1].cameras[1]]
    for camera in cameras:
        assert_same(orbiting(orbit_of(camera, np.zeros(3)), 32), camera)
    towards = [-camera.forward @ OBLIQUE for camera in cameras]
    assert_same(orbiting(told["camera"], 32), cameras[int(np.argmax(towards))])
    assert told["histogram"] is None
    assert told["size"] == [32, 32]


def test_without_a_catalog_the_camera_sees_the_whole_box(surrogate: Surrogate) -> None:
    told = facts(Run("alone", surrogate))
    camera = orbiting(told["camera"], 100)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    world = corners * surrogate.normalization.extent + surrogate.normalization.center
    pixels, depths = camera.project(world)
    assert (depths > 0).all()
    assert ((pixels > 0) & (pixels < 100)).all()
    assert np.ptp(pixels) > 50
    assert (told["truth"], told["members"], told["size"]) == (False, [], None)
    assert told["histogram"] is None


def test_the_model_and_its_background(surrogate: Surrogate) -> None:
    told = facts(Run("alone", replace(surrogate, background=(1.0, 0.5, 0.0))))
    assert told["background"] == "#ff8000"
    assert facts(Run("alone", surrogate))["background"] is None
    assert told["model"]["gaussians"] == len(surrogate.gaussians)
    assert told["model"]["megabytes"] == pytest.approx(surrogate.megabytes)
    assert told["model"]["seconds"] == 1.0


def test_names_from_outside_stay_plain_strings() -> None:
    space = ParameterSpace((Parameter(HOSTILE, 0.0, 1.0),))
    training = {"appearance": HOSTILE, "seconds": float("nan")}
    told = facts(Run(HOSTILE, replace(plain(), space=space, training=training)))
    again = json.loads(json.dumps(told, allow_nan=False))
    plainly = HOSTILE.replace("\ud800", "?")  # half a character has no UTF-8, in which messages travel
    assert again["title"] == again["parameters"][0]["name"] == plainly
    json.dumps(told, ensure_ascii=False).encode()
    assert again["model"]["seconds"] is None


def test_of_many_there_are_some(monkeypatch: pytest.MonkeyPatch, make_catalog: MakeCatalog) -> None:
    for name in ("MOST_TICKS", "MOST_MEMBERS"):
        monkeypatch.setattr(module, name, 4)
    members = [("train", p) for p in np.linspace(0.0, 1.0, 7).tolist()]
    catalog = make_catalog(members=members, view_splits=("train",) * 9, blank=True)
    told = facts(Run("many", plain(), catalog=catalog))
    assert len(told["members"]) == 4
    assert told["parameters"][0]["train"] == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
