"""COLMAP reads what is exported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.exchange import export
from catalogs.store.catalog import Catalog
from tests.catalogs.conftest import picture


@pytest.mark.parametrize("appearance", ["dvr", "iso"])
def test_pycolmap_finds_cameras_pictures_and_points(catalog: Catalog, tmp_path: Path, appearance: str) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    data = export(catalog, tmp_path / "data", "colmap", appearance=appearance)
    member = catalog.member("first")
    model = pycolmap.Reconstruction(data / "first" / "sparse" / "0")
    assert len(model.images) == len(member.cameras)
    world = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    for image in model.images.values():
        view = int(Path(image.name).stem)
        pixels, _ = member.cameras[view].project(world)
        found = np.array([image.project_point(point) for point in world])
        np.testing.assert_allclose(found, pixels, atol=1e-9)
        assert (data / "first" / "images" / image.name).is_file()
    summary = member.summary()
    assert summary is not None
    points = [model.points3D[number] for number in sorted(model.points3D)]
    np.testing.assert_allclose([point.xyz for point in points], summary.points, atol=1e-6)
    colors = catalog.plan.appearances[0].transfer_function.colors(summary.point_values)
    expected = np.rint(255.0 * colors) if appearance == "dvr" else np.full((len(points), 3), 128)
    np.testing.assert_array_equal([point.color for point in points], expected)
    tested = (data / "first" / "sparse" / "0" / "test.txt").read_text().split()
    assert tested == [f"{view:03d}.png" for view, split in enumerate(member.view_splits) if split != "train"]


def test_points_fill_the_box_where_the_field_left_none(catalog: Catalog, tmp_path: Path) -> None:
    with catalog.begin_member("bare", {"Re": 130.0, "Pr": 1.0}) as writer:
        for name in catalog.appearance_names:
            for view in range(len(catalog.plan.cameras)):
                writer.write_image(name, view, picture(view))
    data = export(catalog, tmp_path / "data", "colmap", appearance="dvr", members=["bare"])
    points = np.loadtxt(data / "bare" / "sparse" / "0" / "points3D.txt")
    low, high = catalog.plan.bounds
    assert len(points) == 4000
    assert (points[:, 1:4] >= low).all()
    assert (points[:, 1:4] <= high).all()
