"""A loss without pictures: the difference of Gaussians' blended values from those that the hook sampled at the same places.

The C++ kernel is tested against its reference implementation, `blended_values_reference`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import softplus

from catalogs.vocabulary.words import one_line
from native import kernels
from surrogate.appearance.field_gaussians import FieldGaussians
from surrogate.appearance.scale import ValueScale
from surrogate.derivatives import require_no_second_derivative
from surrogate.initialization.field_points import FieldPoints
from surrogate.randomness import generator
from surrogate.splatting.reference import rotations

REACH = 3.0  # standard deviations
NAMES = ("means", "scales", "quats", "weights", "values")
PLACES = 256  # that are looked at in a step
INTERVAL = 4  # steps: looking in each takes up to a fifth longer, at a quarter of the weight, and teaches no more
BEYOND = 0.2  # of a scale of values: what lies further beyond its ends counts as that


@dataclass(frozen=True, eq=False)
class KnownValues:
    """The fields' values at points of the training members, of which some steps look at a few.

    Attributes
    ----------
    points : M of them.
    scale : on which the Gaussians carry values.
    seed : of which are looked at.
    """

    points: FieldPoints
    scale: ValueScale
    seed: int

    __repr__ = one_line

    def loss(self, carriers: FieldGaussians, member: str, step: int) -> Tensor:
        """`value_loss` at some of a member's points, half of them seen and half even ones; 0 for a member without any.

        `carriers` are the Gaussians at the member's parameters.  They count by their optical depth where the extinction is 1.
        """
        row = self._rows.get(member)
        if row is None:
            return carriers.values.new_zeros(())
        some = torch.from_numpy(self.points.sample(row, PLACES, generator(self.seed, "values", step)))  # [Q]
        places, truth = (tensor[some].to(carriers.means.device) for tensor in self._samples)
        blended = blended_values(
            carriers.means,
            carriers.log_scales.exp(),
            carriers.quats,
            softplus(carriers.opacity_logits),
            carriers.values[:, 0],
            places,
        )
        return value_loss(blended, truth)

    @cached_property
    def _rows(self) -> dict[str, int]:
        """The row of each member among those of the points."""
        return {name: row for row, name in enumerate(self.points.names)}

    @cached_property
    def _samples(self) -> tuple[Tensor, Tensor]:
        """The places (M, 3), and the values there on the scale (M,), float32."""
        values = np.clip(self.scale.places(self.points.values), -BEYOND, 1.0 + BEYOND)
        return torch.from_numpy(self.points.places), torch.from_numpy(values.astype(np.float32))


def value_loss(blended: Tensor, truth: Tensor) -> Tensor:
    """Mean absolute difference of blended values (Q,) to the field's own (Q,), over the places that a Gaussian covers.

    Those that none covers, where `blended` is not a number, are left out; the loss is 0 where all are.
    """
    covered = ~blended.isnan()  # [Q]
    differences = torch.where(covered, blended - truth, 0.0)  # [Q]
    return differences.abs().sum() / covered.sum().clamp(min=1)


def blended_values(
    means: Tensor,
    scales: Tensor,
    quats: Tensor,
    weights: Tensor | None,
    values: Tensor,
    places: Tensor,
    *,
    reach: float = REACH,
) -> Tensor:
    """The values that N Gaussians carry, blended at Q places x: (Q,), sum_i w_i G_i(x) u_i / sum_i w_i G_i(x).

    G_i is the Gaussian without a factor, 1 at its mean, and 0 beyond `reach` standard deviations (Mahalanobis distance).  A place
    that no Gaussian of positive weight covers has no value: NaN.  Differentiable by all but `places`, once; what is not to follow
    the values is passed detached, which also takes less time.

    Parameters
    ----------
    means, scales, quats : (N, 3), (N, 3), (N, 4), as in `surrogate.splatting.render`.
    weights : (N,) w, not negative, such as optical depths; None for equal ones.
    values : (N,) u.
    places : (Q, 3), in the coordinates of `means`.

    In main memory and float32 the C++ kernel computes it on one core, anything else the reference implementation, whose memory
    grows with N times Q. Raises ValueError for shapes that do not belong together, and where a number is not finite or a weight
    negative.
    """
    weights = torch.ones_like(values) if weights is None else weights
    tensors = (means, scales, quats, weights, values)
    if all(tensor.is_cpu and tensor.dtype == torch.float32 for tensor in (*tensors, places)):
        return _BlendedValues.apply(places, reach, *tensors)
    return blended_values_reference(*tensors, places, reach=reach)


def blended_values_reference(
    means: Tensor,
    scales: Tensor,
    quats: Tensor,
    weights: Tensor,
    values: Tensor,
    places: Tensor,
    *,
    reach: float = REACH,
) -> Tensor:
    """The same in plain torch, over all pairs: the definition that the kernel is tested against."""
    offsets = places[:, None, :] - means  # [Q, N, 3]
    local = torch.einsum("qnc,nck->qnk", offsets, rotations(quats)) / scales  # [Q, N, 3]
    squared = (local**2).sum(dim=2)  # [Q, N]
    near = squared <= reach**2  # [Q, N]
    shares = weights * torch.where(near, torch.exp(-0.5 * torch.where(near, squared, 0.0)), 0.0)  # [Q, N]
    total = shares.sum(dim=1)  # [Q]
    covered = total > 0.0  # [Q]
    return torch.where(covered, (shares @ values) / torch.where(covered, total, 1.0), torch.nan)


class _BlendedValues(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        places, reach, *tensors = inputs
        arrays = [tensor.detach().numpy() for tensor in tensors]
        ctx.blend = kernels.blend(arrays, places.detach().numpy(), reach)
        ctx.save_for_backward(*tensors)  # torch refuses a backward pass after they have changed
        return torch.from_numpy(ctx.blend.values).to(places.dtype)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        require_no_second_derivative("blended_values", "blended_values_reference")
        _ = ctx.saved_tensors
        needed = ctx.needs_input_grad[2:]
        gradients_of_kernel = kernels.blend_gradients(ctx.blend, gradients[0].nan_to_num(0.0).numpy(), any(needed[:3]))
        every = [None] * (len(NAMES) - len(gradients_of_kernel)) + [
            torch.from_numpy(array) for array in gradients_of_kernel
        ]
        return None, None, *(gradient if wanted else None for gradient, wanted in zip(every, needed, strict=True))
