"""Deformations, which move the Gaussians with the parameters: one small interface, one file per design."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from catalogs.vocabulary.words import joined_names
from surrogate.deformation.bilinear import BilinearDeformation, compose
from surrogate.deformation.offsets import Deformation, Offsets
from surrogate.deformation.values import ValuesDeformation

READABLE: dict[str, type[Deformation]] = {form.kind: form for form in (BilinearDeformation, ValuesDeformation)}

__all__ = [
    "READABLE",
    "BilinearDeformation",
    "Deformation",
    "Offsets",
    "ValuesDeformation",
    "compose",
    "load_deformation",
]


def load_deformation(tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> Deformation:
    """The deformation of `stored()` and `record()`; raises ValueError for a kind that this version does not know."""
    kind = record["kind"]
    if not isinstance(kind, str) or kind not in READABLE:
        raise ValueError(f"unknown deformation {kind!r}: this version knows {joined_names(sorted(READABLE))}")
    return READABLE[kind].load(tensors, record)
