"""Foreign pictures come in exactly, or not at all."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from catalogs.cli import main
from catalogs.exchange import ExchangeError, import_nerf
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.tools.check import check
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.support.nerf_data import ANGLE, BOUNDS, TEST, TRAIN, DataSet, bring, picture


@pytest.fixture
def data(tmp_path: Path) -> DataSet:
    return DataSet(tmp_path / "data")


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("[!.]*")) if p.is_file()}


def test_every_picture_arrives_with_its_camera_and_parameters(data: DataSet, tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    catalog = bring(data, tmp_path, progress=lambda *step: steps.append(step))
    found = {}
    for member in catalog.members:
        for view, name in enumerate(member.provenance["pictures"]):
            image = catalog.image(member, "imported", view)
            found[name] = (tuple(member.parameters.values()), member.cameras[view], image)
    frames = [frame for record in data.records.values() for frame in record["frames"]]
    assert len(found) == len(frames) == 29
    for number, frame in enumerate(frames):
        parameters, camera, image = found[frame["file_path"][2:] + ".png"]
        assert parameters == tuple(frame["params"])
        np.testing.assert_array_equal(image[..., :3], picture(number))
        assert image[..., 3].min() == 255
        pose = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(camera.position, pose[:3, 3], atol=1e-12)
        np.testing.assert_allclose(camera.forward, -pose[:3, 2], atol=1e-12)
        np.testing.assert_allclose(camera.up, pose[:3, 1], atol=1e-12)
    assert steps[-1] == (29, 29)
    assert steps == sorted(steps)
    assert check(catalog.path) == []


def test_members_and_views_are_split_by_what_training_knows(data: DataSet, tmp_path: Path) -> None:
    catalog = bring(data, tmp_path, validation_members=2)
    by_parameters = {tuple(m.parameters.values()): m for m in catalog.members}
    assert Counter(m.split for m in catalog.members) == {"train": 10, "validation": 2, "test": 2}
    assert {p for p, m in by_parameters.items() if m.split == "validation"} == {(1.0, 20.0), (2.0, 20.0)}
    for parameters in TEST:
        member = by_parameters[parameters]
        assert (member.split, member.view_splits) == ("test", ("test", "train"))  # training looks from 90 degrees too
        assert [member.row_split(v) for v in (0, 1)] == ["test", "test"]
    seen = by_parameters[TRAIN[0]]
    assert (seen.split, seen.view_splits) == ("train", ("train", "train", "test"))
    assert seen.row_split(2) == "test"


def test_a_validation_file_brings_its_own_members(data: DataSet, tmp_path: Path) -> None:
    frames = [data.frame("val", (1.2, 12.0), 10.0), data.frame("val", TEST[0], 11.0), data.frame("val", TRAIN[1], 12.0)]
    data.records["val"] = {"camera_angle_x": ANGLE, "frames": frames}
    data.save()
    catalog = bring(data, tmp_path, validation_members=2)
    by_parameters = {tuple(m.parameters.values()): m for m in catalog.members}
    assert {p for p, m in by_parameters.items() if m.split == "validation"} == {(1.2, 12.0), TEST[0]}
    assert by_parameters[TRAIN[1]].view_splits == ("train", "train", "validation")
    assert by_parameters[TEST[0]].view_splits == ("validation", "test", "train")


@pytest.mark.slow
def test_the_draw_prefers_the_inside_and_follows_the_seed(data: DataSet, tmp_path: Path) -> None:
    draws = set()
    for seed in range(8):
        catalog = import_nerf(
            data.folder, tmp_path / f"{seed}.cdb", bounds=BOUNDS, names=["a", "b"], validation_members=3, seed=seed
        )
        drawn = {tuple(m.parameters.values()) for m in catalog.members if m.split == "validation"}
        assert drawn > {(1.0, 20.0), (2.0, 20.0)}
        (third,) = drawn - {(1.0, 20.0), (2.0, 20.0)}
        assert third not in {(0.0, 10.0), (0.0, 30.0), (3.0, 10.0), (3.0, 30.0)}  # a corner ends both parameters
        draws.add(third)
    assert len(draws) > 1


def test_the_same_number_printed_otherwise_is_the_same_member(data: DataSet, tmp_path: Path) -> None:
    data.records["test"]["frames"][-1]["params"] = [0.0, 10.000000000000002]
    data.save()
    assert len(bring(data, tmp_path).members) == len(TRAIN) + len(TEST)


def test_an_interrupted_import_goes_on_to_the_same_catalog(data: DataSet, tmp_path: Path) -> None:
    whole = snapshot(bring(data, tmp_path).path)
    shutil.rmtree(tmp_path / "out.cdb")

    def interrupt(done: int, total: int) -> None:
        if done == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bring(data, tmp_path, progress=interrupt)
    some = Catalog.open(tmp_path / "out.cdb")
    assert 0 < len(some.members) < len(TRAIN)
    assert check(some.path) == []
    assert snapshot(bring(data, tmp_path).path) == whole
    before = {p: p.stat().st_mtime_ns for p in some.path.rglob("*")}
    bring(data, tmp_path)
    assert before == {p: p.stat().st_mtime_ns for p in some.path.rglob("*")}, "a finished import touches nothing"


@pytest.mark.parametrize(
    "options", [{"seed": 5, "validation_members": 3}, {"bounds": ((0, 0, 0), (1, 1, 1))}, {"background": (0, 0, 0)}]
)
def test_another_import_into_the_same_catalog_is_refused(
    data: DataSet, tmp_path: Path, options: dict[str, Any]
) -> None:
    before = snapshot(bring(data, tmp_path, validation_members=2).path)
    with pytest.raises(CatalogError if "seed" not in options else ExchangeError):
        bring(data, tmp_path, **options)
    assert snapshot(tmp_path / "out.cdb") == before


def test_alpha_is_kept_where_asked_for_and_refused_otherwise(tmp_path: Path) -> None:
    data = DataSet(tmp_path / "data", channels=4)
    with pytest.raises(ExchangeError, match=r"r_0\.png is transparent.*background none"):
        bring(data, tmp_path)
    assert not (tmp_path / "out.cdb").exists()
    catalog = bring(data, tmp_path, background=None)
    assert catalog.plan.background is None
    member = catalog.members[0]
    (name,) = (n for n in member.provenance["pictures"][:1])
    straight = picture(int(Path(name).stem[2:]), 4).astype(float)
    premultiplied = straight[..., :3] * straight[..., 3:] / 255
    image = catalog.image(member, "imported", 0)
    assert np.abs(image[..., :3] - premultiplied).max() <= 0.5
    np.testing.assert_array_equal(image[..., 3], straight[..., 3])


def test_opaque_rgba_stands_on_the_background(tmp_path: Path) -> None:
    data = DataSet(tmp_path / "data", channels=4)
    for path in data.folder.rglob("*.png"):
        Image.open(path).convert("RGB").convert("RGBA").save(path)
    assert bring(data, tmp_path).plan.background == (1.0, 1.0, 1.0)
    assert len(Catalog.open(tmp_path / "out.cdb").members) == 14


def test_opaque_pictures_have_no_alpha_to_keep(data: DataSet, tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match="no alpha: name the background"):
        bring(data, tmp_path, background=None)


def test_a_space_gives_names_and_bounds(data: DataSet, tmp_path: Path) -> None:
    space = ParameterSpace((Parameter("pressure", -1.0, 5.0, "Pa"), Parameter("b", 0.0, 40.0)))
    assert bring(data, tmp_path, names=None, space=space).plan.space == space
    unnamed = import_nerf(data.folder, tmp_path / "unnamed.cdb", bounds=BOUNDS)
    assert [(p.name, p.low, p.high) for p in unnamed.plan.space.parameters] == [("p0", 0.0, 3.0), ("p1", 10.0, 30.0)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": ["a"]}, "2 params.*1 names"),
        (
            {"space": ParameterSpace((Parameter("x", 0, 1),)), "names": None},
            r"2 params, the parameter space 1: x",
        ),
        ({"space": ParameterSpace((Parameter("x", 0, 1), Parameter("y", 0, 1)))}, "contradict"),
        ({"validation_members": 12}, "12 validation members leave no training member"),
        ({"validation_members": 13}, "leave no training member: there are 12"),
        ({"background": (255, 255, 255)}, "background must lie in"),
        ({"bounds": ((1, 1, 1), (0, 0, 0))}, "bounds must be two corners low < high"),
        ({"names": ["b", "b"]}, "parameter names must be unique"),
    ],
)
def test_wrong_arguments_write_nothing(data: DataSet, tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        bring(data, tmp_path, **options)
    assert not (tmp_path / "out.cdb").exists()


def test_the_command(data: DataSet, tmp_path: Path) -> None:
    command = ["import", "nerf", str(data.folder), "--catalog", str(tmp_path / "x.cdb"), "--names", "a,b"]
    result = CliRunner().invoke(main, [*command, "--bounds", "-1,-1,-1,1,1,1", "--validation-members", "1"])
    assert result.exit_code == 0, result.output
    assert "14 members (11 train, 1 validation, 2 test)" in result.output
    (data.folder / "train/r_2.png").unlink()
    result = CliRunner().invoke(main, [*command, "--bounds", "-1,-1,-1,1,1,1"])
    assert result.exit_code == 1
    assert "frame 2: " in result.output
    assert "Traceback" not in result.output
    result = CliRunner().invoke(main, [*command, "--bounds", "-1,-1,-1,1,1,1", "--background", "white"])
    assert result.exit_code == 1
    assert "--background takes 3 numbers" in result.output


@pytest.fixture(scope="module")
def nyx(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    folder = shared_data / "nyx_visnerf_128"
    if not folder.is_dir():
        pytest.skip(f"no Nyx pictures at {folder}")
    half = 0.18
    bounds = ((-half,) * 3, (half,) * 3)
    return import_nerf(
        folder, tmp_path_factory.mktemp("nyx") / "nyx.cdb", bounds=bounds, names=["OmM", "OmB", "h"], seed=1
    )


@pytest.mark.filterwarnings("ignore:parameter")
@pytest.mark.slow
class TestNyx:
    """The real pictures of the Nyx cosmology."""

    def test_all_of_it_arrives(self, nyx: Catalog, shared_data: Path) -> None:
        members = nyx.members
        assert Counter(m.split for m in members) == {"train": 43, "validation": 2, "test": 62}
        views = Counter((m.split, view) for m in members for view in m.view_splits)
        # One of the nine test frames at trained parameters repeats a training picture.
        assert views == {
            ("train", "train"): 43 * 42 + 1,
            ("train", "test"): 8,
            ("validation", "train"): 84,
            ("test", "test"): 82,
        }
        for member in members[::13]:
            for view in range(0, len(member.cameras), 11):
                path = shared_data / "nyx_visnerf_128" / member.provenance["pictures"][view]
                original = np.asarray(Image.open(path).convert("RGB"))
                np.testing.assert_array_equal(nyx.image(member, "imported", view)[..., :3], original)

    def test_what_is_seen_lies_in_the_box(self, nyx: Catalog) -> None:
        corners = np.array([[x, y, z] for x in (-0.18, 0.18) for y in (-0.18, 0.18) for z in (-0.18, 0.18)])
        looked_at = 0
        for member in nyx.members[::5]:
            for view, camera in list(enumerate(member.cameras))[::4]:
                rows, columns = np.nonzero(nyx.image(member, "imported", view)[..., :3].min(axis=-1) < 250)
                pixels, _ = camera.project(corners)
                assert pixels[:, 0].min() <= columns.min() < columns.max() + 1 <= pixels[:, 0].max()
                assert pixels[:, 1].min() <= rows.min() < rows.max() + 1 <= pixels[:, 1].max()
                looked_at += 1
        assert looked_at > 100

    def test_cameras_agree_on_one_solid(self, nyx: Catalog) -> None:
        """The visual hull of all views explains every view's silhouette; were world and camera confused it would not."""
        member = nyx.member("train-000")
        masks = [nyx.image(member, "imported", v)[..., :3].min(axis=-1) < 250 for v in range(42)]
        assert _explained(member.cameras[:42], masks) > 0.998
        assert _explained([_confused(camera) for camera in member.cameras[:42]], masks) < 0.9


def _explained(cameras: Any, masks: list[np.ndarray], resolution: int = 80) -> float:
    """Fraction of foreground pixels that a point of the visual hull (Laurentini 1994) falls next to."""
    axis = np.linspace(-0.18, 0.18, resolution)
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)  # [N, 3]
    pixels = [np.clip(camera.project(points)[0], 0, 127.5).astype(int) for camera in cameras]
    hull = np.ones(len(points), dtype=bool)
    for (columns, rows), mask in zip((p.T for p in pixels), masks, strict=True):
        hull &= _grown(mask)[rows, columns]
    hits = total = 0
    for (columns, rows), mask in zip((p[hull].T for p in pixels), masks, strict=True):
        shadow = np.zeros_like(mask)
        shadow[rows, columns] = True
        hits += int((_grown(_grown(shadow)) & mask).sum())
        total += int(mask.sum())
    return hits / total


def _grown(mask: np.ndarray) -> np.ndarray:
    padded = np.pad(mask, 1)
    height, width = mask.shape
    return np.any([padded[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)


def _confused(camera: Camera) -> Camera:
    """At the same distance from the middle, but turned by the inverse rotation."""
    pose = camera.world_to_camera.copy()
    pose[:3, :3] = pose[:3, :3].T
    return Camera(pose, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
