"""Gaussians that carry values of a field, from which a transfer function makes those that are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import torch
from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.appearance.averages import resampled
from surrogate.appearance.scale import ValueScale
from surrogate.appearance.transferred import AverageTable, apply
from surrogate.gaussians import GEOMETRY, Gaussians

FIELD_NAMES = (*GEOMETRY, "values")
MOST_TABLES = 128  # that are kept


@dataclass(frozen=True, eq=False)
class FieldValues:
    """The meaning of the values, and the transfer function that shows them.

    Attributes
    ----------
    base : the transfer function that is shown unless another one is asked for; extinctions are relative to its unit distance.
    scale : on which the values lie.
    medium : whether the Gaussians absorb along rays, see `Gaussians`; models that were trained before they did have False.
    """

    base: TransferFunction
    scale: ValueScale
    medium: bool = True
    _tables: dict[TransferFunction, AverageTable] = field(default_factory=dict, repr=False)

    __repr__ = one_line

    @classmethod
    def load(cls, record: Mapping[str, Any]) -> FieldValues:
        """Those of `record()`; raises ValueError for what is none."""
        medium = record.get("medium", False)
        if not isinstance(medium, bool):
            raise ValueError(f"medium must be true or false, got {medium!r}")
        return cls(TransferFunction(**record["base"]), ValueScale.from_json(record["knots"]), medium)

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs."""
        return {"base": asdict(self.base), "knots": self.scale.to_json(), "medium": self.medium}

    def table(self, function: TransferFunction) -> AverageTable:
        """The averages of a function; those asked for lately are kept."""
        table = self._tables.pop(function, None)
        if table is None:
            table = AverageTable.of(resampled(function, self.base.opacity_unit_distance, self.scale.knots))
        self._tables[function] = table
        while len(self._tables) > MOST_TABLES:
            self._tables.pop(next(iter(self._tables)))
        return table


@dataclass(frozen=True, eq=False)
class FieldGaussians:
    """N Gaussians in unconstrained parameters (float32), in the coordinates of a `Normalization`.

    The values in each are normally distributed.  A transfer function's extinction, and extinction times colour, are averaged over
    them.  Times the thickness they are optical depth and emission (Max 1995, equations 1 to 3).  The thickness along a ray is that
    of a ball of the same volume, times how much longer the ray is in the Gaussian.

    Attributes
    ----------
    means, log_scales, quats : as in `Gaussians`.
    opacity_logits : (N,), whose sigmoid is the opacity that a ball of its volume would have where the extinction is 1.
    values : (N, 2), the mean of the values in each on the scale of `field`, and the logarithm of their standard deviation.
    field : what the values mean.
    """

    means: Tensor  # [N, 3]
    log_scales: Tensor  # [N, 3]
    quats: Tensor  # [N, 4]
    opacity_logits: Tensor  # [N]
    values: Tensor  # [N, 2]
    field: FieldValues

    __repr__ = one_line

    color_degree: ClassVar[int] = 0

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, Tensor], field: FieldValues) -> FieldGaussians:
        """The Gaussians that had these `tensors()`; raises ValueError naming the tensor whose shape is another."""
        if set(tensors) != set(FIELD_NAMES):
            raise ValueError(f"they must consist of {joined_names(FIELD_NAMES)}, got {joined_names(sorted(tensors))}")
        count = len(tensors["means"]) if tensors["means"].ndim else 0
        shapes: dict[str, tuple[int, ...]] = {name: (count, width) for name, width in GEOMETRY.items()}
        shapes |= {"opacity_logits": (count,), "values": (count, 2)}
        for name, shape in shapes.items():
            if tuple(tensors[name].shape) != shape:
                raise ValueError(f"{name} must be of shape {shape}, got {tuple(tensors[name].shape)}")
        means, log_scales, quats, opacity_logits, values = (tensors[name] for name in FIELD_NAMES)
        return cls(means, log_scales, quats, opacity_logits, values, field)

    def __len__(self) -> int:
        return self.means.shape[0]

    def record(self) -> dict[str, Any]:
        """JSON values that `load_gaussians` needs beside the tensors."""
        return {"field": self.field.record()}

    def tensors(self) -> dict[str, Tensor]:
        """The parameters by name."""
        return {name: getattr(self, name) for name in FIELD_NAMES}

    def with_tensors(self, tensors: Sequence[Tensor]) -> FieldGaussians:
        """The same with other tensors, in the order of `tensors()`."""
        means, log_scales, quats, opacity_logits, values = tensors
        return FieldGaussians(means, log_scales, quats, opacity_logits, values, self.field)

    def with_color_degree(self, degree: int) -> FieldGaussians:
        """The same: a transfer function's colours are those from every direction; raises ValueError for a degree above 0."""
        if degree:
            raise ValueError(f"colours of a transfer function have no degree {degree}")
        return self

    def of(self, rows: Tensor) -> FieldGaussians:
        """Some of them, by index (M,)."""
        return self.with_tensors([tensor[rows] for tensor in self.tensors().values()])

    def to(self, device: torch.device | torch.dtype) -> FieldGaussians:
        """The same on another device, or in another precision."""
        return self.with_tensors([tensor.to(device) for tensor in self.tensors().values()])

    def copy(self) -> FieldGaussians:
        """The same numbers in tensors of their own."""
        return self.with_tensors([tensor.detach().clone() for tensor in self.tensors().values()])

    def drawn(self, function: TransferFunction | None = None) -> Gaussians:
        """The Gaussians to draw under a transfer function, by default the base; differentiable."""
        table = self.field.table(function or self.field.base)
        logits, colors = apply(table, self.opacity_logits, self.values)
        return Gaussians(self.means, self.log_scales, self.quats, logits, colors, medium=self.field.medium)


AnyGaussians = Gaussians | FieldGaussians


def load_gaussians(tensors: Mapping[str, Tensor], field: Mapping[str, Any] | None) -> AnyGaussians:
    """The Gaussians that had these `tensors()`, and in their `record()` this `field`, None where they carry colours.

    Raises ValueError where they do not belong together.
    """
    return (
        Gaussians.of_tensors(tensors) if field is None else FieldGaussians.of_tensors(tensors, FieldValues.load(field))
    )
