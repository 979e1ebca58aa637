"""Pictures in files know their camera, or it is searched."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from surrogate.answers.posterior import invert
from surrogate.answers.residuals import Residuals, angle_between, moved
from surrogate.answers.targets import Target, stored_target
from surrogate.cli import main
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.explore.exporting.pictures import encode
from surrogate.model import Surrogate
from tests.support.hooked import FUNCTION
from tests.support.two_parameters import TRUE

CAMERA = Camera.look_at((1.9, -2.3, 1.8), (0.55, 0.55, 0.55), vertical_fov_degrees=30, width=40, height=40)


def ask(two: Path, *arguments: str) -> Any:
    return CliRunner().invoke(main, ["ask", "which", str(two), *arguments])


def write(path: Path, two: Path, **record: Any) -> Path:
    picture = Surrogate.load(two / "surrogate").at(p=TRUE, q=10.0).render(CAMERA)
    path.write_bytes(encode(picture, "png", record={"camera": CAMERA.to_json(), **record}))
    return path


@pytest.mark.slow
def test_an_exported_picture_is_asked_about_without_a_camera(two: Path, tmp_path: Path) -> None:
    made = ask(two, str(write(tmp_path / "shot.png", two, visualization={}, color_map="")), "--json")
    assert made.exit_code == 0, made.output
    answer = json.loads(made.output)
    assert abs(answer["parameters"][0]["value"] - TRUE) < 0.02
    assert np.allclose(answer["cameras"][0][0]["world_to_camera"], CAMERA.world_to_camera)


@pytest.mark.parametrize(
    ("record", "error"),
    [
        ({"camera": {**CAMERA.to_json(), "fx": -1.0}}, "keeps a camera that is damaged"),
        ({"camera": {**CAMERA.to_json(), "width": float("inf")}}, "keeps a camera that is damaged"),
        ({"camera": "here"}, "keeps a camera that is damaged"),
        ({"camera": CAMERA.resized(80, 40).to_json()}, "of another shape than its camera's pictures"),
        ({"color_map": "viridis"}, "shows viridis: parameters are read from the base appearance alone"),
        ({"visualization": {"isovalue": 2.0}}, "parameters are read from the base appearance alone"),
    ],
)
def test_a_record_that_does_not_fit_is_refused(two: Path, tmp_path: Path, record: dict[str, Any], error: str) -> None:
    made = ask(two, str(write(tmp_path / "shot.png", two, **record)))
    assert made.exit_code == 1
    assert error in " ".join(made.output.split())


@pytest.mark.slow
def test_a_camera_is_searched_and_refined(two: Path) -> None:
    catalog, surrogate = Catalog.open(two / "catalog.cdb"), Surrogate.load(two / "surrogate")
    name = next(member.name for member in catalog.members if member.split == "test")
    own = stored_target(catalog, name, 3)
    answer = invert(surrogate, [Target(own.picture)], catalog, two)
    mirrored = (3.0 * np.pi - 6.0) / 3.0 - TRUE  # the field there, seen from behind, is the same
    assert all(min(abs(one["p"] - TRUE), abs(one["p"] - mirrored)) < 0.05 for one in answer.solutions)
    assert any(abs(one["p"] - TRUE) < 0.05 for one in answer.solutions)
    assert "distinct solutions" in repr(answer)
    assert not answer.foreign
    picture = surrogate.at(answer.values).render(answer.cameras[0][0])
    assert np.abs(picture[..., 3] - catalog.image(catalog.member(name), "dvr", 3)[..., 3] / 255.0).max() < 0.1


@pytest.mark.parametrize("camera", ["99", "here", "-1"])
def test_other_cameras_are_refused(two: Path, tmp_path: Path, camera: str) -> None:
    made = ask(two, str(write(tmp_path / "shot.png", two)), f"--camera={camera}")
    assert made.exit_code == 1
    assert "--camera takes a view, 0 to 11, or search" in " ".join(made.output.split())


def test_a_camera_moves_about_the_scene() -> None:
    center = np.array([0.55, 0.55, 0.55])
    turned = moved(CAMERA, np.array([0.0, 0.2, 0.0, 0.0, 0.0, 0.0]), center)
    assert angle_between(CAMERA, turned) == pytest.approx(0.1)
    assert np.allclose(turned.project(center[None])[0], CAMERA.project(center[None])[0])
    nearer = moved(CAMERA, np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.0]), center)
    assert nearer.project(center[None])[1] == pytest.approx(0.75 * CAMERA.project(center[None])[1])


def test_a_picture_without_a_camera_needs_views_of_its_shape(two: Path) -> None:
    surrogate, picture = Surrogate.load(two / "surrogate"), np.random.default_rng(0).random((20, 30, 3), np.float32)
    for views, error in (((), "there are no views"), ((CAMERA,), "has another shape than the views")):
        with pytest.raises(ValueError, match=error):
            Residuals.of(surrogate, [Target(picture)], None, views)


@pytest.mark.parametrize("change", ["function", "camera", "field"])
def test_pictures_of_something_else_are_flagged(two: Path, change: str) -> None:
    catalog, surrogate = Catalog.open(two / "catalog.cdb"), Surrogate.load(two / "surrogate")
    name = next(member.name for member in catalog.members if member.split == "test")
    own = stored_target(catalog, name, 3)
    picture, camera = own.picture, own.camera
    if change == "function":
        points = tuple((value, blue, green, red) for value, red, green, blue in FUNCTION.color_points)
        other = surrogate.under(replace(FUNCTION, color_points=points), p=TRUE, q=10.0)
        picture = composite(other.render(camera), WHITE)
    elif change == "camera":
        assert camera is not None
        camera = moved(camera, np.array([0.0, 0.4, 0.0, 0.0, 0.0, -0.5]), np.array([0.55, 0.55, 0.3]))
    else:
        picture = np.where(np.arange(32)[:, None, None] % 8 < 4, picture, 1.0).astype(np.float32)
    assert not invert(surrogate, [own], catalog, two).foreign
    assert invert(surrogate, [Target(picture, camera)], catalog, two).foreign
