"""How simulation parameters move the canonical Gaussians: one small interface, one file per design."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.deformation.offsets import Deformation, Offsets

KINDS: dict[str, type[Deformation]] = {BilinearDeformation.kind: BilinearDeformation}

__all__ = ["KINDS", "BilinearDeformation", "Deformation", "Offsets", "load_deformation"]


def load_deformation(kind: str, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Deformation:
    """The saved deformation of this `kind`; raises ValueError for one that this version does not know."""
    if kind not in KINDS:
        raise ValueError(f"unknown deformation {kind!r}: this version knows {sorted(KINDS)}")
    return KINDS[kind].load(tensors, record)
