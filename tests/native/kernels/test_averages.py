"""Averages by the compiled module: against float64, for every instruction set, any number of threads, and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from native import kernels
from surrogate.appearance.averages import NEGLIGIBLE, Nodes, averages_reference
from surrogate.appearance.transferred import RANGES, AverageTable, apply_reference

LIMITS = (1e-6, 1e-4, 12.0)  # darkest extinction, least and most depth
LOW, HIGH = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


def function(places: list[float], extinctions: list[float]) -> Nodes:
    """In colours from black to white, so that LOW and HIGH are its range."""
    colors = np.random.default_rng(len(places)).random((len(places), 3))
    colors[0], colors[-1] = 0.0, 1.0
    return Nodes(np.array(places), np.array(extinctions)[:, None] * np.pad(colors, ((0, 0), (1, 0)), constant_values=1))


FUNCTIONS = {
    "ordinary": function([0.0, 0.1, 0.35, 0.36, 0.7, 1.0], [0.1, 2.0, 0.0, 0.9, 0.2, 4.0]),
    "steps": function([0.1, 0.1, 0.25, 0.25, 0.25, 0.8], [1.0, 0.2, 0.5, 7.0, 3.0, 0.3]),
    "needle": function([0.0, 0.4999, 0.5, 0.5001, 1.0], [0.01, 0.01, 6.9, 0.001, 0.001]),
    "shorter than anything": function(
        [0.0, 0.4, 0.4 + 1e-12, 0.4 + 1e-7, 0.4 + 3e-5, 1.0], [0.1, 0.1, 3.0, 1.0, 0.7, 0.1]
    ),
    "far places": function([-1e30, -1e6, -2.0, 0.3, 4.0, 1e6, 1e300], [3.0, 2.0, 1.0, 0.2, 2.0, 5.0, 1.0]),
    "beyond the table": function([3.0, 3.0, 8.0], [1.0, 3.0, 5.0]),
    "many nodes": function([k / 297 for k in range(298)], [1.0 + k % 5 for k in range(298)]),
}


def levels() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The spreads of a table's levels, and where the cells of each begin."""
    lowest, highest, least, most = RANGES
    count = 1 + math.ceil(math.log(most / least) / 0.15)
    spreads = np.geomspace(least, most, count)
    return spreads, np.concatenate([[0], np.cumsum(np.ceil((highest - lowest) / (0.7 * spreads))).astype(np.int64)])


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("kind", FUNCTIONS)
def test_cells_begin_with_the_averages(instruction_set: str, kind: str) -> None:
    nodes, (spreads, first) = FUNCTIONS[kind], levels()
    table = kernels.averages(nodes.places, nodes.columns, RANGES, instruction_set)
    assert table.shape == (first[-1], 8, 4)
    largest = nodes.columns.max()
    for level, spread in list(enumerate(spreads))[::3]:
        cells = table[first[level] : first[level + 1]].astype(np.float64)
        begins = RANGES[0] + 0.7 * spread * np.arange(len(cells) + 1)
        ends = torch.from_numpy(begins).requires_grad_()
        wanted = averages_reference(nodes, ends, torch.full_like(ends, math.log(spread)))  # [C + 1, 4]
        (slopes,) = torch.autograd.grad(wanted[:, 0].sum(), ends)
        wanted = wanted.detach().numpy()
        assert np.abs(cells[:, 0] - wanted[:-1]).max() <= 5e-7 * largest
        assert np.abs(cells.sum(axis=1) - wanted[1:]).max() <= 3e-6 * largest
        assert np.abs(cells[:, 1, 0] - 0.7 * spread * slopes.numpy()[:-1]).max() <= 1e-6 * largest


def latents(count: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    random = np.random.default_rng(count)
    values = np.stack([random.uniform(-0.7, 1.7, count), random.uniform(-6.0, 0.0, count)], axis=1)
    return random.normal(0, 3, count).astype(np.float32), values.astype(np.float32)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("kind", FUNCTIONS)
def test_every_instruction_set_is_the_definition(instruction_set: str, kind: str) -> None:
    nodes, (logits, values) = FUNCTIONS[kind], latents(701)
    table = kernels.averages(nodes.places, nodes.columns, RANGES, instruction_set)
    limits = (AverageTable.of(nodes).dark, *LIMITS[1:])
    found, colors = kernels.apply_averages(table, RANGES, logits, values, LOW, HIGH, limits, 1, instruction_set)
    wanted, wanted_colors = apply_reference(
        AverageTable.of(nodes), torch.from_numpy(logits).double(), torch.from_numpy(values).double()
    )
    depths, wanted = np.logaddexp(0.0, found.astype(np.float64)), np.logaddexp(0.0, wanted.numpy())
    thickness = np.logaddexp(0.0, logits.astype(np.float64))
    negligible = NEGLIGIBLE * nodes.columns[:, 0].max()
    assert (np.abs(depths - wanted) <= 1e-4 * np.maximum(wanted, negligible * thickness)).all()
    clipped = np.clip(values.astype(np.float64), [RANGES[0], math.log(RANGES[2])], [RANGES[1], math.log(RANGES[3])])
    extinctions = averages_reference(nodes, *torch.from_numpy(clipped).unbind(1)).numpy()[:, :1]
    wrong = np.abs(colors - wanted_colors.numpy()) * np.minimum(1.0, extinctions / negligible)
    assert wrong.max() <= 1e-4


@pytest.mark.parametrize("count", [0, 1, 63, 65, 5000])
def test_threads_change_no_bit(count: int) -> None:
    nodes, (logits, values), random = FUNCTIONS["ordinary"], latents(count), np.random.default_rng(count)
    table = kernels.averages(nodes.places, nodes.columns, RANGES)
    upstream = random.normal(size=count).astype(np.float32), random.normal(size=(count, 3)).astype(np.float32)
    given = table, RANGES, logits, values, LOW, HIGH, LIMITS
    alone = *kernels.apply_averages(*given, 1), *kernels.apply_averages_gradient(*given, *upstream, 1)
    assert [array.shape for array in alone] == [(count,), (count, 3), (count,), (count, 2)]
    for threads in (2, 3, 8):
        shared = *kernels.apply_averages(*given, threads), *kernels.apply_averages_gradient(*given, *upstream, threads)
        assert all(np.array_equal(a, b) for a, b in zip(alone, shared, strict=True))


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
def test_what_is_not_finite_stays_in_its_row_and_nan_stays(instruction_set: str) -> None:
    nodes, (logits, values) = FUNCTIONS["steps"], latents(40)
    table = kernels.averages(nodes.places, nodes.columns, RANGES, instruction_set)
    upstream = np.ones(40, np.float32), np.ones((40, 3), np.float32)

    def found() -> list[NDArray[np.float32]]:
        given = table, RANGES, logits, values, LOW, HIGH, LIMITS
        forward = kernels.apply_averages(*given, 1, instruction_set)
        return [*forward, *kernels.apply_averages_gradient(*given, *upstream, 1, instruction_set)]

    clean = found()
    for row, (place, number) in enumerate((k, x) for k in range(3) for x in (np.nan, np.inf, -np.inf, 3e38, -3e38)):
        if place == 2:
            logits[row] = number
        else:
            values[row, place] = number
    made = found()
    for array, before in zip(made, clean, strict=True):
        np.testing.assert_array_equal(array[15:], before[15:])
    assert np.isnan(made[0][[0, 5, 10]]).all()
    assert np.isnan(made[1][[0, 5]]).all()
    assert np.isfinite(made[0][[1, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 14]]).all()
    assert np.isfinite(np.delete(made[1], [0, 5], axis=0)).all()


def test_wrong_input_is_named() -> None:
    nodes, (logits, values) = FUNCTIONS["ordinary"], latents(9)
    table = kernels.averages(nodes.places, nodes.columns, RANGES)
    for places, columns, ranges, message in (
        (nodes.places[:0], nodes.columns[:0], RANGES, r"places must have shape \[1 or more\]"),
        (nodes.places, nodes.columns[:3], RANGES, r"columns must have shape \[6, 4\]"),
        (nodes.places[::-1].copy(), nodes.columns, RANGES, "places must be finite and never decrease"),
        (np.full(6, np.nan), nodes.columns, RANGES, "places must be finite and never decrease"),
        (nodes.places, np.full((6, 4), np.inf), RANGES, "columns must be finite"),
        (nodes.places, nodes.columns, (0.0, 1.0, 0.0, 1.0), "ranges must be two increasing values"),
        (nodes.places, nodes.columns, (0.0, 1.0, 1e-7, 1e-2), "within a factor of 1e5"),
    ):
        with pytest.raises(ValueError, match=message):
            kernels.averages(places, columns, ranges)
    for given, message in (
        ((table[:-1], RANGES, logits, values, LOW, HIGH, LIMITS), r"table must have shape \[\d+, 8, 4\], got"),
        ((table, (0.0, 1.0, 0.1, 0.2), logits, values, LOW, HIGH, LIMITS), r"table must have shape"),
        ((table, RANGES, logits[:, None], values, LOW, HIGH, LIMITS), r"logits must have shape \[N\]"),
        ((table, RANGES, logits, values[:8], LOW, HIGH, LIMITS), r"values must have shape \[9, 2\], got \[8, 2\]"),
        ((table, RANGES, logits, values, LOW, HIGH, (0.0, 1e-4, 12.0)), "dark must be positive"),
        ((table, RANGES, logits, values, LOW, HIGH, (1.0, 1e-4, 1e-5)), "depths increase"),
    ):
        with pytest.raises(ValueError, match=message):
            kernels.apply_averages(*given, 1)
    with pytest.raises(ValueError, match=r"by_colors must have shape \[9, 3\]"):
        kernels.apply_averages_gradient(table, RANGES, logits, values, LOW, HIGH, LIMITS, logits, values, 1)
