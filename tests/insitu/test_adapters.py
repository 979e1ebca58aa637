"""Fields in any form become the same grid."""

from __future__ import annotations

import numpy as np
import pytest

from insitu.adapters import as_grid
from insitu.kept import KeptField

VALUES = np.random.default_rng(0).random((3, 4, 5)).astype(np.float32)


class Exporter:
    """An array of another library, known by DLPack alone."""

    def __dlpack__(self, **options):
        return VALUES.__dlpack__(**options)

    def __dlpack_device__(self):
        return VALUES.__dlpack_device__()


@pytest.mark.parametrize(
    ("field", "given"),
    [
        (VALUES, True),
        (np.asfortranarray(VALUES), True),
        (np.concatenate([VALUES, VALUES], axis=2)[:, :, :5], True),
        (VALUES.tolist(), True),
        (Exporter(), True),
        (KeptField(VALUES, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), None), False),
    ],
    ids=["array", "Fortran order", "view", "list", "DLPack", "field"],
)
def test_the_grid_is_the_same(field, given: bool) -> None:
    placed = {"spacing": (1.0, 2.0, 3.0), "origin": (4.0, 5.0, 6.0)} if given else {}
    grid = as_grid(field, **placed)
    assert np.array_equal(grid.values, VALUES)
    assert (grid.spacing, grid.origin) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


def test_the_simulations_array_may_change_afterwards() -> None:
    field = VALUES.copy()
    grid = as_grid(field)
    field[:] = 0.0
    assert np.array_equal(grid.values, VALUES)


@pytest.mark.parametrize("field", [None, "text", object(), {"values": 1}])
def test_what_is_no_field_is_refused(field) -> None:
    with pytest.raises((TypeError, ValueError)):
        as_grid(field)
