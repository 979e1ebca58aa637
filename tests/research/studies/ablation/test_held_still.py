"""Attributes that the simulation's parameters do not move, in training."""

from pathlib import Path

import pytest
import torch

from surrogate.gaussians import NAMES
from surrogate.settings import TrainingSettings
from surrogate.training.run import train
from tests.support.blobs import Blobs

QUICK = TrainingSettings(gaussians=30, canonical_steps=10, deformation_steps=15, fit_to_need=False, color_degree=0)


@pytest.mark.parametrize("kind", ["bilinear", "paper"])
@pytest.mark.parametrize("still", [("opacity_logits", "colors"), ("means", "log_scales", "quats"), NAMES])
def test_what_is_held_still_does_not_follow_the_parameters(
    make_catalog, tmp_path: Path, kind: str, still: tuple[str, ...]
) -> None:
    catalog = make_catalog(Blobs(count=4, size=16), view_splits=("train",) * 3)
    settings = QUICK.changed(held_still=still, deformation=kind)
    surrogate = train(settings, catalog, tmp_path / "surrogate")
    low, high = (surrogate.at(p=p).gaussians for p in (0.0, 1.0))
    for name in NAMES:
        moved = not torch.equal(getattr(low, name), getattr(high, name))
        assert moved == (name not in still), name
        assert surrogate.deformation.moves(name) == (name not in still)


def test_settings_survive_json_and_runs_from_before_are_still_recognized() -> None:
    settings = TrainingSettings(held_still=["means", "colors"])
    assert settings.designs.held_still == ("means", "colors")
    assert TrainingSettings(**settings.to_json()) == settings
    assert "held_still" not in TrainingSettings().to_json()


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        ("means", "training.held_still must be a list of strings, got 'means'"),
        ([3], "training.held_still must be a list of strings"),
        (["places"], r"training.held_still must be some of \['means'"),
    ],
)
def test_nonsense_is_named(value: object, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        TrainingSettings(held_still=value)
