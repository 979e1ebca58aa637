import importlib
import math
from collections.abc import Callable

import pytest
import torch

from surrogate.splatting.threads import one_torch_thread
from surrogate.training import optimizer
from surrogate.training.optimizer import Adam, surprise, without_subnormals


def steps(adam: Adam, tensors: dict[str, torch.Tensor], first: int, last: int) -> None:
    for i in range(first, last):
        loss = sum(((t - k) ** 2 * (1.0 + 0.1 * i)).sum() for k, t in enumerate(tensors.values()))
        loss.backward()
        adam.step(0.9**i)


def leaves() -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return {name: torch.randn(5, 3, generator=generator).requires_grad_() for name in ("a", "b")}


@pytest.mark.parametrize("way", ["fused_update", "plain_update"])
@pytest.mark.parametrize("shared", [(), ("a",), ("a", "b")])
def test_it_is_adam_with_a_rate_per_tensor(way: str, shared: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(optimizer, "update", getattr(optimizer, way))
    monkeypatch.setattr(optimizer, "surprise", lambda *_: 1.0)
    tensors, rates = leaves(), {"a": 0.1, "b": 0.01}
    twin = {n: t.detach().double().clone() for n, t in tensors.items()}
    first = {n: torch.zeros_like(t) for n, t in twin.items()}
    second = {n: torch.zeros_like(t) for n, t in twin.items()}
    steps(Adam(tensors, rates, shared=shared), tensors, 0, 20)
    for i in range(20):
        for k, name in enumerate(twin):
            gradient = 2.0 * (twin[name] - k) * (1.0 + 0.1 * i)
            first[name] = 0.9 * first[name] + 0.1 * gradient
            second[name] = 0.999 * second[name] + 0.001 * gradient**2
            mean, variance = first[name] / (1 - 0.9 ** (i + 1)), second[name] / (1 - 0.999 ** (i + 1))
            twin[name] = twin[name] - rates[name] * 0.9**i * mean / (variance.sqrt() + 1e-15)
    for name in twin:
        torch.testing.assert_close(tensors[name].detach().double(), twin[name], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("update", [optimizer.fused_update, optimizer.plain_update])
def test_one_update_is_that_of_torch(update: Callable[..., None]) -> None:
    (ours,), (theirs,) = ([torch.full((4, 3), 0.5).requires_grad_()] for _ in range(2))
    first, second, torchs = torch.zeros(4, 3), torch.zeros(4, 3), torch.optim.Adam([theirs], lr=0.03, eps=1e-15)
    for step in range(1, 30):
        gradient = torch.randn(4, 3, generator=torch.Generator().manual_seed(step)) * 10.0 ** (step % 7 - 3)
        theirs.grad = gradient.clone()
        torchs.step()
        with torch.no_grad():
            update(ours, gradient, first, second, torch.tensor(float(step)), 0.03)
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


def test_without_torchs_private_kernel_the_public_operations_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    assert optimizer.update is optimizer.fused_update
    with monkeypatch.context() as without:
        without.delattr(torch, "_fused_adam_")
        assert importlib.reload(optimizer).update is optimizer.plain_update
    assert importlib.reload(optimizer).update is optimizer.fused_update


def test_a_restored_optimizer_goes_on_bit_for_bit() -> None:
    rates = {"a": 0.1, "b": 0.01}
    whole = leaves()
    steps(Adam(whole, rates, shared=("b",)), whole, 0, 30)
    halves = leaves()
    interrupted = Adam(halves, rates, shared=("b",))
    steps(interrupted, halves, 0, 13)
    saved = {
        name: {which: tensor.clone() for which, tensor in moments.tensors().items()}
        for name, moments in interrupted.moments().items()
    }
    resumed = {name: tensor.detach().clone().requires_grad_() for name, tensor in halves.items()}
    adam = Adam(resumed, rates, 13, shared=("b",))
    assert {name: list(kept) for name, kept in saved.items()} == {
        "a": ["first", "second", "steps"],
        "b": ["first", "second"],
    }
    for name, moments in adam.moments().items():
        for which, tensor in moments.tensors().items():
            tensor.copy_(saved[name][which])
    steps(adam, resumed, 13, 30)
    assert all(torch.equal(resumed[name], whole[name]) for name in whole)


@one_torch_thread()  # as in training: the processor's mode is one thread's
def test_moments_of_what_no_picture_shows_end_at_zero_and_not_below_normal_numbers() -> None:
    """Rounding keeps them at a few of the smallest number for ever: a step of 20,000 latents took 3.5 ms and not 0.35."""
    seen, unseen = torch.ones(4, 3), torch.zeros(4, 3)
    tensor = torch.zeros(8, 3, requires_grad=True)
    adam = Adam({"latents": tensor}, {"latents": 0.1}, shared=("latents",))
    for step in range(1200):
        tensor.grad = torch.cat([seen, unseen if step else seen])
        adam.step(1.0)
    first, second, _ = adam.moments()["latents"]
    assert not first[4:].any()
    assert bool((first[:4] > 0.9).all())
    assert bool((second > 0).all())
    assert bool(tensor.isfinite().all())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])  # the kernel, and its twin
def test_a_row_without_a_gradient_stays_and_so_does_what_is_remembered_of_it(dtype: torch.dtype) -> None:
    tensor = torch.zeros(6, 3, dtype=dtype, requires_grad=True)
    adam = Adam({"latents": tensor}, {"latents": 0.1})
    for step in range(10):
        tensor.grad = torch.zeros(6, 3, dtype=dtype)
        tensor.grad[: 3 if step else 6, 1] = 1.0
        adam.step(1.0)
    first, second, counts = adam.moments()["latents"]
    assert counts is not None
    assert counts.tolist() == [10.0] * 3 + [1.0] * 3
    assert tensor.detach()[:, 1].tolist() == pytest.approx([-1.0] * 3 + [-0.1] * 3, rel=1e-4)
    assert first[3:, 1].tolist() == pytest.approx([0.1] * 3)
    assert second[3:, 1].tolist() == pytest.approx([0.001] * 3)
    assert not any(kept[:, ::2].any() for kept in (tensor.detach(), first, second))


@pytest.mark.parametrize(("shared", "farthest"), [((), 1.01), (("latents",), 30.0)])
def test_a_gradient_after_a_long_time_moves_a_row_by_no_more_than_its_rate(
    shared: tuple[str, ...], farthest: float
) -> None:
    """As a whole tensor it is thrown 30 times as far: its second moment has decayed, the first goes on moving it."""
    tensor, rate = torch.zeros(50, 2, requires_grad=True), 0.01
    adam = Adam({"latents": tensor}, {"latents": rate}, shared=shared)
    moved = torch.zeros(2)
    for step in range(9_000):
        tensor.grad = torch.ones(50, 2)
        tensor.grad[0] = float(step in (0, 8_900))
        before = tensor.detach()[0].clone()
        adam.step(1.0)
        moved += (tensor.detach()[0] - before) * (step >= 8_900)
    assert float(moved.abs().max()) / rate == pytest.approx(farthest, rel=0.05)


def test_numbers_are_as_before_after_a_step() -> None:
    tiny = torch.tensor(1e-40)
    tensor = torch.ones(3, requires_grad=True)
    tensor.grad = torch.ones(3)
    Adam({"t": tensor}, {"t": 0.1}).step(1.0)
    assert float(tiny * 2.0) > 0.0
    with without_subnormals():
        assert float(tiny * 2.0) == 0.0
        with without_subnormals():
            pass
        assert float(tiny * 2.0) == 0.0
    assert float(tiny * 2.0) > 0.0


def test_a_gradient_far_larger_than_those_lately_moves_what_is_calmed_no_farther_than_usual() -> None:
    tensors = {name: torch.zeros(6, 2, requires_grad=True) for name in ("free", "calmed")}
    adam, far = Adam(tensors, dict.fromkeys(tensors, 0.01), shared=("calmed",)), dict.fromkeys(tensors, 0.0)
    for step in range(401):
        before = {name: tensor.detach().clone() for name, tensor in tensors.items()}
        for tensor in tensors.values():
            tensor.grad = torch.full((6, 2), 100.0 if step == 400 else 1.0)
        adam.step(1.0)
        moved = {name: float((tensor.detach() - before[name]).abs().max()) for name, tensor in tensors.items()}
        if step < 400:  # equal gradients: Adam's step is the rate
            assert moved == pytest.approx(dict.fromkeys(tensors, 0.01), rel=1e-3)
        far = moved
    assert far["free"] > 0.015
    assert far["calmed"] < 0.005


@pytest.mark.parametrize("steps", [1, 2, 1000])
def test_the_first_gradient_and_equal_ones_surprise_nobody(steps: int) -> None:
    gradient = torch.linspace(-3.0, 2.0, 7)
    second = gradient.square() * (1.0 - 0.999 ** (steps - 1))
    assert surprise(gradient, second, steps) == pytest.approx(1.0, abs=1e-5)
    assert surprise(torch.zeros(7), torch.zeros(7), steps) == 1.0
    assert surprise(3.0 * gradient, second, steps) == pytest.approx(
        3.0 * math.sqrt((1.0 - 0.999**steps) / (8.0 * 0.001 + 1.0 - 0.999**steps)), rel=1e-5
    )
