"""Gaussians that carry values: the kernel against its twin in float64, forward and backward, and the ends of ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from surrogate.appearance.averages import (
    HIGHEST,
    LEAST_SPREAD,
    LOWEST,
    MOST_SPREAD,
    NEGLIGIBLE,
    Nodes,
    averages_reference,
)
from surrogate.appearance.transferred import (
    LEAST_DEPTH,
    MOST_DEPTH,
    AverageTable,
    apply,
    apply_reference,
    logit_of_depth,
)
from tests.support.kernel_calls import recorded

softplus = torch.nn.functional.softplus
ENDS = torch.tensor([[LOWEST, math.log(LEAST_SPREAD)], [HIGHEST, math.log(MOST_SPREAD)]], dtype=torch.float64)


def table(places: list[float], extinctions: list[float], seed: int = 0) -> AverageTable:
    colors = np.random.default_rng(seed).random((len(places), 3))
    columns = np.array(extinctions)[:, None] * np.pad(colors, ((0, 0), (1, 0)), constant_values=1.0)
    return AverageTable.of(Nodes(np.array(places), columns))


TABLES = {
    "ordinary": table([0.0, 0.1, 0.35, 0.36, 0.7, 1.0], [0.1, 2.0, 0.0, 0.9, 0.2, 4.0]),
    "steps": table([0.1, 0.1, 0.25, 0.25, 0.25, 0.8], [1.0, 0.0, 0.5, 7.0, 3.0, 0.0]),
    "needle": table([0.0, 0.4999, 0.5, 0.5001, 1.0], [0.01, 0.01, 6.9, 0.0, 0.0]),
    "constant": table([0.5], [0.7]),
    "transparent": table([0.0, 1.0], [0.0, 0.0]),
}


def latents(count: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Logits (N,) and values (N, 2), some of them beyond what the table has."""
    random = np.random.default_rng(seed)
    values = np.stack([random.uniform(-0.6, 1.6, count), random.uniform(-5.8, -0.3, count)], axis=1)
    return torch.from_numpy(random.normal(0, 3, count)).float(), torch.from_numpy(values).float()


def gradients(
    of: AverageTable, logits: Tensor, values: Tensor, upstream: tuple[Tensor, Tensor]
) -> tuple[Tensor, Tensor]:
    leaves = logits.clone().requires_grad_(), values.clone().requires_grad_()
    found = apply(of, *leaves)
    loss = sum((f * g.to(f)).sum() for f, g in zip(found, upstream, strict=True))
    return torch.autograd.grad(loss, leaves)


def check(of: AverageTable, logits: Tensor, values: Tensor) -> None:
    """The kernel's answers and gradients are the twin's, within 1e-4 of an extinction that is not negligible, on finite input."""
    found, colors = apply(of, logits, values)
    wanted, wanted_colors = apply_reference(of, logits.double(), values.double())
    inside = values.double().clamp(*ENDS)  # [N, 2]
    extinctions = averages_reference(of.nodes, *inside.unbind(1))[:, 0]  # [N]
    largest = float(of.nodes.columns[:, 0].max())
    weighty = extinctions.clamp(min=max(NEGLIGIBLE * largest, 1e-12))  # [N]
    thickness = softplus(logits.double())  # [N]
    depths, wanted_depths = softplus(found.double()), softplus(wanted)
    assert ((depths - wanted_depths).abs() <= 1e-4 * (wanted_depths + weighty * thickness)).all()
    wrong = (colors.double() - wanted_colors).abs().amax(dim=1)  # [N]
    assert (wrong * extinctions.clamp(min=of.dark) <= 1e-4 * weighty).all()
    low, high = (torch.tensor(row) for row in of.range)
    assert ((colors >= low) & (colors <= high)).all()

    random = torch.Generator().manual_seed(len(logits))
    upstream = torch.randn(len(logits), generator=random), torch.randn((len(logits), 3), generator=random)
    by_logits, by_values = gradients(of, logits, values, upstream)
    wanted_logits, wanted_values = gradients(of, logits.double(), values.double(), upstream)
    # what errors of the averages and of their derivatives, both by u / s and ln s, become; where a range ends, its rule decides
    free = thickness * extinctions  # [N]
    clear = ((free / LEAST_DEPTH).log().abs() > 0.01) & ((free / MOST_DEPTH).log().abs() > 1e-3)  # [N]
    clear &= extinctions > 2e-3 * weighty
    by_depth = upstream[0].double().abs() / -torch.expm1(-free.clamp(LEAST_DEPTH, MOST_DEPTH))  # [N]
    by_color = upstream[1].double().abs().sum(dim=1) / extinctions.clamp(min=of.dark)  # [N]
    size = (by_depth * thickness + by_color) * (weighty + 0.1 * largest)  # [N]
    wrong_means, wrong_spreads = (by_values.double() - wanted_values).abs().unbind(1)  # [N] each
    assert (wrong_means * inside[:, 1].exp() <= 5e-4 * size + 1e-12)[clear].all()
    assert (wrong_spreads <= 5e-4 * size + 1e-12)[clear].all()
    wrong_logits = (by_logits.double() - wanted_logits).abs()  # [N]
    assert (wrong_logits <= 1e-4 * by_depth * (thickness * weighty + 1e-6))[clear].all()


@pytest.mark.parametrize("kind", TABLES)
def test_the_kernel_is_the_definition(kind: str) -> None:
    check(TABLES[kind], *latents(4000))


@settings(max_examples=60)
@given(st.data())
def test_whatever_the_function_and_the_latents_the_kernel_is_the_definition(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 12))
    gaps = data.draw(
        st.lists(st.sampled_from([0.0, 1e-13, 1e-6, 3e-5, 1e-3, 0.02, 0.3, 5.0]), min_size=count, max_size=count)
    )
    extinctions = data.draw(st.lists(st.sampled_from([0.0, 1e-3, 0.5, 7.0]), min_size=count, max_size=count))
    start = data.draw(st.floats(-1.5, 1.5))
    of = table(list(start + np.cumsum(gaps)), extinctions, seed=count)
    logits, values = latents(25, seed=data.draw(st.integers(0, 1000)))
    values[:5, 0] = torch.tensor(data.draw(st.sampled_from([of.nodes.places[:1], of.nodes.places[-1:], [-0.5], [1.5]])))
    check(of, logits, values)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 3e38, -3e38])
@pytest.mark.parametrize("column", [0, 1, 2])
def test_what_is_not_finite_is_as_in_the_twin(column: int, number: float) -> None:
    of, (logits, values) = TABLES["steps"], latents(9)
    values[4] = torch.tensor([0.3, -3.0])
    if column == 2:
        logits[4] = number
    else:
        values[4, column] = number
    for found, wanted in zip(apply(of, logits, values), apply_reference(of, logits, values), strict=True):
        assert torch.equal(found.isnan(), wanted.isnan())
        assert torch.equal(found.isinf(), wanted.isinf())
        assert bool(found[4].isnan().any()) == (math.isnan(number) and (column < 2 or found.ndim == 1))


def test_the_twin_is_differentiable() -> None:
    """By finite differences, where nothing is cut."""
    random = torch.Generator().manual_seed(0)
    logits, means, log_spreads = (torch.rand(30, generator=random, dtype=torch.float64) for _ in range(3))
    given = logits.requires_grad_(), torch.stack([means, -1.0 - 3.0 * log_spreads], 1).requires_grad_()
    assert torch.autograd.gradcheck(lambda a, b: apply_reference(TABLES["ordinary"], a, b), given, atol=1e-4)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_beyond_a_range_only_the_way_back_has_a_gradient(dtype: torch.dtype) -> None:
    """A ramp that rises with u: more depth is to be had by a larger u, and less by a smaller one."""
    ramp = table([-2.0, 3.0], [0.5, 2.0])
    for value, sign, passes in ((-0.7, 1.0, False), (-0.7, -1.0, True), (1.7, 1.0, True), (1.7, -1.0, False)):
        values = torch.tensor([[value, -2.0]], dtype=dtype)
        upstream = torch.tensor([sign], dtype=dtype), torch.zeros(1, 3, dtype=dtype)
        by_logits, by_values = gradients(ramp, torch.zeros(1, dtype=dtype), values, upstream)
        assert (by_values[0, 0] != 0.0) == passes
        assert by_logits[0] != 0.0
    for logit, sign, passes in ((-20.0, 1.0, False), (-20.0, -1.0, True), (50.0, 1.0, True), (50.0, -1.0, False)):
        logits, values = torch.tensor([logit], dtype=dtype), torch.tensor([[0.5, -2.0]], dtype=dtype)
        upstream = torch.tensor([sign], dtype=dtype), torch.zeros(1, 3, dtype=dtype)
        by_logits, by_values = gradients(ramp, logits, values, upstream)
        assert (by_logits[0] != 0.0) == passes
        assert (by_values[0, 0] != 0.0) == passes
    for log_spread, sign, passes in ((-7.0, 1.0, False), (-7.0, -1.0, True), (0.5, 1.0, True), (0.5, -1.0, False)):
        bend = table([0.5, 3.0], [0.5, 2.0])  # wider spreads have more of it
        upstream = torch.tensor([sign], dtype=dtype), torch.zeros(1, 3, dtype=dtype)
        values = torch.tensor([[0.5, log_spread]], dtype=dtype)
        _, by_values = gradients(bend, torch.zeros(1, dtype=dtype), values, upstream)
        assert (by_values[0, 1] != 0.0) == passes


def test_depths_and_colors_are_emission_and_absorption() -> None:
    """Far from where the function changes: the depth is thickness times extinction, the colour that of the function."""
    of = AverageTable.of(Nodes(np.array([0.0, 0.0]), np.array([[0.5, 0.5, 0.0, 0.25], [2.0, 0.0, 1.0, 0.0]])))
    thickness = torch.tensor([1e-9, 0.3, 0.3, 2.0, 1e6])
    values = torch.tensor([[-0.4, -5.0], [-0.4, -5.0], [0.4, -5.0], [0.4, -5.0], [0.4, -5.0]])
    logits, colors = apply(of, logit_of_depth(thickness), values)
    torch.testing.assert_close(softplus(logits), torch.tensor([LEAST_DEPTH, 0.15, 0.6, 4.0, MOST_DEPTH]))
    torch.testing.assert_close(colors[:2], torch.tensor([[1.0, 0.0, 0.5]]).expand(2, 3))
    torch.testing.assert_close(colors[2:], torch.tensor([[0.0, 0.5, 0.0]]).expand(3, 3))


def test_only_where_it_can_the_kernel_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = recorded(monkeypatch, "apply_averages", "apply_averages_gradient")
    of, (logits, values) = TABLES["ordinary"], latents(5)
    upstream = torch.ones(5), torch.ones(5, 3)
    apply(of, logits, values)
    assert calls == ["apply_averages"]
    gradients(of, logits, values, upstream)
    assert calls == ["apply_averages", "apply_averages", "apply_averages_gradient"]
    gradients(of, logits.double(), values.double(), upstream)
    assert len(calls) == 3
    anyhow = torch.stack([values, values], 2)[:, :, 0]
    assert torch.equal(apply(of, logits, anyhow)[0], apply(of, logits, values)[0])


def test_there_is_no_second_derivative_of_the_kernel() -> None:
    of, (logits, values) = TABLES["ordinary"], latents(5)
    leaf = values.requires_grad_()
    with pytest.raises(RuntimeError, match=r"differentiated once only.*apply `apply_reference`"):
        torch.autograd.grad(apply(of, logits, leaf)[0].sum(), leaf, create_graph=True)


def test_a_table_is_one_line() -> None:
    assert repr(TABLES["constant"]) == "AverageTable(nodes=Nodes(places[1], columns[1, 4]))"
    assert TABLES["transparent"].range == ([0.0] * 3, [0.0] * 3)
    assert TABLES["constant"].cells is TABLES["constant"].cells
