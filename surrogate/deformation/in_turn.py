"""Two deformations one after the other; bilinear ones in one pass over the Gaussians."""

from __future__ import annotations

from torch import Tensor

from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.deformation.offsets import Deformation
from surrogate.deformation.products import add_products
from surrogate.gaussians import Gaussians

Placed = tuple[Deformation, Tensor]  # a deformation and the normalized parameters (P,) that it is asked for


def deformed_in_turn(gaussians: Gaussians, first: Placed, second: Placed) -> Gaussians:
    """What `second` makes of what `first` makes of the Gaussians.

    Bilinear deformations don't look at what they deform, so the offsets of both are added at once: nothing lies in memory
    between, and the result is that of one after the other, bit for bit.
    """
    bilinear = [d for d, _ in (first, second) if isinstance(d, BilinearDeformation) and d.has_kernel]
    if len(bilinear) == 2:
        places = first[1], second[1]
        return add_products(gaussians, [d.factors(place) for d, place in zip(bilinear, places, strict=True)])
    for deformation, parameters in (first, second):
        gaussians = deformation.deformed(gaussians, parameters)
    return gaussians
