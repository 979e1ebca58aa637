"""The composition of two deformations; of bilinear ones in one pass over the Gaussians."""

from __future__ import annotations

from torch import Tensor

from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.deformation.kernels import add_products
from surrogate.deformation.offsets import Deformation
from surrogate.gaussians import Gaussians

At = tuple[Deformation, Tensor]  # a deformation and normalized parameters (P,)


def compose(gaussians: Gaussians, first: At, second: At) -> Gaussians:
    """The Gaussians deformed by `first`, and the result by `second`.

    Offsets of bilinear deformations do not depend on what they deform, so both are added at once, without storing what lies
    between; the result is the same bit for bit.
    """
    bilinear = [d for d, _ in (first, second) if isinstance(d, BilinearDeformation) and d.has_kernel]
    if len(bilinear) == 2:
        places = first[1], second[1]
        return add_products(gaussians, [d.factors(place) for d, place in zip(bilinear, places, strict=True)])
    for deformation, parameters in (first, second):
        gaussians = deformation.deformed(gaussians, parameters)
    return gaussians
