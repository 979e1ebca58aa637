"""A stored picture is found where it shows exactly what is asked for, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import VariationSetting as VariedSetting
from surrogate import Surrogate
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.explore.truth import Truth
from surrogate.rasterizer import Rasterizer
from tests.support.varied_blobs import BLOBS, FUNCTIONS, ISOVALUE, varied_catalog, varied_surrogate

AT_TEST = {"p": 0.5}
FIRST, SECOND = BLOBS.cameras()[:2]


@pytest.fixture(scope="module")
def surrogate() -> Surrogate:
    return replace(varied_surrogate(), rasterizer=Rasterizer(backend="cpu"))


def truth_of(catalog: Catalog, surrogate: Surrogate) -> Truth:
    found = Truth.of(Run("truth", surrogate, catalog=catalog))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def truth(surrogate: Surrogate, tmp_path_factory: pytest.TempPathFactory) -> Truth:
    catalog = varied_catalog(tmp_path_factory.mktemp("truth") / "varied.cdb", surrogate)
    return truth_of(Catalog.open(catalog.path), surrogate)


def moved(camera: Camera, by: float) -> Camera:
    """The camera a step to its right, in units of its distance."""
    matrix = camera.world_to_camera.copy()
    matrix[0, 3] += by * float(np.linalg.norm(camera.position))
    return Camera(matrix, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)


def test_every_picture_of_the_base_is_found(truth: Truth) -> None:
    for member in truth.members:
        for view, camera in enumerate(member.cameras):
            stored = truth.match(Setting(member.parameters), camera)
            assert stored is not None
            assert (stored.member.name, stored.appearance, stored.view) == (member.name, "dvr", view)


def test_the_picture_is_what_the_surrogate_drew_at_its_own_size(truth: Truth, surrogate: Surrogate) -> None:
    setting = Setting(AT_TEST)
    stored = truth.match(setting, SECOND.resized(512, 512))
    assert stored is not None
    picture = truth.picture(stored)
    assert picture.dtype == np.float32
    assert picture.shape == (BLOBS.size, BLOBS.size, 4)
    drawn = setting.member(surrogate).render(SECOND)
    np.testing.assert_allclose(
        picture, np.minimum(drawn, drawn[..., 3:]), atol=1 / 255
    )  # eight bits, colour below alpha


@pytest.mark.parametrize(
    ("p", "view", "visualization", "sentence"),
    [
        (0.0, 0, {}, "member train-0 (trained on), view 0 (trained on)"),
        (0.0, 2, {}, "member train-0 (trained on), view 2 (validation: not trained on)"),
        (0.0, 3, {}, "member train-0 (trained on), view 3 (test: not trained on)"),
        (0.25, 0, {}, "member validation-0 (validation: not trained on), view 0 (trained on)"),
        (0.5, 0, {}, "member test-0 (test: not trained on), view 0 (trained on)"),
        (
            0.0,
            0,
            {"isovalue": 8.0},
            "member train-0 (trained on), view 0 (trained on), iso=8 (test: not trained on)",
        ),
    ],
)
def test_member_view_and_appearance_have_a_split_each(
    truth: Truth, p: float, view: int, visualization: dict[str, float], sentence: str
) -> None:
    stored = truth.match(Setting({"p": p}, visualization), BLOBS.cameras()[view])
    assert stored is not None
    assert stored.sentence == sentence


@pytest.mark.parametrize(
    "of_variation", [s for v in (ISOVALUE, FUNCTIONS) for s in v.settings], ids=lambda s: s.appearance
)
def test_every_appearance_is_found_by_its_values(truth: Truth, of_variation: VariedSetting) -> None:
    variation = ISOVALUE if of_variation in ISOVALUE.settings else FUNCTIONS
    stored = truth.match(Setting({"p": 0.0}, variation.arguments(of_variation)), FIRST)
    assert stored is not None
    assert stored.appearance == of_variation.appearance


@pytest.mark.parametrize("visualization", [{}, {"c1_value": 0.0}, {"c1_value": 0.0, "c2_opacity": 1e-12}])
def test_no_displacement_is_the_base(truth: Truth, visualization: dict[str, float]) -> None:
    stored = truth.match(Setting(AT_TEST, visualization), FIRST)
    assert stored is not None
    assert stored.appearance == "dvr"


def test_numbers_of_nine_digits_are_the_same(truth: Truth) -> None:
    matrix = np.array([[float(f"{x:.9g}") for x in row] for row in SECOND.world_to_camera])
    focal = float(f"{SECOND.fx:.9g}")
    rounded = Camera(matrix, focal, focal, SECOND.cx, SECOND.cy, SECOND.width, SECOND.height)
    assert truth.match(Setting({"p": 0.25 * (1 + 1e-10)}), rounded) is not None


@pytest.mark.parametrize(
    ("setting", "camera"),
    [
        (Setting({"p": 0.5 + 1e-6}), FIRST),
        (Setting(AT_TEST, {"isovalue": 2.5 + 1e-6}), FIRST),
        (Setting(AT_TEST, {"isovalue": 3.0}), FIRST),  # of validation members only
        (Setting(AT_TEST, {}, "viridis"), FIRST),
        (Setting(AT_TEST), moved(FIRST, 1e-5)),
        (Setting(AT_TEST), replace(FIRST, fx=1.001 * FIRST.fx, fy=1.001 * FIRST.fy)),
        (Setting(AT_TEST), replace(FIRST, width=2 * FIRST.width, cx=2 * FIRST.cx)),  # wider, not larger
        (Setting(AT_TEST), replace(FIRST, cy=FIRST.cy + 1.0)),
    ],
)
def test_what_nobody_rendered_is_not_found(truth: Truth, setting: Setting, camera: Camera) -> None:
    assert truth.match(setting, camera) is None


def test_a_camera_is_the_same_within_a_millionth(truth: Truth) -> None:
    assert truth.match(Setting(AT_TEST), moved(FIRST, 5e-7)) is not None


@pytest.mark.parametrize("p", np.linspace(-0.2, 1.3, 12).tolist())
def test_the_nearest_member(truth: Truth, p: float) -> None:
    for appearance in ("dvr", "iso=3"):
        able = [m for m in truth.members if appearance in m.appearances]
        expected = min(able, key=lambda m: abs(m.parameters["p"] - p))
        assert truth.nearest_member(Setting({"p": p}), appearance) is expected
    with pytest.raises(ValueError, match="no member shows"):
        truth.nearest_member(Setting({"p": p}), "nothing")


def test_the_nearest_view(truth: Truth) -> None:
    cameras = truth.members[0].cameras
    for share in (0.1, 0.4, 0.6):
        place = (1.0 - share) * FIRST.position + share * SECOND.position
        camera = Camera.look_at(place, (0, 0, 0), vertical_fov_degrees=20, width=9, height=9)
        cosines = [place @ c.position / np.linalg.norm(place) / np.linalg.norm(c.position) for c in cameras]
        assert truth.nearest_view(camera, truth.members[0]) == int(np.argmax(cosines))
    assert [truth.nearest_view(camera, truth.members[0]) for camera in cameras] == [*range(len(cameras))]


def test_the_nearest_appearance(truth: Truth) -> None:
    step = FUNCTIONS.space.parameters[0].high
    assert truth.nearest_appearance(Setting(AT_TEST)) == "dvr"
    assert truth.nearest_appearance(Setting(AT_TEST, {"isovalue": 2.6})) == "iso=2.5"
    assert truth.nearest_appearance(Setting(AT_TEST, {"isovalue": 2.9})) == "iso=3"
    assert truth.nearest_appearance(Setting(AT_TEST, {"c1_value": 0.99 * step})) == "tf-train-0"
    assert truth.nearest_appearance(Setting(AT_TEST, {"c1_value": 0.01 * step})) == "dvr"


def test_the_nearest_picture_is_of_the_nearest_appearance_first(truth: Truth) -> None:
    found = truth.nearest(Setting({"p": 0.6}, {"isovalue": 2.9}), SECOND)
    assert found is not None
    assert (found.member.name, found.appearance, found.view) == ("validation-0", "iso=3", 1)
    at_base = truth.nearest(Setting({"p": 0.6}), SECOND)
    assert at_base is not None
    assert (at_base.member.name, at_base.appearance, at_base.view) == ("test-0", "dvr", 1)
    empty = replace(truth, members=())
    assert empty.nearest(Setting({"p": 0.6}), SECOND) is None


def test_what_must_be_asked_for_to_see_an_appearance(truth: Truth) -> None:
    for appearance in truth.catalog.appearance_names:
        stored = truth.match(Setting({"p": 0.0}, truth.appearances[appearance]), FIRST)
        assert stored is not None
        assert stored.appearance == appearance
    assert set(truth.appearances) == set(truth.catalog.appearance_names)


def test_a_catalog_of_other_parameters_is_refused(truth: Truth, surrogate: Surrogate) -> None:
    parameters = [{**record, "name": "q"} for record in surrogate.space.to_json()]
    with pytest.raises(ValueError, match="catalog is of"):
        truth_of(truth.catalog, replace(surrogate, space=type(surrogate.space).from_json(parameters)))


def test_pictures_on_a_background_are_opaque(surrogate: Surrogate, tmp_path: Path) -> None:
    catalog = varied_catalog(
        tmp_path / "white.cdb", surrogate, {"train-0": (0.0, ("dvr",))}, background=(1.0, 1.0, 1.0)
    )
    truth = truth_of(catalog, surrogate)
    stored = truth.match(Setting({"p": 0.0}), FIRST)
    assert stored is not None
    picture = truth.picture(stored)
    assert (picture[..., 3] == 1.0).all()
