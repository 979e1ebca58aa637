"""Predictors of settings: what they know, and the weights that they give it."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.evaluation.cases import Case
from surrogate.evaluation.trivial.interpolation import joint_rules, setting_rules
from surrogate.evaluation.trivial.mixtures import Mixtures
from surrogate.evaluation.trivial.settings import SettingPictures, TrainedPictures, TrainedSettings
from tests.support.varied_blobs import FUNCTIONS, ISOVALUE, PLACES, varied_catalog, varied_surrogate


def test_the_base_is_known_among_transfer_functions_and_not_among_isovalues() -> None:
    isovalues, functions = TrainedSettings.of(ISOVALUE), TrainedSettings.of(FUNCTIONS)
    assert isovalues.appearances == ISOVALUE.named("train")
    np.testing.assert_allclose(isovalues.places[:, 0], [-1, -1 / 3, 1 / 3, 1])
    assert functions.appearances == (*FUNCTIONS.named("train"), "dvr")
    np.testing.assert_allclose(functions.places, [*PLACES["train"], (0, 0, 0, 0)], atol=1e-12)


def test_only_what_is_shown_is_known() -> None:
    some = TrainedSettings.of(FUNCTIONS).among(("dvr", "iso=1", "tf-test-0", "tf-train-2"))
    assert some.appearances == ("tf-train-2", "dvr")
    assert len(TrainedSettings.of(ISOVALUE).among(("dvr", "iso=2.5"))) == 0
    assert TrainedSettings.of(ISOVALUE).among(("dvr",)).places.shape == (0, 1)


def test_nearest_is_by_the_distance_that_a_network_sees() -> None:
    assert TrainedSettings.of(ISOVALUE).nearest(ISOVALUE.normalize((8.0,))) == "iso=4"
    assert TrainedSettings.of(ISOVALUE).nearest(ISOVALUE.normalize((11.0,))) == "iso=16"  # 10 is midway
    assert TrainedSettings.of(FUNCTIONS).nearest(np.array([0.75, 0.25, 0, 0])) == "tf-train-0"
    assert TrainedSettings.of(FUNCTIONS).nearest(np.array([0.2, 0.25, 0, 0])) == "dvr"


@pytest.mark.parametrize(
    ("isovalue", "weights"), [(2.5, {"iso=2": 0.75, "iso=4": 0.25}), (8.0, {"iso=4": 2 / 3, "iso=16": 1 / 3})]
)
def test_isovalues_are_interpolated_between_their_neighbours(
    isovalue: float, weights: dict[str, float], tmp_path
) -> None:
    catalog = varied_catalog(tmp_path / "a.cdb", varied_surrogate(), {"train-0": (0.0, ISOVALUE.named("train"))})
    member = catalog.member("train-0")
    mixtures = Mixtures(catalog, SettingPictures(ISOVALUE), setting_rules(1, "isovalues"))
    [(cases, draw)] = mixtures.batches([Case(member, 2, "unseen", {"isovalue": isovalue})])
    nearest, between = draw(cases[0])
    pictures = {name: catalog.image(member, name, 2) / 255.0 for name in weights}
    np.testing.assert_allclose(between, sum(w * pictures[name] for name, w in weights.items()), atol=1e-5)
    np.testing.assert_allclose(nearest, pictures[max(weights, key=weights.__getitem__)], atol=1e-6)


def test_unseen_members_are_mixed_from_training_members_under_trained_settings(tmp_path) -> None:
    trained = ISOVALUE.named("train")
    members = {
        "train-0": (0.0, trained),
        "train-1": (1.0, trained),
        "train-2": (0.6, trained[:1]),
        "test-0": (0.75, ()),
    }
    of_test = {"test-0": (0.75, ("dvr",)), **{name: of for name, of in members.items() if name != "test-0"}}
    catalog = varied_catalog(tmp_path / "a.cdb", varied_surrogate(), of_test)
    pictures = TrainedPictures.of(ISOVALUE, catalog.plan.space, catalog.members)
    assert pictures is not None
    assert [m.name for m in pictures.pictures.members] == ["train-0", "train-1"]  # that show all trained settings
    [(cases, draw)] = Mixtures(catalog, pictures, joint_rules(1, 1)).batches(
        [Case(catalog.member("test-0"), 2, "unseen", {"isovalue": 2.5})]
    )
    nearest, between = draw(cases[0])

    def stored(member: str, setting: str) -> np.ndarray:
        return catalog.image(member, setting, 2) / 255.0

    np.testing.assert_allclose(nearest, stored("train-1", "iso=2"), atol=1e-6)
    weights = {("train-0", "iso=2"): 0.1875, ("train-0", "iso=4"): 0.0625, ("train-1", "iso=2"): 0.5625}
    weights["train-1", "iso=4"] = 0.1875
    np.testing.assert_allclose(between, sum(w * stored(*of) for of, w in weights.items()), atol=1e-5)
    assert TrainedPictures.of(FUNCTIONS, catalog.plan.space, catalog.members) is None
