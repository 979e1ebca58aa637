"""Transfer functions by the compiled module: against float64, for every instruction set, any number of threads, and refusals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from native import kernels

UNIT = 2.0**-24  # of rounding, float32
SUBNORMAL = float(np.finfo(np.float32).tiny)  # numbers below it have fewer digits
LOW, HIGH, LEAST = (0.1, 0.0, 0.3), (0.8, 0.9, 0.5), 1e-4
NUMBERS = ("weights", "changes", "logits", "colors")
VALUES = (1, 2, 3, 15, 31, 32, 33, 300)  # whole vectors of every instruction set, and others
LOGITS = (-40.0, -18.42068, -9.22, -9.2, -1.0, 0.0, 5.0, 19.9, 20.1, 40.0, 1e3)  # depths 1e-8 and 1e-4 among them


class Case(NamedTuple):
    """Arguments of the kernel, float32."""

    weights: NDArray  # [N, B]
    changes: NDArray  # [B, 4]
    logits: NDArray  # [N]
    colors: NDArray  # [N, 3 or more]

    def on(self, function, *more, instruction_set: str = "", threads: int = 1):
        return function(*self, LOW, HIGH, LEAST, *more, threads, instruction_set)

    def doubled(self) -> Case:
        return Case(*(array.astype(np.float64) for array in self))


def ordinary(count: int, values: int, color_columns: int = 3) -> Case:
    random = np.random.default_rng(count + values)
    weights = random.normal(0, 0.5, (count, values)) * (random.random((count, values)) < 0.8)
    arrays = (
        weights,
        random.normal(0, 0.3, (values, 4)),
        random.normal(0, 3, count),
        random.random((count, color_columns)),
    )
    return Case(*(array.astype(np.float32) for array in arrays))


def hostile(values: int) -> Case:
    """Every logit with weights of every size and with none, under changes that mostly make thinner."""
    random = np.random.default_rng(values)
    sizes = np.array([0.0, 1e-42, 1e-8, 1e-3, 1.0, 30.0, 1e4])
    logits, sizes = (grid.ravel() for grid in np.meshgrid(LOGITS, sizes))
    changes = random.normal(0, 0.5, (values, 4)) - np.array([0.3, 0, 0, 0])
    colors = random.choice([0.0, -0.0, 0.1, 0.8, -3.0, 7.0, 1e-30], (len(logits), 3))
    arrays = sizes[:, None] * random.normal(size=(len(logits), values)), changes, logits, colors
    return Case(*(array.astype(np.float32) for array in arrays))


def logit_of(depth: NDArray) -> NDArray:
    """ln(e^depth - 1)."""
    return depth + np.log(-np.expm1(-depth))


class Twin(NamedTuple):
    """The definition, in float64, and how far rounding to float32 on the way may lead away from it.

    The bounds are of first order.  The sums of B terms and the depths are wrong by a few UNITs of their terms.  That is
    multiplied by the derivative of the rest; of a logit by the depth this is 1 / (1 - e^-depth).  Each intermediate number
    is rounded.
    """

    logits: NDArray  # [N]
    colors: NDArray  # [N, 3]
    logits_bound: NDArray  # [N]
    colors_bound: NDArray  # [N, 3]


def twin(case: Case) -> Twin:
    weights, changes, logits, own = case.doubled()
    own = own[:, :3]
    before, sums = np.logaddexp(0.0, logits), np.abs(weights) @ changes
    after, kept = np.maximum(before + sums[:, 0], LEAST), np.maximum(before, LEAST)
    shift = (sums[:, 1:] - own * sums[:, :1]) / after[:, None]
    cut = np.clip(own + shift, np.minimum(own, np.float32(LOW)), np.maximum(own, np.float32(HIGH)))

    steps = UNIT * (8 + len(changes) / 4)  # roundings of a sum in the narrowest vectors, and of a depth
    terms = np.abs(weights) @ np.abs(changes)
    depth_bound = steps * (before + terms[:, 0])
    rounded = sum(np.abs(x) + np.abs(np.log(-np.expm1(-x))) + 4 for x in (after, kept)) + np.abs(logits)
    logits_bound = depth_bound / -np.expm1(-after) + 4 * UNIT * rounded
    colors_bound = steps * (terms[:, 1:] + np.abs(own) * terms[:, :1]) + np.abs(shift) * depth_bound[:, None]
    colors_bound = colors_bound / after[:, None] + 4 * UNIT * (np.abs(own) + np.abs(shift) + np.abs(cut)) + SUBNORMAL
    return Twin(logits + logit_of(after) - logit_of(kept), cut, logits_bound, colors_bound)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("values", VALUES)
@pytest.mark.parametrize("kind", ["ordinary", "hostile"])
def test_every_instruction_set_is_the_definition(instruction_set: str, values: int, kind: str) -> None:
    case = ordinary(1301, values) if kind == "ordinary" else hostile(values)
    logits, colors = case.on(kernels.transfer, instruction_set=instruction_set)
    wanted = twin(case)
    assert (np.abs(logits - wanted.logits) <= wanted.logits_bound).all()
    assert (np.abs(colors - wanted.colors) <= wanted.colors_bound).all()


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("values", [32, 33])
def test_ordinary_input_loses_no_more_than_a_few_units_in_the_last_place(instruction_set: str, values: int) -> None:
    case = ordinary(1301, values)
    logits, colors = case.on(kernels.transfer, instruction_set=instruction_set)
    wanted = twin(case)
    thick = wanted.logits > -2.0  # thinner ones are differences of depths, which have lost digits
    assert np.abs(logits - wanted.logits)[thick].max() < 3e-6
    assert np.abs(colors - wanted.colors)[thick].max() < 2e-6
    assert np.median(wanted.logits_bound[thick]) < 1e-5


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
def test_no_change_is_none_bit_for_bit(instruction_set: str) -> None:
    for case in (ordinary(77, 32, 12), hostile(32)):
        logits, colors = case._replace(changes=0 * case.changes).on(kernels.transfer, instruction_set=instruction_set)
        np.testing.assert_array_equal(logits, case.logits)
        np.testing.assert_array_equal(colors, case.colors)


@pytest.mark.parametrize("color_columns", [3, 4, 12])
def test_further_columns_stay(color_columns: int) -> None:
    case = ordinary(130, 32, color_columns)
    _, colors = case.on(kernels.transfer)
    np.testing.assert_array_equal(colors[:, 3:], case.colors[:, 3:])
    _, first = case._replace(colors=case.colors[:, :3]).on(kernels.transfer)
    np.testing.assert_array_equal(colors[:, :3], first)


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 5000])
def test_threads_change_no_bit(count: int) -> None:
    case, by_logits, by_colors = ordinary(count, 33), *upstream(count)
    alone = case.on(kernels.transfer)
    by_weights = case.on(kernels.transfer_gradient, by_logits, by_colors)
    for threads in (2, 3, 8):
        assert all(np.array_equal(a, b) for a, b in zip(alone, case.on(kernels.transfer, threads=threads), strict=True))
        again = case.on(kernels.transfer_gradient, by_logits, by_colors, threads=threads)
        np.testing.assert_array_equal(again, by_weights)


@pytest.mark.parametrize("attribute", ["weights", "logits", "colors"])
@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
def test_what_is_not_finite_stays_in_its_row(attribute: str, value: float) -> None:
    case = ordinary(37, 8)
    clean = case.on(kernels.transfer)
    getattr(case, attribute)[5] = value
    for made, expected in zip(case.on(kernels.transfer), clean, strict=True):
        np.testing.assert_array_equal(np.delete(made, 5, axis=0), np.delete(expected, 5, axis=0))


def upstream(count: int) -> tuple[NDArray, NDArray]:
    """Gradients by logits and colours."""
    random = np.random.default_rng(count)
    return random.normal(size=count).astype(np.float32), random.normal(size=(count, 3)).astype(np.float32)


def loss(case: Case, by_logits: NDArray, by_colors: NDArray) -> NDArray:
    """Of each Gaussian, (N,), float64."""
    found = twin(case)
    return by_logits * found.logits + (by_colors * found.colors).sum(axis=1)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("values", [1, 5, 32, 33])
def test_the_gradient_is_that_of_finite_differences(instruction_set: str, values: int) -> None:
    case, (by_logits, by_colors) = ordinary(400, values), upstream(400)
    case.weights[case.weights == 0] = 0.3  # twin and kernel differ there, see below
    found = case.on(kernels.transfer_gradient, by_logits, by_colors, instruction_set=instruction_set)
    exact, step = case.doubled(), 1e-6
    for b in range(values):
        moved = step * np.eye(values)[b]
        there, here, back = (
            loss(exact._replace(weights=exact.weights + s * moved), by_logits, by_colors) for s in (1, 0, -1)
        )
        smooth = np.abs(there - 2 * here + back) < 1e-9  # no kink of the cuts within the step
        assert smooth.mean() > 0.9
        wanted = (there - back) / (2 * step)
        np.testing.assert_allclose(found[smooth, b], wanted[smooth], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
def test_a_weight_of_zero_has_the_gradient_of_its_sign(instruction_set: str) -> None:
    case, gradients = ordinary(50, 9), upstream(50)
    found = []
    for tiny in (0.0, 1e-30, -0.0, -1e-30):
        case.weights[:, 4] = tiny
        found.append(case.on(kernels.transfer_gradient, *gradients, instruction_set=instruction_set))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[2], found[3])
    np.testing.assert_array_equal(found[0][:, 4], -found[2][:, 4])
    assert found[0][:, 4].any()


def test_wrong_shapes_are_named() -> None:
    case = ordinary(9, 5)
    wrong = {
        r"weights must have shape \[N, 1 or more\]": {"weights": case.weights[:, :0]},
        r"changes must have shape \[5, 4\], got \[4, 4\]": {"changes": case.changes[:4]},
        r"logits must have shape \[9\], got \[8\]": {"logits": case.logits[:8]},
        r"colors must have shape \[9, 3 or more\], got \[9, 2\]": {"colors": case.colors[:, :2]},
    }
    for message, arrays in wrong.items():
        with pytest.raises(ValueError, match=message):
            case._replace(**arrays).on(kernels.transfer)
    with pytest.raises(ValueError, match="least_depth must lie in 1e-30 to 1"):
        kernels.transfer(*case, LOW, HIGH, 0.0, 1)
    with pytest.raises(ValueError, match=r"by_colors must have shape \[9, 3\]"):
        case.on(kernels.transfer_gradient, case.logits, case.colors[:8])
