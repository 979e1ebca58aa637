"""All methods learn from the same pictures and are judged by the same others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.store.catalog import Catalog
from research.studies.comparison.task import IMAGES, ComparisonTask
from tests.support.blobs import Blobs, stored
from tests.support.varied_blobs import varied_catalog, varied_surrogate

SMALL = Blobs(count=3, size=16)
MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.25), ("test", 0.5))


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return stored(tmp_path_factory.mktemp("catalog") / "blobs.cdb", SMALL, members=MEMBERS)


@pytest.fixture(scope="module")
def varied(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return varied_catalog(tmp_path_factory.mktemp("varied") / "varied.cdb", varied_surrogate())


def test_pictures_are_the_training_images(catalog: Catalog) -> None:
    pictures = ComparisonTask.of(catalog).pictures()
    assert len(pictures) == 2 * 10
    train = [m for m in catalog.members if m.split == "train"]
    for number, (member, view) in enumerate((m, v) for m in train for v in range(10)):
        np.testing.assert_array_equal(pictures.pixels[number], catalog.image(member, "drawn", view))
        assert float(pictures.parameters[number, 0]) == 2.0 * member.parameters["p"] - 1.0
        true = ComparisonTask.of(catalog).source.normalization.camera(member.cameras[view])
        np.testing.assert_allclose(pictures.camera(number).world_to_camera, true.world_to_camera)
    assert len(pictures.cameras) == 10
    torch.testing.assert_close(pictures.box, torch.tensor([[-1.0] * 3, [1.0] * 3]))


def test_opaque_pictures_have_alpha_and_a_background(make_catalog) -> None:
    catalog = make_catalog(SMALL, members=MEMBERS, background=(0.25, 0.5, 1.0))
    pictures = ComparisonTask.of(catalog).pictures()
    assert pictures.background == (0.25, 0.5, 1.0)
    assert (pictures.pixels[..., 3] == 255).all()
    assert pictures.visualization == 0


def test_cells_are_test_images_and_stay_the_same(catalog: Catalog) -> None:
    task = ComparisonTask.of(catalog)
    kinds = {
        name: {(case.member.split, case.member.view_splits[case.view]) for case in cases}
        for name, cases in task.cells.items()
    }
    assert kinds == {
        "novel views": {("train", "test")},
        "unseen parameters": {("test", "train")},
        "both": {("test", "test")},
    }
    again = ComparisonTask.of(Catalog.open(catalog.path))
    for name, cases in task.cells.items():
        assert len(cases) <= IMAGES
        assert [(c.member.name, c.view) for c in cases] == [(c.member.name, c.view) for c in again.cells[name]]
    assert task.cells["both"][0] is task.cells["both"][0]


def test_choices_are_made_on_validation_images(catalog: Catalog) -> None:
    task = ComparisonTask.of(catalog)
    assert task.watched
    assert {case.member.split for case in task.watched} == {"validation"}


def test_asked_parameters_are_those_that_are_learnt(catalog: Catalog) -> None:
    task = ComparisonTask.of(catalog)
    case = task.cells["both"][0]
    torch.testing.assert_close(task.parameters(case), torch.tensor([0.0]))
    np.testing.assert_allclose(
        task.camera(case).world_to_camera, task.source.normalization.camera(case.camera).world_to_camera
    )


def test_a_variation_is_compared_where_there_is_one(varied: Catalog) -> None:
    task = ComparisonTask.of(varied)
    assert task.variation is not None
    assert task.variation.kind == "isovalue"
    pictures = task.pictures()
    assert (pictures.parameters.shape[1], pictures.visualization) == (2, 1)
    assert set(task.cells) == {"unseen isovalues", "unseen isovalues and parameters"}
    case = task.cells["unseen isovalues and parameters"][0]
    assert task.parameters(case).shape == (2,)
    assert "isovalue" in case.varied
    trained = {float(x) for x in pictures.parameters[:, 1]}
    assert float(task.parameters(case)[1]) not in trained


def test_the_base_belongs_to_transfer_functions(varied: Catalog) -> None:
    [variation] = [v for v in varied.plan.variations if v.kind == "transfer_function"]
    pictures = ComparisonTask(varied, variation).pictures()
    assert pictures.visualization == len(variation.space) == pictures.parameters.shape[1] - 1
    still = (pictures.parameters[:, 1:] == 0.0).all(dim=1)
    views = sum(split == "train" for split in varied.members[0].view_splits)
    assert int(still.sum()) == views * sum(m.split == "train" for m in varied.members)
    assert not still.all()


def test_a_task_says_what_it_lacks(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(SMALL, members=(("test", 0.0),))
    with pytest.raises(ValueError, match="holds no training images"):
        ComparisonTask.of(catalog).pictures()
