"""A training that runs away says so, and keeps nothing of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from surrogate import TrainingSettings, train
from surrogate.gaussians import Gaussians
from surrogate.storage.checkpoints import Checkpoint
from surrogate.training.loop import Diverged, LoopMemory, StageRun, as_drawn, first_huge, first_infinite, is_visible
from surrogate.training.optimizer import Adam
from surrogate.training.source import Source
from surrogate.training.stages import RATES, canonical_stage
from tests.support.blobs import Blobs

SMALL = Blobs(count=4, size=16)
QUICK = TrainingSettings(
    gaussians=30, canonical_steps=10, deformation_steps=20, color_degree=0, fit_to_need=False, checkpoint_seconds=1e-9
)
COMPLAINT = (
    r"^training diverged in stage {stage} at step \d+ of {steps}, where {what} is (-?(inf|nan)|\S+ boxes): "
    r"lower the rates in the scene's \[training\] table, or as KEY=VALUE"
)


def complaint(stage: str, steps: int, what: str) -> str:
    return COMPLAINT.format(stage=stage, steps=steps, what=what)


def test_rates_fall_to_nothing_over_each_stage(make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    factors, step = [], Adam.step

    def told(adam: Adam, factor: float, *rest) -> None:
        factors.append(factor)
        step(adam, factor, *rest)

    monkeypatch.setattr(Adam, "step", told)
    settings = QUICK
    train(settings, make_catalog(SMALL, view_splits=("train",) * 3), tmp_path / "surrogate")
    falls = [0.2**done * min(1.0, (1.0 - done) / 0.3) for steps in (10, 20) for done in np.arange(steps) / steps]
    assert factors == pytest.approx([settings.batch**0.5 * fall for fall in falls])


def test_the_first_number_that_is_not_finite_is_named() -> None:
    tensors = {"means": torch.zeros(4, 3), "latents": torch.zeros(4, 2), "one": torch.tensor(torch.nan)}
    assert first_infinite(tensors) == "one is nan"
    tensors["latents"][2, 1] = -torch.inf
    assert first_infinite(tensors) == "latents[2, 1] is -inf"
    assert first_infinite({"means": tensors["means"]}) == ""


def test_scales_may_be_infinite_where_their_logarithms_are_not() -> None:
    shown = Gaussians(torch.zeros(2, 3), torch.full((2, 3), 90.0), torch.ones(2, 4), torch.zeros(2), torch.zeros(2, 3))
    assert first_infinite(shown.tensors()) == ""
    assert first_infinite(as_drawn(shown)) == "scales[0, 0] is inf"


def drawn(scale: float, opacity: float = 0.5, place: float = 0.0) -> dict[str, torch.Tensor]:
    """Four Gaussians as they are drawn, of which the third has one scale, opacity and place of its own."""
    shown = {"means": torch.zeros(4, 3), "scales": torch.full((4, 3), 9e3), "opacities": torch.full((4,), 0.001)}
    shown["scales"][2, 1], shown["opacities"][2], shown["means"][2, 0] = scale, opacity, place
    return shown


def test_a_scale_that_no_box_can_need_is_named_where_it_is_seen() -> None:
    assert first_huge(drawn(9e3), 0.004) == ""
    assert first_huge(drawn(4e9), 0.004) == "scales[2, 1] is 2e+09 boxes"
    assert first_huge(drawn(4e9, opacity=0.003), 0.004) == ""


def test_what_is_faint_or_far_away_is_not_seen() -> None:
    assert is_visible(drawn(9e3), 0.004).tolist() == [False, False, True, False]
    assert not is_visible(drawn(9e3, opacity=0.003), 0.004).any()
    far = drawn(1.0, place=40.0)
    far["scales"][:] = 1.0
    assert not is_visible(far, 0.004).any()


def test_a_training_that_shows_nothing_any_more_has_diverged(
    make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(RATES, "means", 90.0)
    monkeypatch.setitem(RATES, "log_scales", 1e-9)
    catalog = make_catalog(SMALL, view_splits=("train",) * 3)
    with pytest.raises(
        Diverged, match=r"stage canonical at step \d+ of 10, where no Gaussian is seen in a picture of \S+: lower"
    ):
        train(QUICK, catalog, tmp_path / "surrogate")


def test_what_ran_away_but_is_finite_has_diverged(
    make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(RATES, "log_scales", 6.0)
    catalog = make_catalog(SMALL, view_splits=("train",) * 3)
    with pytest.raises(
        Diverged, match=r"stage canonical at step \d+ of 10, where scales\[\d+, \d\] is \S+ boxes: lower"
    ):
        train(QUICK, catalog, tmp_path / "surrogate")


@pytest.mark.parametrize(
    ("rates", "changes", "stage", "steps", "what"),
    [
        ({"log_scales": 60.0}, {}, "canonical", 10, r"scales\[\d+, \d\]"),
        ({}, {"canonical_steps": 0, "latent_rate": 1e38}, "deformation", 20, r"[\w.]+\[\d+(, \d+)?\]"),
        ({"colors": 1e39}, {}, "canonical", 10, r"colors\[\d+, \d\]"),
    ],
)
def test_it_says_where_and_what_helps(
    make_catalog, tmp_path: Path, rates: dict, changes: dict, stage: str, steps: int, what: str, monkeypatch
) -> None:
    for name, rate in rates.items():
        monkeypatch.setitem(RATES, name, rate)
    catalog, settings = make_catalog(SMALL, view_splits=("train",) * 3), QUICK.changed(**changes)
    for _ in range(2):  # from the last checkpoint too
        with pytest.raises(ValueError, match=complaint(stage, steps, what)):
            train(settings, catalog, tmp_path / "surrogate")
        kept = Checkpoint.load(tmp_path / "surrogate")
        assert kept is None or first_infinite({n: t for n, t in kept.tensors.items() if "moments" not in n}) == ""
    assert not (tmp_path / "surrogate" / "model.safetensors").exists()


def test_the_last_good_checkpoint_stays(make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    catalog, steps, advance = make_catalog(SMALL, view_splits=("train",) * 3), [], StageRun.advance

    def spoilt(run: StageRun, pause: bool) -> float:
        loss = advance(run, pause)
        steps.append(run.step)
        if len(steps) == 5:
            with torch.no_grad():
                run.stage.tensors["quats"][7, 2] = torch.nan
        return loss

    monkeypatch.setattr(StageRun, "advance", spoilt)
    with pytest.raises(ValueError, match=complaint("canonical", 10, r"quats\[7, 2\]")):
        train(QUICK, catalog, tmp_path / "surrogate")
    kept = Checkpoint.load(tmp_path / "surrogate")
    assert kept is not None
    assert kept.record["step"] == 4


def test_what_diverges_in_the_last_step_is_no_model(
    make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    catalog, advance = make_catalog(SMALL, view_splits=("train",) * 3), StageRun.advance

    def spoilt(run: StageRun, pause: bool) -> float:
        loss = advance(run, pause)
        if (run.stage.name, run.step) == ("deformation", 20):
            with torch.no_grad():
                run.stage.tensors["deformation.latents"][0] = torch.nan
        return loss

    monkeypatch.setattr(StageRun, "advance", spoilt)
    settings = QUICK.changed(validation_images=0, checkpoint_seconds=1e9)
    with pytest.raises(ValueError, match=complaint("deformation", 20, r"deformation.latents\[0, 0\]")):
        train(settings, catalog, tmp_path / "surrogate")
    assert not list((tmp_path / "surrogate").glob("*.safetensors"))


def test_an_error_of_another_kind_is_told_as_it_is(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(SMALL, view_splits=("train",) * 3)
    with pytest.raises(ValueError, match="backend must be one of"):
        train(QUICK.changed(backend="nonsense"), catalog, tmp_path / "surrogate")


def test_a_stage_resumes_from_the_whole_memory_alone(make_catalog) -> None:
    source = Source(QUICK, make_catalog(SMALL, view_splits=("train",) * 3))
    data = source.data()
    begun = StageRun(canonical_stage(source.initial_gaussians(data), QUICK), QUICK, data)
    for _ in range(4):
        begun.advance()
    memory = begun.memory()
    run = StageRun(begun.stage, QUICK, data, memory)
    for name, tensor in run.memory().tensors.items():
        assert torch.equal(tensor, memory.tensors[name])
    with pytest.raises(KeyError):
        StageRun(begun.stage, QUICK, data, LoopMemory(4, {}))
