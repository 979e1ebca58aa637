"""A training that goes on from its state is the same as one that never stopped, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from research.studies.baselines import (
    gs_surrogate,
    gs_surrogate_separate,
    hexplane_gaussians,
    insitunet,
    kplanes,
    visnerf,
)
from research.studies.baselines.method import Method, Plan
from research.studies.baselines.state import inner, of_optimizer, outer, restore_optimizer
from surrogate.storage.checkpoints import Checkpoint
from tests.research.support.baseline_scenes import ball_pictures

METHODS = (gs_surrogate.METHOD, hexplane_gaussians.METHOD, kplanes.METHOD, visnerf.METHOD, insitunet.METHOD)
FUNCTIONS, ISOSURFACES = gs_surrogate_separate.FOR_FUNCTIONS, gs_surrogate_separate.FOR_ISOSURFACES
PICTURES = ball_pictures([[-1.0], [1.0]], views=2, size=16)
VARIED = replace(ball_pictures([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0]], views=2, size=16), visualization=1)


@pytest.mark.parametrize(
    ("method", "before"),
    [
        (hexplane_gaussians.METHOD, 0),
        *((method, 3) for method in METHODS),
        *((FUNCTIONS, steps) for steps in (0, 2, 3, 5)),  # of 3 for the volume and 3 for the functions
        (ISOSURFACES, 3),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_a_method_goes_on_from_its_checkpoint(
    method: Method, before: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gs_surrogate, "RENEWAL", 30_000)  # chances are renewed after a step or two
    monkeypatch.setitem(insitunet.EXTENTS, "small", insitunet.NetworkSize(2, 4))  # steps of milliseconds
    monkeypatch.setattr(insitunet, "InSituNetArchitecture", partial(insitunet.InSituNetArchitecture, width=32))
    monkeypatch.setattr(
        kplanes, "SMALL", replace(kplanes.SMALL, resolutions=(8, 16), proposals=(16,), samples=(16, 12))
    )
    monkeypatch.setitem(visnerf.SIZES, "small", visnerf.Sizes(64, 6, 12, 1.0, 8**3 + 1))
    plan, pictures = Plan(6, seed=1, size="small"), VARIED if method in (FUNCTIONS, ISOSURFACES) else PICTURES
    prepared = {} if method.prepare is None else method.prepare(pictures, 0, count=60, steps=5)  # type: ignore[call-arg]
    whole, first, second = (method.begin(pictures, plan, prepared) for _ in range(3))
    losses = [whole.advance() for _ in range(6)]
    for _ in range(before):
        first.advance()
    Checkpoint(first.state(), {}).save(tmp_path)
    kept = Checkpoint.load(tmp_path)
    assert kept is not None
    second.restore(before, kept.tensors)
    assert [second.advance() for _ in range(6 - before)] == losses[before:]
    for name, tensor in whole.tensors().items():
        assert torch.equal(tensor, second.tensors()[name]), name
    parameters, camera = pictures.parameters[-1], pictures.camera(0)
    np.testing.assert_array_equal(second.at(parameters)(camera), whole.at(parameters)(camera))


def test_moments_lie_as_their_tensor_does() -> None:
    def trained() -> tuple[torch.Tensor, torch.optim.Adam]:
        tensor = torch.ones(2, 3, 4, 5).to(memory_format=torch.channels_last).requires_grad_()
        return tensor, torch.optim.Adam([tensor], fused=True)

    (one, adam), (other, another) = trained(), trained()
    (one * torch.arange(120.0).view(2, 3, 4, 5)).sum().backward()
    adam.step()
    restore_optimizer(another, {name: tensor.contiguous() for name, tensor in of_optimizer(adam).items()})
    assert another.state[other]["exp_avg"].stride() == other.stride()
    other.grad = one.grad.clone(memory_format=torch.preserve_format)
    for optimizer in (adam, another):
        optimizer.step()
    assert torch.equal(one, other)


def test_parts_are_taken_apart_as_they_were_put_together() -> None:
    parts = {"adam": {"0": torch.zeros(2), "0.step": torch.ones(())}, "ad": {"a.m": torch.ones(3)}}
    whole = outer(**parts)
    for name, part in parts.items():
        assert inner(whole, name) == part


def test_what_is_missing_is_named() -> None:
    tensor = torch.zeros(2, requires_grad=True)
    with pytest.raises(KeyError, match="0"):
        restore_optimizer(torch.optim.Adam([tensor]), {})
