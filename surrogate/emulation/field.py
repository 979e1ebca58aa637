"""A field as an emulator predicts it, with what can be asked of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from surrogate.emulation import exports, measures
from surrogate.emulation.corners import BEYOND, other_shape, resampled
from surrogate.emulation.lattice_field import LatticeField
from surrogate.emulation.posterior import ResampledPosterior


@dataclass(frozen=True, eq=False, repr=False)
class EmulatedField(LatticeField):
    """A field at one set of parameters, with numbers of it, from `measures`, and its form for other programs, from `exports`.

    Examples
    --------
    >>> from blobs import make_run
    >>> from surrogate import Surrogate
    >>> field = Surrogate.load(make_run() / "surrogate").at(separation=0.8, width=0.3).field()
    >>> f"{field.sample([(0.4, 0, 0)]).values[0]:.1f}"  # in a blob's centre
    '1.0'
    """

    sample = measures.sample
    profile = measures.profile
    plane = measures.plane
    statistics = measures.statistics
    histogram = measures.histogram
    to_xarray = exports.to_xarray
    save = exports.save

    def resampled(self, shape: ArrayLike) -> EmulatedField:
        """The field on another number of samples (Z, Y, X) over the same box, trilinear; beside holes there are holes.

        Raises ValueError for shapes that can't span the box.
        """
        before: tuple[int, int, int] = self.values.shape
        after = other_shape(shape, before)
        shares = [(old - 1) / (new - 1) if new > 1 else 1.0 for old, new in zip(before, after, strict=True)]
        x, y, z = (step * share for step, share in zip(self.spacing, shares[::-1], strict=True))
        holes = None if self.holes is None else resampled(self.holes.astype(np.float32), after) > BEYOND
        posterior = None if self.posterior is None else ResampledPosterior(self.posterior, before, after)
        values = resampled(self.values, after)
        return replace(self, values=values, holes=holes, spacing=(x, y, z), posterior=posterior)
