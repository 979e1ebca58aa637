"""Principal components of an ensemble's fields, in float64, by the inner products of the members."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import one_line

Array = NDArray[np.float64]

NOTHING = 1e-6  # of the largest singular value: less is the rounding of float32
PIECE = 1 << 15  # voxels at once, in float64


@dataclass(frozen=True, eq=False)
class Components:
    """The J components of M members' fields, about their mean; component j is `(combinations.T @ (fields - mean))[j]`.

    Attributes
    ----------
    coefficients : (M, J), strongest component first.
    combinations : (M, J), of the members' differences from the mean; components have length 1.
    """

    coefficients: Array  # [M, J]
    combinations: Array  # [M, J]

    __repr__ = one_line

    @classmethod
    def of(cls, products: Array) -> Components:
        """From the inner products (M, M) of the differences."""
        squares, vectors = np.linalg.eigh(products)
        strengths = np.sqrt(np.maximum(squares[::-1], 0.0))  # [M]
        is_useful = strengths > NOTHING * strengths[0]
        is_useful[-1] &= len(products) == 1  # differences from a mean have one dimension less
        vectors, strengths = vectors[:, ::-1][:, is_useful], strengths[is_useful]
        return cls(vectors * strengths, vectors / strengths)


def products_of(differences: NDArray[np.float32]) -> Array:
    """Inner products (M, M) of fields (M, V)."""
    total = np.zeros((len(differences), len(differences)))
    for start in range(0, differences.shape[1], PIECE):
        piece = differences[:, start : start + PIECE].astype(np.float64)
        total += piece @ piece.T
    return total


def without(products: Array, members: NDArray[np.int64]) -> Array:
    """Inner products of the members' differences from their own mean."""
    own = products[np.ix_(members, members)]
    return own - own.mean(0) - own.mean(0)[:, None] + own.mean()
