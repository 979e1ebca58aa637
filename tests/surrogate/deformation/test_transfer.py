"""Changed transfer functions: the kernel against its twin in float64, forward and backward, and where it is taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from surrogate.deformation.transfer import LEAST_DEPTH, Transfer
from surrogate.gaussians import NAMES, Gaussians
from tests.support.kernel_calls import recorded

UNIT = 2.0**-24  # of rounding, float32
PALETTE = ((0.1, 0.0, 0.3), (0.8, 0.4, 0.5), (0.2, 0.9, 0.4))


def transfer(values: int, size: float = 0.3) -> Transfer:
    return Transfer(np.random.default_rng(values).normal(0, size, (values, 4)), PALETTE)


def gaussians(count: int, color_columns: int = 3) -> Gaussians:
    random = torch.Generator().manual_seed(count)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, color_columns))
    means, log_scales, quats, logits, colors = (torch.randn(shape, generator=random) for shape in shapes)
    return Gaussians(means, log_scales, quats, 3.0 * logits, 0.5 + 0.5 * colors)


def weights(count: int, values: int) -> torch.Tensor:
    random = torch.Generator().manual_seed(values)
    return 0.5 * torch.randn((count, values), generator=random)


def doubled(shown: Gaussians) -> Gaussians:
    return Gaussians(*(t.double() for t in shown.tensors().values()))


def float32_changes(asked: Transfer) -> Transfer:
    """With the changes that the kernel is given."""
    return replace(asked, changes=asked.changes.astype(np.float32).astype(np.float64))


@pytest.mark.parametrize("count", [0, 1, 65, 2000])
@pytest.mark.parametrize("color_columns", [3, 12])
@pytest.mark.parametrize("values", [2, 32])
def test_the_kernel_is_the_definition(count: int, color_columns: int, values: int) -> None:
    shown, of, asked = gaussians(count, color_columns), weights(count, values), transfer(values)
    found = asked.applied_to(shown, of)
    expected = float32_changes(asked).offsets(doubled(shown), of.double()).applied_to(doubled(shown))
    # the bounds of tests/native/kernels/test_transfer.py, at their largest for what can be seen
    seen = expected.opacity_logits > -4.0  # [N], opacities above 0.018
    for name, tolerance in (("opacity_logits", 1e-5), ("colors", 1e-5)):
        got, wanted = getattr(found, name).double(), getattr(expected, name)
        assert got.shape == wanted.shape
        assert torch.allclose(got[seen], wanted[seen], rtol=0.0, atol=tolerance)
    assert all(getattr(found, name) is getattr(shown, name) for name in NAMES[:3])


@pytest.mark.parametrize(("values", "units"), [(1, 256), (2, 32), (31, 3), (32, 3), (100, 3)])
@pytest.mark.parametrize("color_columns", [3, 12])
def test_its_gradient_is_that_of_the_definition(values: int, units: int, color_columns: int) -> None:
    """Within `units` of rounding times the condition of what it divides by, the depth, which is a sum of larger terms.

    The definition in float32 is as far from that in float64.  Of few values the terms of the gradient itself may cancel.
    """
    shown, of, asked = gaussians(1500, color_columns), weights(1500, values), float32_changes(transfer(values))
    random = torch.Generator().manual_seed(7)
    by_logits, by_colors = torch.randn(1500, generator=random), torch.randn((1500, color_columns), generator=random)
    found = {}
    for dtype in (torch.float32, torch.float64):
        given = shown if dtype == torch.float32 else doubled(shown)
        leaf = of.to(dtype).requires_grad_()
        deformed = asked.applied_to(given, leaf)
        loss = (deformed.opacity_logits * by_logits).sum() + (deformed.colors * by_colors).sum()
        (found[dtype],) = torch.autograd.grad(loss, leaf)
    sizes, before = of.double().abs(), torch.nn.functional.softplus(shown.opacity_logits.double())  # [N, B], [N]
    sums, terms = (sizes @ torch.from_numpy(table) for table in (asked.changes, np.abs(asked.changes)))  # [N, 4]
    after = (before + sums[:, 0]).clamp(min=LEAST_DEPTH)  # [N]
    condition = 1.0 + (before + terms.sum(dim=1)) / after  # [N]
    wrong = (found[torch.float32].double() - found[torch.float64]).abs().amax(dim=1)  # [N]
    largest = found[torch.float64].abs().amax(dim=1)  # [N]
    assert (wrong <= units * UNIT * condition * largest.clamp(min=1e-3)).all()


@pytest.mark.parametrize("attribute", ["weights", "opacity_logits", "colors"])
@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
def test_what_is_not_finite_is_so_in_the_twin_too(attribute: str, value: float) -> None:
    shown, of, asked = gaussians(8), weights(8, 5), transfer(5)
    of[4:] = of[4:].abs() * 3.0
    shown.opacity_logits[::2] = torch.tensor([-40.0, 40.0, -8.0, 1.0])
    place = of if attribute == "weights" else getattr(shown, attribute)
    place.view(8, -1)[:, 0] = value
    found, twin = asked.applied_to(shown, of), asked.offsets(shown, of).applied_to(shown)
    for name in ("opacity_logits", "colors"):
        got, wanted = getattr(found, name), getattr(twin, name)
        assert torch.equal(got.isnan(), wanted.isnan())
        infinite = wanted.isinf()
        assert torch.equal(got.isinf(), infinite)
        assert torch.equal(got[infinite], wanted[infinite])


def test_only_where_it_can_the_kernel_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = recorded(monkeypatch, "transfer", "transfer_gradient")
    shown, of, asked = gaussians(20), weights(20, 5), transfer(5)

    def taken(given: Gaussians, leaf: torch.Tensor) -> list[str]:
        calls.clear()
        found = asked.applied_to(given, leaf)
        if found.opacity_logits.requires_grad:
            (found.opacity_logits.sum() + found.colors.sum()).backward()
        return list(calls)

    assert taken(shown, of) == ["transfer"]
    assert taken(shown, of.clone().requires_grad_()) == ["transfer", "transfer_gradient"]
    assert taken(doubled(shown), of.double()) == []
    for name in ("opacity_logits", "colors"):
        moving = replace(shown, **{name: getattr(shown, name).clone().requires_grad_()})
        assert taken(moving, of) == []
        with torch.no_grad():
            assert taken(moving, of) == ["transfer"]


def test_gradients_may_lie_anyhow_in_memory() -> None:
    shown, of, asked = gaussians(9, 12), weights(9, 5).requires_grad_(), transfer(5)
    found = []
    for ones in (torch.ones(()).expand(9, 12), torch.ones(9, 12), torch.ones(12, 9).T):
        found += torch.autograd.grad(asked.applied_to(shown, of).colors, of, ones)
    assert torch.equal(found[0], found[1])
    assert torch.equal(found[0], found[2])


def test_gaussians_and_weights_may_lie_anyhow_in_memory() -> None:
    shown, of, asked = gaussians(9, 12), weights(9, 5), transfer(5)
    anyhow = replace(
        shown, colors=shown.colors.T.contiguous().T, opacity_logits=torch.stack(2 * [shown.opacity_logits], 1)[:, 0]
    )
    found, expected = asked.applied_to(anyhow, of.T.contiguous().T), asked.applied_to(shown, of)
    assert all(torch.equal(getattr(found, name), getattr(expected, name)) for name in NAMES)
