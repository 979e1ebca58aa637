from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import Variation
from surrogate.deformation import BilinearDeformation
from surrogate.settings import TrainingSettings
from surrogate.training.compression.color_degree import VARIED_NAME, choose_visualized_color_degree
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.data import TrainingData
from surrogate.training.source import Source
from surrogate.training.state import FittedGaussians
from tests.support.comparing import stored_picture
from tests.support.field_blobs import BLOBS, FUNCTIONS, ISOVALUE, field_catalog

SETTINGS = TrainingSettings(
    visualization_steps=2000,
    latent_rate=0.1,
)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    path = tmp_path_factory.mktemp("varied") / "field.cdb"
    return field_catalog(path, members=(("train", 0.5),), view_splits=("train",))


def fitted() -> FittedGaussians:
    gaussians = BLOBS.gaussians(0.5)
    return FittedGaussians(gaussians, BilinearDeformation.create(gaussians, 1, SETTINGS))


def lit(directional: float) -> TrainingData:
    """The blobs as they are, but for colours that depend on the direction by so much, whatever the isovalue."""
    truth = BLOBS.gaussians(0.5).with_color_degree(1)
    truth.colors[:, 3:] = directional * torch.randn(len(truth), 9, generator=torch.Generator().manual_seed(3))
    places = torch.tensor([[0.0, -1.0], [0.0, 1.0]])
    images = [stored_picture(truth, camera, place) for camera in BLOBS.cameras() for place in places]
    return TrainingData(images[:18], images[18:], None)


def asked(
    catalog: Catalog,
    variation: Variation,
    model: FittedGaussians,
    data: TrainingData | None = None,
    degree: object = "auto",
):
    source = Source(SETTINGS.changed(visualization_color_degree=degree), catalog)
    evaluator = Evaluator(source.settings, data or source.data(variation))
    return choose_visualized_color_degree(model, variation, source, evaluator)


@pytest.mark.parametrize(("directional", "expected"), [(0.0, 0), (0.5, 1)])
def test_lit_surfaces_are_told_from_unlit_ones(catalog: Catalog, directional: float, expected: int) -> None:
    model = fitted()
    before = [tensor.clone() for tensor in model.tensors().values()]
    degree, choice = asked(catalog, ISOVALUE, model, lit(directional))
    assert choice is not None
    assert (degree, choice.name, choice.kept) == (expected, VARIED_NAME, str(expected))
    assert [option.name for option in choice.options] == ["degree 0", "degree 1"]
    assert all(torch.equal(a, b) for a, b in zip(model.tensors().values(), before, strict=True))
    assert not any(tensor.requires_grad for tensor in model.tensors().values())


@pytest.mark.slow
def test_the_same_is_chosen_again(catalog: Catalog) -> None:
    first, second = (asked(catalog, ISOVALUE, fitted(), lit(0.2)) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("variation", [ISOVALUE, FUNCTIONS], ids=["isovalue", "functions"])
def test_what_the_settings_say_is_not_asked(catalog: Catalog, variation: Variation, degree: int) -> None:
    assert asked(catalog, variation, fitted(), degree=degree) == (degree, None)
    wide = FittedGaussians(fitted().gaussians.with_color_degree(1), fitted().deformation)
    assert asked(catalog, variation, wide, degree=degree) == (1, None)  # never less than the base


def test_nothing_is_asked_where_the_answer_is_known(catalog: Catalog) -> None:
    data = lit(0.5)
    assert asked(catalog, FUNCTIONS, fitted(), data) == (0, None)  # they do not light
    wide = FittedGaussians(fitted().gaussians.with_color_degree(1), fitted().deformation)
    assert asked(catalog, ISOVALUE, wide, data) == (1, None)
    assert asked(catalog, ISOVALUE, fitted(), replace(data, validation=[])) == (0, None)
