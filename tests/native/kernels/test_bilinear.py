"""Bilinear offsets by the compiled module: against float64, for every instruction set, any number of threads, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from native import kernels

WIDTHS = (3, 3, 4, 1)


def tables(count: int, latent: int, color_columns: int) -> tuple[NDArray, NDArray, list[NDArray]]:
    random = np.random.default_rng(count + latent)
    widths = (*WIDTHS, color_columns)
    rows = [random.normal(size=(count,) if width == 1 else (count, width)).astype(np.float32) for width in widths]
    latents = random.normal(size=(count, latent)).astype(np.float32)
    return latents, random.normal(size=(latent, sum(widths))).astype(np.float32), rows


def side_by_side(rows: list[NDArray]) -> NDArray[np.float64]:
    return np.concatenate([row.reshape(len(row), -1).astype(np.float64) for row in rows], axis=1)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize(("count", "latent", "color_columns"), [(1, 1, 3), (5, 16, 3), (1300, 16, 12), (514, 23, 48)])
def test_every_instruction_set_multiplies(instruction_set: str, count: int, latent: int, color_columns: int) -> None:
    latents, modes, rows = tables(count, latent, color_columns)
    made = kernels.add_bilinear([(latents, modes)], rows, 1, instruction_set)
    wanted = side_by_side(rows) + latents.astype(np.float64) @ modes
    assert [array.shape for array in made] == [row.shape for row in rows]
    np.testing.assert_allclose(side_by_side(made), wanted, atol=3e-6 * np.abs(wanted).max())
    by_latents, by_modes = kernels.bilinear_gradients(latents, modes, rows, 1, instruction_set)
    wanted = side_by_side(rows) @ modes.T.astype(np.float64)
    np.testing.assert_allclose(by_latents, wanted, atol=3e-6 * np.abs(wanted).max())
    wanted = latents.T.astype(np.float64) @ side_by_side(rows)
    np.testing.assert_allclose(by_modes, wanted, atol=3e-6 * np.abs(wanted).max())


def test_threads_change_no_bit() -> None:
    latents, modes, rows = tables(5000, 16, 3)
    other = tables(5000, 4, 12)
    calls = (
        lambda threads: kernels.add_bilinear([(latents, modes)], rows, threads),
        lambda threads: kernels.add_bilinear([(latents, modes), other[:2]], rows, threads),
        lambda threads: kernels.bilinear_gradients(latents, modes, rows, threads),
    )
    for call in calls:
        alone = call(1)
        for threads in (2, 3, 8):
            assert all(np.array_equal(a, b) for a, b in zip(alone, call(threads), strict=True))


def widened(rows: list[NDArray], color_columns: int) -> list[NDArray]:
    """With zeros in more columns of the last one."""
    return [*rows[:-1], np.pad(rows[-1], ((0, 0), (0, color_columns - rows[-1].shape[1])))]


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("count", [1, 7, 1300])
@pytest.mark.parametrize(("first", "second", "given"), [(3, 3, 3), (3, 12, 3), (3, 12, 12), (12, 3, 5), (48, 5, 4)])
def test_two_products_are_one_after_the_other_bit_for_bit(
    instruction_set: str, count: int, first: int, second: int, given: int
) -> None:
    (*one, _), (*other, _), (_, _, rows) = tables(count, 10, first), tables(count, 16, second), tables(count, 1, given)
    together = kernels.add_bilinear([one, other], rows, 1, instruction_set)
    between = kernels.add_bilinear([one], rows, 1, instruction_set)
    in_turn = kernels.add_bilinear([other], between, 1, instruction_set)
    wide = max(first, second, given)
    assert [array.shape for array in together] == [row.shape for row in widened(rows, wide)]
    assert all(np.array_equal(a, b) for a, b in zip(together, in_turn, strict=True))
    wanted = side_by_side(widened(rows, wide))
    for latents, modes in (one, other):
        wanted[:, : modes.shape[1]] += latents.astype(np.float64) @ modes
    np.testing.assert_allclose(side_by_side(together), wanted, atol=3e-6 * np.abs(wanted).max())


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
def test_gradients_of_narrower_modes_read_only_their_columns(instruction_set: str) -> None:
    latents, modes, gradients = tables(1300, 10, 12)
    narrow = np.ascontiguousarray(modes[:, :14])
    found = kernels.bilinear_gradients(latents, narrow, gradients, 1, instruction_set)
    first = [*gradients[:-1], np.ascontiguousarray(gradients[-1][:, :3])]
    for got, expected in zip(
        found, kernels.bilinear_gradients(latents, narrow, first, 1, instruction_set), strict=True
    ):
        np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize("hostile", [0.0, 1e-42, 1e30, np.inf, np.nan])
def test_a_hostile_latent_stays_in_its_row_and_columns(hostile: float) -> None:
    latents, modes, rows = tables(9, 4, 3)
    factors = [(latents, modes), tables(9, 4, 12)[:2]]
    clean = [kernels.add_bilinear(given, rows, 1) for given in (factors[:1], factors)]
    latents[5, 2] = hostile
    made, both = (kernels.add_bilinear(given, rows, 1) for given in (factors[:1], factors))
    with np.errstate(over="ignore", invalid="ignore"):
        wanted = side_by_side(rows)[5] + latents[5].astype(np.float64) @ modes
    np.testing.assert_allclose(side_by_side(made)[5], wanted, rtol=1e-5, atol=1e-5)
    for got, expected in zip((*made, *both), (*clean[0], *clean[1]), strict=True):
        assert np.array_equal(np.delete(got, 5, axis=0), np.delete(expected, 5, axis=0))
    assert np.array_equal(both[-1][:, 3:], clean[1][-1][:, 3:])  # beyond the columns of the first product


def test_wrong_shapes_are_named() -> None:
    latents, modes, rows = tables(9, 4, 3)
    with pytest.raises(ValueError, match=r"modes must have shape \[4, at most 64\], got \[3, 14\]"):
        kernels.add_bilinear([(latents, modes[:3])], rows, 1)
    with pytest.raises(ValueError, match=r"tensor 2 must have shape \[9\]"):
        kernels.add_bilinear([(latents, modes)], [*rows[:2], rows[2][:-1], *rows[3:]], 1)
    with pytest.raises(ValueError, match="at most 64"):
        kernels.add_bilinear([(latents, modes)], [*rows[:4], np.zeros((9, 54), np.float32)], 1)
    with pytest.raises(ValueError, match=r"latents must have shape \[9, 1 to 256\]"):
        kernels.bilinear_gradients(np.zeros((9, 300), np.float32), modes, rows, 1)
    with pytest.raises(ValueError, match=r"latents must have shape \[9, 1 to 256\], got \[8, 4\]"):
        kernels.add_bilinear([(latents[:8], modes)], rows, 1)
    with pytest.raises(ValueError, match="the 14 columns of the modes, got 13"):
        kernels.bilinear_gradients(latents, modes, [*rows[:4], rows[4][:, :2]], 1)
    for number in (0, 3):
        with pytest.raises(ValueError, match=f"1 to 2 products can be added, got {number}"):
            kernels.add_bilinear(number * [(latents, modes)], rows, 1)
    with pytest.raises(ValueError, match=r"only columns can be added to a tensor, got \[9\]"):
        kernels.add_bilinear([(latents, modes)], [*rows[:4], rows[3]], 1)
