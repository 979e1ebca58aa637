from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.initialization.pictures import StartPoints
from surrogate.settings import TrainingSettings
from surrogate.training.data import foreground_color
from surrogate.training.source import DECISION_IMAGES, Source
from tests.support.field_blobs import BLOBS, FUNCTIONS, ISOVALUE, field_catalog, summary

MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.5), ("test", 0.7))
VIEWS = ("train", "validation", "test")


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    path = tmp_path_factory.mktemp("varied") / "field.cdb"
    return field_catalog(path, members=MEMBERS, view_splits=VIEWS, summaries=True, unrelated=True)


def test_variations_are_those_of_the_appearance_that_is_learnt(catalog: Catalog) -> None:
    assert Source(TrainingSettings(), catalog).variations == (ISOVALUE, FUNCTIONS)
    assert Source(TrainingSettings(appearance="dvr"), catalog).variations == (ISOVALUE, FUNCTIONS)
    assert Source(TrainingSettings(appearance="unrelated"), catalog).variations == ()
    assert Source(TrainingSettings(visualization_steps=0), catalog).variations == ()


def test_the_base_is_learnt_from_its_own_images_alone(catalog: Catalog) -> None:
    data = Source(TrainingSettings(), catalog).data()
    assert len(data.examples) == 2
    assert all(example.parameters.shape == (1,) for example in (*data.examples, *data.validation))


@pytest.mark.parametrize("variation", [ISOVALUE, FUNCTIONS], ids=["isovalue", "functions"])
def test_a_variation_is_learnt_from_its_training_settings(catalog: Catalog, variation) -> None:
    source = Source(TrainingSettings(), catalog)
    data = source.data(variation)
    assert len(data.examples) == 2 * len(variation.named("train"))
    assert len(data.validation) == len(variation.named("validation"))
    places = {tuple(example.parameters[1:].tolist()) for example in data.examples}
    expected = [variation.normalize(s.values) for s in variation.settings if s.split == "train"]
    assert places == {tuple(torch.tensor(np.asarray(v), dtype=torch.float32).tolist()) for v in expected}
    assert len(source.decision_images(variation)) == len(variation.named("validation"))
    assert data.background is None


def test_watching_images_are_as_many_as_the_settings_say_and_choices_have_more(tmp_path: Path) -> None:
    members = [("train", 0.0)] + [("validation", p) for p in np.linspace(0.1, 0.9, 9)]
    catalog = field_catalog(
        tmp_path / "a.cdb", [ISOVALUE], members=members, view_splits=("train", *("validation",) * 6)
    )
    for wanted in (0, 3, 16):
        source = Source(TrainingSettings(validation_images=wanted), catalog)
        assert len(source.data(ISOVALUE).validation) == wanted
        assert len(source.decision_images(ISOVALUE)) == (DECISION_IMAGES if wanted else 0)


def test_the_histogram_is_that_of_all_training_members(catalog: Catalog) -> None:
    counts, edges = Source(TrainingSettings(), catalog).histogram
    assert counts is not None
    assert edges is not None
    one = summary(BLOBS)
    np.testing.assert_array_equal(counts, 2 * one.histogram)
    np.testing.assert_array_equal(edges, one.bin_edges)


def test_without_summaries_no_histogram_is_known(make_catalog) -> None:
    assert Source(TrainingSettings(), make_catalog()).histogram == (None, None)


def test_a_variation_that_no_training_member_shows_is_named_at_once(tmp_path: Path) -> None:
    catalog = field_catalog(tmp_path / "a.cdb", [ISOVALUE], members=MEMBERS, view_splits=VIEWS, shown_by=("test",))
    with pytest.raises(ValueError, match=r"holds no training images of iso=0.1"):
        Source(TrainingSettings(), catalog)
    assert Source(TrainingSettings(visualization_steps=0), catalog).variations == ()


def test_points_keep_their_places_and_lose_their_colours_under_another_appearance(catalog: Catalog) -> None:
    source = Source(TrainingSettings(gaussians=9, color_degree=0, carried="colors"), catalog)
    colors = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    vars(source)["points"] = StartPoints(np.array([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]]), colors)
    data = source.data()
    own, other = source.initial_gaussians(data), source.initial_gaussians(data, own_colors=False)
    assert {tuple(color) for color in own.colors.tolist()} == {tuple(color) for color in colors.tolist()}
    assert torch.equal(other.means, own.means)
    mean = foreground_color(data.examples, None)
    np.testing.assert_allclose(other.colors, np.broadcast_to(mean, (9, 3)), rtol=1e-6)
    wider = source.initial_gaussians(data, TrainingSettings(gaussians=5, color_degree=1))
    assert (len(wider), wider.color_degree) == (5, 1)


def test_parameters_over_decades_are_learnt_by_their_logarithms(catalog: Catalog) -> None:
    assert Source(TrainingSettings(), catalog).space == catalog.plan.space  # from 0 on
    wide = ParameterSpace((Parameter("nu", 1e-4, 1e-2), Parameter("h", 0.5, 0.9), Parameter("q", -1.0, 1.0)))
    plan = replace(catalog.plan, space=wide)
    source = Source(TrainingSettings(), catalog)
    object.__setattr__(source, "catalog", SimpleNamespace(plan=plan))
    assert [p.scale for p in source.space.parameters] == ["log", "linear", "linear"]
