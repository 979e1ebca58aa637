"""The kernel of row-wise Adam against its readable twin, on every instruction set."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from native import kernels
from surrogate.training.optimizer import step_rows, step_rows_reference

SHAPES = [
    (1,),
    (7,),
    (1000,),
    (300, 3),
    (37, 4),
    (40, 2),
    (33, 32),
    (50, 33),
    (21, 15),
    (21, 16),
    (10, 4, 3),
    (5, 1),
    (0, 3),
    (4, 0),
]


def state(shape: tuple[int, ...], seed: int = 0) -> list[Tensor]:
    """A tensor, its moments, and the steps of its rows."""
    start = torch.randn(shape, generator=torch.Generator().manual_seed(seed))
    return [start, torch.zeros(shape), torch.zeros(shape), torch.zeros(shape[:1])]


def gradients(shape: tuple[int, ...], seen: float, scale: float, seed: int) -> Tensor:
    """Of which a part of the rows is `seen`."""
    random = torch.Generator().manual_seed(seed)
    rows = torch.rand(shape[:1], generator=random) < seen
    return scale * torch.randn(shape, generator=random) * rows.view(-1, *[1] * (len(shape) - 1))


def stepped(tensors: list[Tensor], gradient: Tensor, instruction_set: str) -> None:
    tensor, *rest = (t.numpy() for t in tensors)
    kernels.step_rows(tensor, gradient.numpy(), *rest, 0.01, instruction_set)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("seen", [0.05, 0.5, 1.0])
def test_it_is_its_twin(instruction_set: str, shape: tuple[int, ...], seen: float) -> None:
    ours, twin = state(shape), [tensor.double() for tensor in state(shape)]
    for step in range(60):
        gradient = gradients(shape, seen, 10.0 ** (step % 9 - 4), step)
        stepped(ours, gradient, instruction_set)
        step_rows_reference(twin[0], gradient.double(), *twin[1:], 0.01)
    for got, wanted in zip(ours, twin, strict=True):
        largest = float(wanted.abs().max()) if wanted.numel() else 0.0
        torch.testing.assert_close(got.double(), wanted, rtol=1e-5, atol=2e-6 * max(largest, 1e-3))
    assert torch.equal(ours[3].double(), twin[3])


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("width", [1, 3, 15, 32])
@pytest.mark.parametrize("scale", [1e-30, 1e-18, 1.0, 1e15])
def test_after_very_many_steps_and_with_gradients_of_any_size(instruction_set: str, width: int, scale: float) -> None:
    shape = (70, width)
    ours = state(shape)
    ours[3].fill_(2.0**24 - 40.0)
    twin = [tensor.double() for tensor in ours]
    for step in range(20):
        gradient = gradients(shape, 0.5, scale, step)
        stepped(ours, gradient, instruction_set)
        step_rows_reference(twin[0], gradient.double(), *twin[1:], 0.01)
    moved = ours[0].double() - state(shape)[0].double()
    if scale > 1e-20:  # whose square is a normal number
        torch.testing.assert_close(ours[0].double(), twin[0], rtol=1e-5, atol=2e-5)
    assert bool(moved.isfinite().all())


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_rows_without_a_gradient_stay_bit_for_bit(instruction_set: str, shape: tuple[int, ...]) -> None:
    tensors = [torch.full(shape, 0.1), torch.full(shape, -0.3), torch.full(shape, 1e-12), torch.full(shape[:1], 7.0)]
    before = [tensor.clone() for tensor in tensors]
    gradient = gradients(shape, 0.3, 1.0, 1)
    gradient[gradient == 0.0] = -0.0
    still = (gradient == 0.0).reshape(shape[0], math.prod(shape[1:])).all(dim=1)
    stepped(tensors, gradient, instruction_set)
    assert all(torch.equal(now[still], then[still]) for now, then in zip(tensors, before, strict=True))
    assert tensors[3][~still].tolist() == [8.0] * int((~still).sum())


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("width", [1, 3, 32])
def test_what_is_not_a_number_is_not_hidden(instruction_set: str, width: int) -> None:
    tensors, gradient = state((20, width)), torch.zeros(20, width)
    gradient[11, -1] = math.nan
    stepped(tensors, gradient, instruction_set)
    assert tensors[0].isnan().nonzero().tolist() == [[11, width - 1]]


def test_tensors_that_the_kernel_does_not_take_are_moved_by_the_twin() -> None:
    whole = torch.zeros(5, 4)
    step_rows(whole[:, ::2], torch.ones(5, 2), torch.zeros(5, 2), torch.zeros(5, 2), torch.zeros(5), 0.1)
    torch.testing.assert_close(whole[:, ::2], torch.full((5, 2), -0.1))
    assert not whole[:, 1::2].any()


@pytest.mark.parametrize(
    ("place", "shape", "message"),
    [
        (1, (4, 3), r"gradient must have shape \[5, 3\], got \[4, 3\]"),
        (2, (5, 2), r"first must have shape \[5, 3\], got \[5, 2\]"),
        (3, (15,), r"second must have shape \[5, 3\], got \[15\]"),
        (4, (4,), r"steps must have shape \[5\], got \[4\]"),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(place: int, shape: tuple[int, ...], message: str) -> None:
    arrays = [np.zeros(s, np.float32) for s in ((5, 3), (5, 3), (5, 3), (5, 3), (5,))]
    arrays[place] = np.zeros(shape, np.float32)
    with pytest.raises(ValueError, match=message):
        kernels.step_rows(*arrays, 0.1)


def test_a_copy_is_never_moved_in_place_of_the_array() -> None:
    arrays = [np.zeros((5, 3), dtype) for dtype in (np.float64, np.float32, np.float32, np.float32)]
    with pytest.raises(TypeError):
        kernels.step_rows(*arrays, np.zeros(5, np.float32), 0.1)
