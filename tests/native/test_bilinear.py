"""Bilinear offsets by the compiled module: against float64, for every instruction set, any number of threads, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import native

WIDTHS = (3, 3, 4, 1)


def tables(count: int, latent: int, color_columns: int) -> tuple[NDArray, NDArray, list[NDArray]]:
    random = np.random.default_rng(count + latent)
    widths = (*WIDTHS, color_columns)
    rows = [random.normal(size=(count,) if width == 1 else (count, width)).astype(np.float32) for width in widths]
    latents = random.normal(size=(count, latent)).astype(np.float32)
    return latents, random.normal(size=(latent, sum(widths))).astype(np.float32), rows


def side_by_side(rows: list[NDArray]) -> NDArray[np.float64]:
    return np.concatenate([row.reshape(len(row), -1).astype(np.float64) for row in rows], axis=1)


@pytest.mark.parametrize("instruction_set", native.instruction_sets())
@pytest.mark.parametrize(("count", "latent", "color_columns"), [(1, 1, 3), (5, 16, 3), (1300, 16, 12), (514, 23, 48)])
def test_every_instruction_set_multiplies(instruction_set: str, count: int, latent: int, color_columns: int) -> None:
    latents, modes, rows = tables(count, latent, color_columns)
    made = native.add_bilinear(latents, modes, rows, 1, instruction_set)
    wanted = side_by_side(rows) + latents.astype(np.float64) @ modes
    assert [array.shape for array in made] == [row.shape for row in rows]
    np.testing.assert_allclose(side_by_side(made), wanted, atol=3e-6 * np.abs(wanted).max())
    by_latents, by_modes = native.bilinear_gradients(latents, modes, rows, 1, instruction_set)
    wanted = side_by_side(rows) @ modes.T.astype(np.float64)
    np.testing.assert_allclose(by_latents, wanted, atol=3e-6 * np.abs(wanted).max())
    wanted = latents.T.astype(np.float64) @ side_by_side(rows)
    np.testing.assert_allclose(by_modes, wanted, atol=3e-6 * np.abs(wanted).max())


def test_threads_change_no_bit() -> None:
    latents, modes, rows = tables(5000, 16, 3)
    for function in (native.add_bilinear, native.bilinear_gradients):
        alone = function(latents, modes, rows, 1)
        for threads in (2, 3, 8):
            together = function(latents, modes, rows, threads)
            assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))


@pytest.mark.parametrize("hostile", [0.0, 1e-42, 1e30, np.inf, np.nan])
def test_a_hostile_latent_stays_in_its_row(hostile: float) -> None:
    latents, modes, rows = tables(9, 4, 3)
    clean = native.add_bilinear(latents, modes, rows, 1)
    latents[5, 2] = hostile
    made = native.add_bilinear(latents, modes, rows, 1)
    with np.errstate(over="ignore", invalid="ignore"):
        wanted = side_by_side(rows)[5] + latents[5].astype(np.float64) @ modes
    np.testing.assert_allclose(side_by_side(made)[5], wanted, rtol=1e-5, atol=1e-5)
    for got, expected in zip(made, clean, strict=True):
        assert np.array_equal(np.delete(got, 5, axis=0), np.delete(expected, 5, axis=0))


def test_wrong_shapes_are_named() -> None:
    latents, modes, rows = tables(9, 4, 3)
    with pytest.raises(ValueError, match=r"modes must have shape \[4, 14\], got \[4, 13\]"):
        native.add_bilinear(latents, np.ascontiguousarray(modes[:, :-1]), rows, 1)
    with pytest.raises(ValueError, match=r"tensor 2 must have shape \[9\]"):
        native.add_bilinear(latents, modes, [*rows[:2], rows[2][:-1], *rows[3:]], 1)
    with pytest.raises(ValueError, match="at most 64"):
        native.add_bilinear(latents, modes, [*rows[:4], np.zeros((9, 54), np.float32)], 1)
    with pytest.raises(ValueError, match="latents must have shape"):
        native.bilinear_gradients(np.zeros((9, 300), np.float32), modes, rows, 1)
