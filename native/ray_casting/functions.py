"""Transfer functions as rays meet them: knots between which opacity and colour are linear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction

NARROW = 1 / 256  # a field that spans less of its transfer function than this is drawn over its own range


def drawn_range(values: tuple[float, float], transfer: TransferFunction) -> tuple[float, float]:
    """The values (low, high) that become 0 and 1: the bounds of the transfer function.

    Where the field's `values`, smallest and largest, span a small part of them only, these, so that single precision
    resolves the field.
    """
    (low, high), (first, last) = values, transfer.bounds
    return (low, high) if 0.0 < high - low < NARROW * (last - first) else (first, last)


@dataclass(frozen=True, eq=False)
class Knots:
    """The values between which a transfer function is linear, over a drawn range, and the weights of its control points.

    Attributes
    ----------
    places : (K,) increasing from 0 to 1, which stand for the drawn range.
    of_opacities, of_colors : (K, P) and (K, Q); times the control points' opacities (P,) or colours (Q, 3) they give those of
        the knots.
    """

    places: NDArray[np.float64]
    of_opacities: NDArray[np.float64]
    of_colors: NDArray[np.float64]

    @classmethod
    def of(cls, transfer: TransferFunction, value_range: tuple[float, float]) -> Knots:
        """Those of a function over the `value_range`."""
        low, high = value_range
        of_opacities, of_colors = (np.array(p)[:, 0] for p in (transfer.opacity_points, transfer.color_points))
        values = np.unique(np.concatenate([of_opacities, of_colors, value_range]))
        values = values[(values >= low) & (values <= high)]  # [K]
        weights = (
            [np.interp(values, points, one) for one in np.eye(len(points))] for points in (of_opacities, of_colors)
        )
        return cls((values - low) / (high - low), *(np.stack(w, axis=1) for w in weights))

    def table(self, transfer: TransferFunction) -> NDArray[np.float64]:
        """Rows (K, 5) of place, opacity, red, green and blue."""
        opacities = self.of_opacities @ np.array(transfer.opacity_points)[:, 1:]
        colors = self.of_colors @ np.array(transfer.color_points)[:, 1:]
        return np.concatenate([self.places[:, None], opacities, colors], axis=1)
