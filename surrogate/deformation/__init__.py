"""How parameters move the Gaussians: one small interface, one file per design."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.deformation.composition import compose
from surrogate.deformation.field import FieldDeformation
from surrogate.deformation.offsets import Deformation, LearntDeformation, Offsets
from surrogate.deformation.values import ValuesDeformation

KINDS: dict[str, type[LearntDeformation]] = {
    BilinearDeformation.kind: BilinearDeformation,
    FieldDeformation.kind: FieldDeformation,
}
READABLE: dict[str, type[Deformation]] = {**KINDS, ValuesDeformation.kind: ValuesDeformation}

__all__ = [
    "KINDS",
    "READABLE",
    "BilinearDeformation",
    "Deformation",
    "FieldDeformation",
    "LearntDeformation",
    "Offsets",
    "ValuesDeformation",
    "compose",
    "load_deformation",
]


def load_deformation(kind: str, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Deformation:
    """The saved deformation of this `kind`; raises ValueError for one that this version does not know."""
    if kind not in READABLE:
        raise ValueError(f"unknown deformation {kind!r}: this version knows {sorted(READABLE)}")
    return READABLE[kind].load(tensors, record)
