"""Stage 3 in the flow of training: what it leaves alone, how it goes on after an interruption, and what it recovers."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import Variation, VariationSetting, displaced
from surrogate import Surrogate, TrainingSettings, train
from surrogate.training.compression.choice import Choice
from surrogate.training.compression.precision import precision_of_visualization
from surrogate.training.session import TrainingProgress
from tests.support.comparing import same
from tests.support.field_blobs import BLOBS, FUNCTION, FUNCTIONS, ISOVALUE, STEPS, appearance_of, field_catalog
from tests.support.interruptions import files, interrupt, kill_again_and_again, outcome

QUICK = TrainingSettings(
    carried="colors",
    gaussians=40,
    canonical_steps=6,
    deformation_steps=8,
    visualization_steps=10,
    latent_size=3,
    hidden_width=4,
    validation_interval=5,
    relocation_interval=5,
    checkpoint_seconds=1e6,
)
# Interruptions: at a step of all stages, or before a choice about the model.
MOMENTS: dict[str, Callable[[TrainingProgress], bool]] = {
    "stage 2": lambda p: p.step >= 10,
    "compression": lambda p: p.stage == "compression" and p.step == 1,
    "end of compression": lambda p: p.stage == "compression" and p.step == 2,
    "first degree": lambda p: p.stage == "varied colour degree",
    "first variation": lambda p: p.stage == "isovalue" and p.step >= 17,
    "between variations": lambda p: p.stage == "isovalue" and p.step == 24,
    "second degree": lambda p: p.stage == "varied colour degree" and p.step == 24,
    "second variation": lambda p: p.stage == "transfer_function" and p.step >= 27,
    "end": lambda p: p.stage == "transfer_function" and p.step == 34,
}


def with_settings(**settings: Any) -> TrainingSettings:
    return QUICK.changed(**settings)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    path = tmp_path_factory.mktemp("varied") / "field.cdb"
    members = (("train", 0.0), ("train", 1.0), ("validation", 0.4))
    return field_catalog(path, members=members, view_splits=("train",) * 2 + ("validation",), summaries=True)


@pytest.fixture(scope="module")
def undisturbed(catalog: Catalog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed") / "surrogate"
    train(QUICK, catalog, folder)
    return folder


def interrupted(settings: TrainingSettings, catalog: Catalog, folder: Path, when: str) -> None:
    """Train until the moment has come, then press Ctrl-C."""
    interrupt(MOMENTS[when], settings, catalog, folder)
    assert not Surrogate.exists(folder)


@pytest.mark.slow
@pytest.mark.parametrize(
    "moments",
    [[name] for name in MOMENTS] + [list(MOMENTS)],
    ids=[*MOMENTS, "again and again"],
)
def test_an_interrupted_run_ends_where_an_undisturbed_one_does(
    catalog: Catalog, undisturbed: Path, tmp_path: Path, moments: list[str]
) -> None:
    for moment in moments:
        interrupted(QUICK, catalog, tmp_path / "resumed", moment)
    train(QUICK, catalog, tmp_path / "resumed")
    assert outcome(tmp_path / "resumed") == outcome(undisturbed)
    assert files(tmp_path / "resumed") == ["model.json", "model.safetensors"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"fit_to_need": False, "color_degree": 0, "visualization_color_degree": 0},
        {"visualization_color_degree": 1},
        {"canonical_steps": 0, "deformation_steps": 14},
        {"validation_images": 0},
        {"carried": "values"},
    ],
    ids=["as it is", "lit surfaces", "jointly", "unwatched", "values"],
)
def test_every_way_to_train_goes_on_after_interruptions(catalog: Catalog, tmp_path: Path, settings: dict) -> None:
    chosen = with_settings(**settings)
    for moment in ("first variation", "second variation"):
        interrupted(chosen, catalog, tmp_path / "resumed", moment)
    resumed = train(chosen, catalog, tmp_path / "resumed")
    train(chosen, catalog, tmp_path / "undisturbed")
    assert outcome(tmp_path / "resumed") == outcome(tmp_path / "undisturbed")
    picture = resumed.at(p=0.3, isovalue=0.2).render(BLOBS.cameras()[0])
    assert np.isfinite(picture).all()
    if not chosen.fit_to_need or not chosen.validation_images:
        assert resumed.training["choices"] == []
        assert not resumed.encodings


@pytest.mark.slow
def test_a_degree_that_was_chosen_is_not_asked_again(
    catalog: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def choose(_: object, variation: Variation, *__: object) -> tuple[int, Choice]:
        asked.append(variation.kind)
        return int(variation.kind == "isovalue"), Choice("varied colour degree", "chosen")

    monkeypatch.setattr("surrogate.training.steps.choose_visualized_color_degree", choose)
    chosen = with_settings(color_degree=0)
    interrupted(chosen, catalog, tmp_path, "first variation")
    interrupted(chosen, catalog, tmp_path, "second variation")
    resumed = train(chosen, catalog, tmp_path)
    assert asked == ["isovalue", "transfer_function"]
    assert [v.color_degree for v in resumed.visualizations] == [1, 0]
    assert [c["name"] for c in resumed.training["choices"]].count("varied colour degree") == 2


def test_ctrl_c_during_the_last_choices_acts_once_they_are_kept(
    catalog: Catalog, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def press(*arguments: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        monkeypatch.undo()
        return precision_of_visualization(*arguments)

    monkeypatch.setattr("surrogate.training.steps.precision_of_visualization", press)
    with pytest.raises(KeyboardInterrupt):
        train(QUICK, catalog, tmp_path / "surrogate")
    assert outcome(tmp_path / "surrogate") == outcome(undisturbed)
    assert not (tmp_path / "surrogate" / "checkpoint.safetensors").exists()


def test_stage_3_changes_nothing_of_the_base_bit_for_bit(catalog: Catalog, tmp_path: Path) -> None:
    plain = with_settings(fit_to_need=False, color_degree=0)
    without = train(plain.changed(visualization_steps=0), catalog, tmp_path / "without")
    varied = train(plain, catalog, tmp_path / "with")
    assert same(varied.gaussians, without.gaussians)
    expected = without.deformation.tensors()
    assert all(torch.equal(tensor, expected[name]) for name, tensor in varied.deformation.tensors().items())
    assert without.visualizations == ()
    assert [v.simulation is None for v in varied.visualizations] == [False, True]
    for p in (0.0, 0.7):
        assert same(varied.at(p=p, c1_value=0.0).gaussians, without.at(p=p).gaussians)


def test_what_was_learnt_is_stored_and_read_again(catalog: Catalog, undisturbed: Path) -> None:
    finished, again = Surrogate.load(undisturbed), train(QUICK, catalog, undisturbed)
    names = ["colour degree", "steps at low rates", "attributes that deform", "modes of deformation"]
    varied = ["varied colour degree", "precision", "precision, isovalue", "precision, transfer function"]
    assert [choice["name"] for choice in finished.training["choices"]] == names + varied
    assert {point["stage"] for point in finished.training["curve"]} == {
        "canonical",
        "deformation",
        "isovalue",
        "transfer_function",
    }
    assert finished.training["steps"] == finished.training["curve"][-1]["step"] == 34
    assert len(finished.gaussians) == QUICK.gaussians  # one that the base does not show may be what others need
    assert any(name.startswith("visualization0.") for name in finished.encodings)
    assert any(name.startswith("visualization1.") for name in finished.encodings)
    for more in ({}, {"isovalue": 0.3}, {"c2_opacity": -0.2}):
        assert same(again.at(p=0.4, **more).gaussians, finished.at(p=0.4, **more).gaussians)
    assert same(finished.at(p=0.4, c1_value=0.0).gaussians, finished.at(p=0.4).gaussians)


def test_an_unknown_appearance_is_named_before_anything_is_trained(catalog: Catalog, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"training\.appearance must be one of"):
        train(with_settings(appearance="other"), catalog, tmp_path / "surrogate")
    assert not (tmp_path / "surrogate").exists()


def test_a_variations_changed_images_are_another_run(catalog: Catalog, tmp_path: Path) -> None:
    fewer = replace(ISOVALUE, settings=ISOVALUE.settings[:-1])
    members = (("train", 0.0),)
    first = field_catalog(tmp_path / "a.cdb", [ISOVALUE], members=members, view_splits=("train",))
    other = field_catalog(tmp_path / "b.cdb", [fewer], members=members, view_splits=("train",))
    train(QUICK, first, tmp_path / "surrogate")
    with pytest.raises(ValueError, match="delete or rename that folder"):
        train(QUICK, other, tmp_path / "surrogate")


def test_without_validation_images_nothing_is_chosen(tmp_path: Path) -> None:
    kept = tuple(s for s in FUNCTIONS.settings if s.split != "validation")
    for settings in (kept, FUNCTIONS.settings):  # those of a variation alone say nothing of the base
        variation = replace(FUNCTIONS, settings=settings)
        path = tmp_path / f"{len(settings)}"
        catalog = field_catalog(path / "a.cdb", [variation], members=(("train", 0.2),), view_splits=("train",) * 2)
        surrogate = train(QUICK, catalog, path / "surrogate")
        assert surrogate.training["choices"] == []
        assert not surrogate.encodings


@pytest.mark.parametrize("steps", [(0, 10), (10, 0), (0, 0)], ids=str)
@pytest.mark.parametrize("variations", [(), (ISOVALUE, FUNCTIONS)], ids=["plain", "varied"])
def test_any_stage_may_be_left_out(tmp_path: Path, steps: tuple[int, int], variations: tuple) -> None:
    members = (("train", 0.0), ("validation", 1.0))
    catalog = field_catalog(tmp_path / "a.cdb", variations, members=members, view_splits=("train", "validation"))
    chosen = with_settings(canonical_steps=steps[0], deformation_steps=steps[1])
    surrogate = train(chosen, catalog, tmp_path / "surrogate")
    assert {"canonical": steps[0] > 0, "deformation": steps[1] > 0} == {
        stage: any(point["stage"] == stage for point in surrogate.training["curve"])
        for stage in ("canonical", "deformation")
    }
    assert np.isfinite(surrogate.at(p=0.5).render(BLOBS.cameras()[0])).all()


def test_both_are_learnt_jointly_from_the_start(catalog: Catalog, tmp_path: Path) -> None:
    """Without stage 1 the first picture is what initialization says, and F_sim moves from the first step on."""
    chosen = with_settings(
        canonical_steps=0, deformation_steps=30, visualization_steps=0, fit_to_need=False, color_degree=0
    )
    surrogate = train(chosen, catalog, tmp_path)
    stages = [(point["stage"], point["step"]) for point in surrogate.training["curve"]]
    assert stages == [("deformation", step) for step in range(5, 31, 5)]
    assert surrogate.training["curve"][-1]["loss"] < surrogate.training["curve"][0]["loss"]
    low, high = surrogate.at(p=0.0), surrogate.at(p=1.0)
    assert not np.array_equal(low.means, high.means)


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_where_an_undisturbed_one_does(
    catalog: Catalog, undisturbed: Path, tmp_path: Path
) -> None:
    settings = with_settings(checkpoint_seconds=1e-4)
    folder = tmp_path / "surrogate"
    assert kill_again_and_again(settings, catalog, folder) >= 5
    train(settings, catalog, folder)
    assert outcome(folder) == outcome(undisturbed)


def decibels(truth: np.ndarray, picture: np.ndarray) -> float:
    """PSNR on white."""
    on_white = [image[..., :3] + 1.0 - image[..., 3:] for image in (truth, picture)]
    return float(-10.0 * np.log10(np.mean((on_white[0] - on_white[1].clip(0, 1)) ** 2)))


def nearest(variation: Variation, unseen: VariationSetting) -> VariationSetting:
    """The trained setting whose normalized parameters are nearest."""
    trained = [s for s in variation.settings if s.split == "train"]
    return min(
        trained, key=lambda s: np.linalg.norm(variation.normalize(s.values) - variation.normalize(unseen.values))
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("carried", "variation", "better"),
    [
        pytest.param("values", FUNCTIONS, 1.0, marks=pytest.mark.slow),
        ("colors", FUNCTIONS, 3.0),
        pytest.param("colors", ISOVALUE, 3.0, marks=pytest.mark.slow),
    ],
    ids=["carried values", "functions", "isovalue"],
)
def test_unseen_settings_at_unseen_parameters_are_recovered(
    tmp_path: Path, carried: str, variation: Variation, better: float
) -> None:
    """Better than the truth of the nearest trained setting, at the very member and view that is predicted."""
    members = [("train", p) for p in (0.0, 0.33, 0.67, 1.0)]
    catalog = field_catalog(tmp_path / "a.cdb", [variation], members=members, view_splits=("train",) * 8)
    settings = TrainingSettings(
        carried=carried,
        gaussians=150,
        canonical_steps=300,
        deformation_steps=1000,
        visualization_steps=800,
        latent_size=6,
        hidden_width=16,
        fit_to_need=False,
        color_degree=0,
        validation_interval=0,
    )
    surrogate = train(settings, catalog, tmp_path / "surrogate")
    predicted, copied = [], []
    for setting in (s for s in variation.settings if s.split == "test"):
        values = dict(zip(variation.space.names, setting.values, strict=True))
        for camera in BLOBS.cameras(2)[12::8]:
            truth = BLOBS.drawn(0.5, appearance_of(setting), camera)
            predicted.append(decibels(truth, surrogate.at(p=0.5, **values).render(camera)))
            copied.append(decibels(truth, BLOBS.drawn(0.5, appearance_of(nearest(variation, setting)), camera)))
    assert np.mean(predicted) > np.mean(copied) + better
    if variation is FUNCTIONS:
        function = displaced(FUNCTION, setting.values)
        np.testing.assert_allclose(
            surrogate.under(function, p=0.5).opacities, surrogate.at(p=0.5, **values).opacities, atol=1e-5
        )


def test_the_box_of_displacements_is_normalized_by_its_steps() -> None:
    place = np.array([0.3, -0.2, 1.0, -1.0])
    np.testing.assert_allclose(FUNCTIONS.normalize((place * STEPS).tolist()), place, atol=1e-12)
