"""Two deformations at once are one after the other: bit for bit by the kernel, and within rounding of float64."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
import torch

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.deformation import (
    BilinearDeformation,
    ValuesDeformation,
    compose,
)
from surrogate.gaussians import NAMES, Gaussians
from surrogate.settings import TrainingSettings

AT_FIRST, AT_SECOND = torch.tensor([0.3]), torch.tensor([0.3, -0.7])
FUNCTION = TransferFunction(((0, 1, 0, 0), (3, 0, 1, 0)), ((0, 0), (1, 0.3), (2, 0.6), (3, 1)), 0.5)


def canonical(count: int, color_columns: int) -> Gaussians:
    random = torch.Generator().manual_seed(1)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, color_columns))
    return Gaussians(*(torch.randn(shape, generator=random) for shape in shapes))


def bilinear(gaussians: Gaussians, parameters: int, latent: int, color_columns: int = 3) -> BilinearDeformation:
    settings = TrainingSettings(latent_size=latent, hidden_width=7)
    made = BilinearDeformation.create(gaussians, parameters, settings, color_columns=color_columns)
    random = torch.Generator().manual_seed(latent)
    return replace(made, **{n: torch.randn(t.shape, generator=random) for n, t in made.tensors().items()})


def converted(deformation: BilinearDeformation, dtype: torch.dtype) -> BilinearDeformation:
    tensors = {name: t.to(dtype).requires_grad_() for name, t in deformation.tensors().items()}
    return replace(deformation, **tensors, units=deformation.units.to(dtype))


def numbers(gaussians: Gaussians) -> list[torch.Tensor]:
    return list(gaussians.tensors().values())


WIDTHS = [
    (3, 3, 3),
    (3, 3, 12),
    (12, 3, 12),
    (12, 3, 3),
    (3, 12, 3),
]  # colour columns: of the Gaussians, F_sim and F_vis


@pytest.mark.parametrize("count", [0, 1, 7, 1500])
@pytest.mark.parametrize("widths", WIDTHS)
def test_bilinear_ones_are_one_after_the_other_bit_for_bit(count: int, widths: tuple[int, int, int]) -> None:
    gaussians = canonical(count, widths[0])
    first, second = bilinear(gaussians, 1, 5, widths[1]), bilinear(gaussians, 2, 6, widths[2])
    with torch.no_grad():
        together = compose(gaussians, (first, AT_FIRST), (second, AT_SECOND))
        in_turn = second.deformed(first.deformed(gaussians, AT_FIRST), AT_SECOND)
    assert together.colors.shape == (count, max(widths))
    for name in NAMES:
        assert torch.equal(getattr(together, name), getattr(in_turn, name))


def value_and_gradients(
    deform: Callable[..., Gaussians], dtype: torch.dtype, widths: tuple[int, int, int], trained: Iterable[str]
) -> list[torch.Tensor]:
    """Of a linear loss of the deformed Gaussians: these, and the derivatives by everything that is `trained`."""
    gaussians = canonical(700, widths[0])
    first, second = bilinear(gaussians, 1, 5, widths[1]), bilinear(gaussians, 2, 6, widths[2])
    first, second = converted(first, dtype), converted(second, dtype)
    gaussians = Gaussians(*(t.to(dtype).requires_grad_() for t in numbers(gaussians)))
    leaves = {
        "gaussians": numbers(gaussians),
        "first": [*first.tensors().values()],
        "second": [*second.tensors().values()],
    }
    for name in leaves.keys() - set(trained):
        for leaf in leaves[name]:
            leaf.requires_grad_(False)
    deformed = deform(gaussians, (first, AT_FIRST.to(dtype)), (second, AT_SECOND.to(dtype)))
    weights = numbers(canonical(700, max(widths)))
    loss = sum((value * weight.to(dtype).sin()).sum() for value, weight in zip(numbers(deformed), weights, strict=True))
    asked = [leaf for name in trained for leaf in leaves[name]]
    return [*numbers(deformed), *torch.autograd.grad(loss, asked)]


def by_definition(gaussians: Gaussians, *placed: tuple[BilinearDeformation, torch.Tensor]) -> Gaussians:
    for deformation, parameters in placed:
        gaussians = deformation.offsets(gaussians, parameters).applied_to(gaussians)
    return gaussians


def one_by_one(gaussians: Gaussians, *placed: tuple[BilinearDeformation, torch.Tensor]) -> Gaussians:
    for deformation, parameters in placed:
        gaussians = deformation.deformed(gaussians, parameters)
    return gaussians


TRAINED = [("gaussians", "first", "second"), ("first", "second"), ("second",), ("first",), ("gaussians",)]


@pytest.mark.parametrize("widths", WIDTHS)
@pytest.mark.parametrize("trained", TRAINED, ids="+".join)
def test_training_through_both_is_the_definition(widths: tuple[int, int, int], trained: tuple[str, ...]) -> None:
    fast = value_and_gradients(compose, torch.float32, widths, trained)
    slow = value_and_gradients(by_definition, torch.float64, widths, trained)
    for found, expected in zip(fast, slow, strict=True):
        assert found.shape == expected.shape
        largest = max(1.0, float(expected.detach().abs().max()))
        assert torch.allclose(found.double(), expected, rtol=0.0, atol=2e-6 * largest)


@pytest.mark.parametrize("widths", WIDTHS)
def test_training_takes_the_same_steps_as_one_after_the_other(widths: tuple[int, int, int]) -> None:
    found, expected = (value_and_gradients(f, torch.float32, widths, TRAINED[0]) for f in (compose, one_by_one))
    assert all(torch.equal(a, b) for a, b in zip(found, expected, strict=True))


@pytest.mark.parametrize("widths", WIDTHS)
def test_in_float64_it_is_the_definition_itself(widths: tuple[int, int, int]) -> None:
    found, expected = (value_and_gradients(f, torch.float64, widths, TRAINED[0]) for f in (compose, by_definition))
    assert all(torch.equal(a, b) for a, b in zip(found, expected, strict=True))


def test_gradients_may_lie_anyhow_in_memory() -> None:
    gaussians = canonical(9, 3)
    first, second = (converted(bilinear(gaussians, p, 5), torch.float32) for p in (1, 2))
    leaves = [*first.tensors().values(), *second.tensors().values()]
    found = []
    for ones in (torch.ones(()).expand(9, 3), torch.ones(9, 3), torch.ones(3, 9).T):
        deformed = compose(gaussians, (first, AT_FIRST), (second, AT_SECOND))
        found.append(torch.autograd.grad(deformed.means, leaves, ones))
    for others in found[1:]:
        assert all(torch.equal(a, b) for a, b in zip(found[0], others, strict=True))


def test_others_see_what_the_first_one_made() -> None:
    gaussians = canonical(20, 3)
    second = ValuesDeformation.create(gaussians, FUNCTION, np.linspace(0, 3, 8), [1.0, 0.1, 1.0, 0.1])
    first, place = bilinear(gaussians, 1, 5), torch.tensor([0.3, 0.5, -0.5, 0.2, 0.9])
    together = compose(gaussians, (first, AT_FIRST), (second, place))
    in_turn = second.deformed(first.deformed(gaussians, AT_FIRST), place)
    assert all(torch.equal(a, b) for a, b in zip(numbers(together), numbers(in_turn), strict=True))
    assert together.colors.shape[1] == 3
