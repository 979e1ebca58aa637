"""Tensors in fewer bits: half precision, or evenly spaced levels between the lowest and the highest value of a column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from catalogs.vocabulary.words import one_line

LEVELS = {"uint8": (torch.uint8, 2**8 - 1), "uint16": (torch.uint16, 2**16 - 1)}
# The shortest first, and of two that are as long the finer one for bounded values.
FORMATS = ("uint8", "uint16", "float16")
CODES, LOW, STEP = "codes", "low", "step"


@dataclass(frozen=True, eq=False)
class Encoding:
    """A tensor (N, ...) in another format; one of levels has `low` and `step` (columns) in float32.

    Encoding what was decoded, with the same low and step, gives the same codes: a model that is read and stored again stays
    the same, bit for bit.
    """

    form: str  # one of FORMATS
    codes: Tensor  # [N, ...] uint8, uint16 or float16
    low: Tensor | None = None  # [C]
    step: Tensor | None = None  # [C]

    __repr__ = one_line

    def decoded(self) -> Tensor:
        """The tensor (N, ...) in float32."""
        if self.low is None or self.step is None:
            return self.codes.float()
        columns = _columns(self.codes.to(torch.int32)).float()  # [N, C]
        return (self.low + columns * self.step).view(self.codes.shape)

    @property
    def saved_bytes(self) -> int:
        """Bytes saved in comparison with float32."""
        return 4 * self.codes.numel() - sum(t.numel() * t.element_size() for t in self.tensors().values())

    def tensors(self) -> dict[str, Tensor]:
        """The tensors to store."""
        levels = {} if self.low is None or self.step is None else {LOW: self.low, STEP: self.step}
        return {CODES: self.codes} | levels

    @classmethod
    def of_tensors(cls, form: str, tensors: Mapping[str, Tensor]) -> Encoding:
        """The encoding that had these `tensors()`; raises ValueError where they can't be those of `form`."""
        expected = LEVELS[form][0] if form in LEVELS else torch.float16
        names = {CODES, LOW, STEP} if form in LEVELS else {CODES}
        fits = form in FORMATS and set(tensors) == names
        if not fits or tensors[CODES].dtype != expected or tensors[CODES].ndim not in (1, 2):
            kinds = {name: str(tensor.dtype) for name, tensor in tensors.items()}
            raise ValueError(f"a tensor in {form!r} must consist of {sorted(names)}, got {kinds}")
        codes, levels = tensors[CODES], [tensors[name] for name in (LOW, STEP) if name in tensors]
        columns = _columns(codes).shape[1:]
        if any(t.shape != columns or t.dtype != torch.float32 or not torch.isfinite(t).all() for t in levels):
            raise ValueError(f"{LOW} and {STEP} must be {columns[0]} finite float32 numbers each")
        return cls(form, codes, *levels)


def encode(tensor: Tensor, form: str) -> Encoding:
    """A float32 tensor (N,) or (N, C), finite, in one of `FORMATS`."""
    if form not in LEVELS:
        return Encoding(form, tensor.to(torch.float16))
    kind, highest = LEVELS[form]
    columns = _columns(tensor).double()  # [N, C]
    low = columns.amin(0) if len(columns) else columns.new_zeros(columns.shape[1])  # [C]
    high = columns.amax(0) if len(columns) else low  # [C]
    step = ((high - low) / highest).float()  # [C]
    codes = ((columns - low) / torch.where(step > 0, step, 1.0).double()).round().clamp(0, highest)  # [N, C]
    return Encoding(form, codes.to(torch.int32).to(kind).view(tensor.shape), low.float(), step)


def _columns(tensor: Tensor) -> Tensor:
    return tensor[:, None] if tensor.ndim == 1 else tensor
