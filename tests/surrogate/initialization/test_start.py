from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import ImportedImages, TransferFunction, VolumeRendering
from surrogate.gaussians import Normalization
from surrogate.initialization.pictures import StartPoints
from surrogate.initialization.start import initial_gaussians, initial_points
from surrogate.settings import TrainingSettings
from tests.support.blobs import Blobs

BOX = np.array([[-1.0, -0.5, -0.25], [1.0, 0.5, 0.25]])
GREY = np.array([0.5, 0.5, 0.5])
TRANSFER = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.0, 0.0), (1.0, 1.0)), 1.0)
RED_AND_BLUE = VolumeRendering("drawn", TRANSFER)


def catalog_with_points(path: Path, shown: object) -> Catalog:
    """One training member with 50 points near (0.5, 0, 0) of value 1, and a test member with points elsewhere."""
    blobs, cameras = Blobs(size=8), Blobs(size=8).cameras()[:1]
    plan = CatalogPlan(blobs.space, (shown,), cameras, ("train",), blobs.bounds)  # type: ignore[arg-type]
    catalog = Catalog.create(path / "points.cdb", plan)
    for split, p, x in (("train", 0.0, 0.5), ("test", 1.0, -0.5)):
        points = np.random.default_rng(0).normal([x, 0.0, 0.0], 0.01, (50, 3)).astype(np.float32)
        with catalog.begin_member(split, {"p": p}, split=split) as writer:
            writer.write_image("drawn", 0, np.zeros((8, 8, 4), np.uint8))
            writer.write_summaries(
                {
                    "": FieldSummary(
                        minimum=0.0,
                        maximum=1.0,
                        clipped_fraction=0.0,
                        histogram=np.zeros(256, np.int64),
                        bin_edges=np.linspace(0.0, 1.0, 257),
                        points=points,
                        point_values=np.ones(50, np.float32),
                        point_opacities=np.ones(50, np.float32),
                    )
                }
            )
    return catalog


def test_random_gaussians_fill_the_box_and_touch() -> None:
    settings = TrainingSettings(gaussians=4000)
    gaussians = initial_gaussians(settings, BOX, None, np.array([0.1, 0.2, 0.3]))
    means = gaussians.means.numpy()
    assert (means >= BOX[0]).all()
    assert (means <= BOX[1]).all()
    np.testing.assert_allclose(means.std(0), (BOX[1] - BOX[0]) / np.sqrt(12.0), rtol=0.05)
    np.testing.assert_allclose(gaussians.scales().numpy(), 0.25 * (1.0 / 4000) ** (1 / 3), rtol=1e-5)
    np.testing.assert_allclose(gaussians.opacities().numpy(), 0.2, rtol=1e-5)
    np.testing.assert_allclose(gaussians.colors.numpy(), np.tile([0.1, 0.2, 0.3], (4000, 1)), rtol=1e-6)


@pytest.mark.parametrize("count", [30, 5000])
def test_gaussians_start_on_the_points_with_their_colours(count: int) -> None:
    random = np.random.default_rng(3)
    points = StartPoints(random.normal([0.5, 0.2, 0.0], 0.01, (200, 3)), np.tile([1.0, 0.0, 0.25], (200, 1)))
    gaussians = initial_gaussians(TrainingSettings(gaussians=count, color_degree=1), BOX, points, GREY)
    spacing = (1.0 / count) ** (1 / 3)
    assert np.abs(gaussians.means.numpy() - [0.5, 0.2, 0.0]).max() < 0.05 + 1.5 * spacing
    assert len(np.unique(gaussians.means.numpy(), axis=0)) == count
    colors = gaussians.colors.numpy()
    assert colors.shape == (count, 12)
    np.testing.assert_array_equal(colors[:, :3], np.tile(np.float32([1.0, 0.0, 0.25]), (count, 1)))
    assert not colors[:, 3:].any()


def test_only_training_members_lend_their_points(tmp_path: Path) -> None:
    catalog = catalog_with_points(tmp_path, RED_AND_BLUE)
    normalization = Normalization.of_box(catalog.plan.bounds)
    points = initial_points(TrainingSettings(), catalog, "drawn", normalization)
    assert points is not None
    assert points.colors is not None
    assert points.places.shape == (50, 3)
    np.testing.assert_allclose(points.places.mean(0), [0.5, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(points.colors, np.tile([1.0, 0.0, 0.0], (50, 1)))


def test_pictures_made_elsewhere_give_points_no_colour(tmp_path: Path) -> None:
    catalog = catalog_with_points(tmp_path, ImportedImages("drawn"))
    points = initial_points(TrainingSettings(), catalog, "drawn", Normalization.of_box(catalog.plan.bounds))
    assert points is not None
    assert points.colors is None
    gaussians = initial_gaussians(TrainingSettings(gaussians=10), BOX, points, GREY)
    assert (gaussians.colors == 0.5).all()


def test_random_ignores_points(tmp_path: Path) -> None:
    catalog = catalog_with_points(tmp_path, RED_AND_BLUE)
    settings = TrainingSettings(initialization="random")
    assert initial_points(settings, catalog, "drawn", Normalization.of_box(catalog.plan.bounds)) is None


@pytest.mark.parametrize(("kind", "raises"), [("auto", False), ("in-situ", True)])
def test_a_catalog_without_points(make_catalog, kind: str, raises: bool) -> None:
    catalog = make_catalog()
    settings, normalization = (
        TrainingSettings(initialization=kind),
        Normalization.of_box(catalog.plan.bounds),
    )
    if not raises:
        assert initial_points(settings, catalog, "drawn", normalization) is None
        return
    with pytest.raises(ValueError, match="no training member of this catalog has sampled points"):
        initial_points(settings, catalog, "drawn", normalization)


def test_the_same_seed_starts_alike() -> None:
    settings = TrainingSettings(gaussians=20)
    first, second, other = (
        initial_gaussians(s, BOX, None, GREY).means
        for s in (settings, settings, TrainingSettings(gaussians=20, seed=1))
    )
    assert (first == second).all()
    assert (first != other).any()
