"""A stage of training: what is optimized, how fast, and how it makes the Gaussians of a member."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from torch import Tensor

from surrogate.gaussians import Gaussians


@dataclass(frozen=True, eq=False)
class Stage:
    """One stage.

    Attributes
    ----------
    name : "canonical", "deformation", or the kind of a variation.
    steps : its length.
    tensors : the leaf tensors that are optimized, by name; those of the Gaussians under the names in `Gaussians`.
    rates : Adam's rate per tensor at the stage's start.
    per_gaussian : which of them have a row per Gaussian.
    gaussians_at : the Gaussians at normalized parameters (P,), differentiable in `tensors`.
    rest_at : what the stage's deformation acts on, there; None where it has none.
    relocates : whether dead Gaussians may move; all rows of `per_gaussian` are among `tensors` then.
    """

    name: str
    steps: int
    tensors: Mapping[str, Tensor]
    rates: Mapping[str, float]
    per_gaussian: frozenset[str]
    gaussians_at: Callable[[Tensor], Gaussians]
    relocates: bool = True
    rest_at: Callable[[Tensor], Gaussians] | None = None
