"""Parameters and initial rates of the stages."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from surrogate import TrainingSettings
from surrogate.gaussians import Gaussians
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.stages import FINAL_FACTOR, PREFIX, canonical_stage, decay, new_deformation, simulation_stage
from tests.support.blobs import Blobs


@pytest.mark.parametrize(
    ("steps", "step", "warmth"),
    [
        (11_000, 0, 1 / 500),
        (11_000, 249, 0.5),
        (11_000, 499, 1.0),
        (11_000, 10_999, 1.0),
        (800, 19, 0.5),
        (800, 40, 1.0),
        (1, 0, 1.0),
    ],
)
def test_rates_of_the_deformation_rise_over_500_steps_or_a_twentieth_of_the_stage(
    steps: int, step: int, warmth: float
) -> None:
    settings = TrainingSettings(gaussians=5, deformation_steps=steps)
    gaussians = Gaussians(torch.zeros(5, 3), torch.zeros(5, 3), torch.ones(5, 4), torch.zeros(5), torch.zeros(5, 3))
    stage = simulation_stage(gaussians, new_deformation(gaussians, 1, settings), settings)
    assert stage.warmth(step) == pytest.approx(warmth)
    assert stage.warming == {name for name in stage.tensors if name.startswith(PREFIX)}
    assert not canonical_stage(gaussians, settings).warming


def test_the_first_step_moves_the_deformation_by_a_part_of_its_rate_and_the_gaussians_by_all_of_it(
    make_catalog,
) -> None:
    settings = TrainingSettings(gaussians=30, deformation_steps=200, color_degree=0)
    source = Source(settings, make_catalog(Blobs(count=4, size=16), view_splits=("train",) * 3))
    data = source.data()
    gaussians = source.initial_gaussians(data)
    stage = simulation_stage(gaussians, new_deformation(gaussians, 1, settings), settings)
    moved: dict[bool, dict[str, float]] = {}
    for warm in (False, True):
        kept = {name: tensor.detach().clone() for name, tensor in stage.tensors.items()}
        StageRun(stage if warm else replace(stage, warming=frozenset()), settings, data).advance()
        with torch.no_grad():
            moved[warm] = {name: float((tensor - kept[name]).abs().max()) for name, tensor in stage.tensors.items()}
            for name, tensor in stage.tensors.items():
                tensor.copy_(kept[name])
    for name in ("means", PREFIX + "weights_out"):
        part = 0.1 if name in stage.warming else 1.0
        assert moved[False][name] > 0.0
        assert moved[True][name] == pytest.approx(part * moved[False][name], rel=1e-3)


@pytest.mark.parametrize(
    ("factor", "done", "expected"),
    [
        (FINAL_FACTOR, 0.0, 1.0),
        (FINAL_FACTOR, 0.5, 0.2**0.5),
        (FINAL_FACTOR, 0.7, 0.2**0.7),  # where the last 30 % begin
        (FINAL_FACTOR, 0.85, 0.5 * 0.2**0.85),
        (FINAL_FACTOR, 1.0, 0.0),
        (0.05, 0.5, 0.05**0.5),
    ],
)
def test_rates_fall_exponentially_and_to_zero_at_the_end(factor: float, done: float, expected: float) -> None:
    assert decay(done, factor) == pytest.approx(expected, abs=1e-12)
