"""A surrogate whose pictures have gradients: by the parameters, by the camera's pose, and by everything that was trained."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from catalogs.vocabulary.words import joined_names
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians, Normalization
from surrogate.model.deformed import checked_background
from surrogate.model.places import ParameterPoint, place_of
from surrogate.model.rigid import in_camera, posed
from surrogate.rasterizer import Rasterizer, primitives

BLACK = (0.0, 0.0, 0.0)


class DifferentiableSurrogate(torch.nn.Module):
    """A surrogate as a torch module, made by `Surrogate.differentiable`.

    Find the parameter of a picture by gradient descent:

    >>> model = surrogate.differentiable().requires_grad_(False)   # doctest: +SKIP
    >>> parameters = torch.tensor([1700.0], requires_grad=True)    # in the order and units of surrogate.space   # doctest: +SKIP
    >>> optimizer = torch.optim.Adam([parameters], lr=20.0)        # doctest: +SKIP
    >>> for _ in range(100):                                       # doctest: +SKIP
    ...     optimizer.zero_grad()
    ...     loss = (model(parameters, camera) - target).square().mean()
    ...     loss.backward()
    ...     optimizer.step()

    Its torch parameters are copies of the Gaussians' tensors (`means`, `log_scales`, `quats`, `opacity_logits`, and `colors` or
    `values`) and of the deformations'.  `requires_grad_(False)` saves their gradients where only those by the arguments are wanted.

    There are no gradients by the camera's intrinsics, a transfer function given as such, or the order of the Gaussians in depth.
    Displacements of a function by tensors raise ValueError where the Gaussians carry values.  The kernels can be differentiated
    once.
    """

    def __init__(
        self,
        gaussians: AnyGaussians,
        deformation: BilinearDeformation,
        visualizations: Sequence[Visualization],
        space: ParameterSpace,
        normalization: Normalization,
        rasterizer: Rasterizer,
    ) -> None:
        super().__init__()
        self.space, self.normalization, self.rasterizer = space, normalization, rasterizer
        self._gaussians = gaussians.with_tensors(list(self._registered("", gaussians.tensors()).values()))
        self._deformation = deformation.with_tensors(self._registered("deformation_", deformation.tensors()))
        self._visualizations = tuple(
            v.with_tensors(self._registered(f"visualization{i}_", v.tensors())) for i, v in enumerate(visualizations)
        )

    def forward(
        self,
        parameters: Tensor | Mapping[str, Any],
        camera: Camera,
        *,
        pose: Tensor | None = None,
        background: Sequence[float] | None = None,
    ) -> Tensor:
        """The picture (H, W, 4), premultiplied RGBA: that of `at(...).render(camera)`, before it is cut to [0, 1].

        Parameters
        ----------
        parameters : (P,) in the order and units of `space`; or a mapping of names to numbers and tensors of shape (), in which
            visualization parameters may stand as well.
        pose : (4, 4) world to camera, rigid, instead of the camera's: differentiable, for instance from `look_at` or
            `torch.linalg.matrix_exp`.  Only gradients along rigid motions mean anything.  Numbers then differ from those without
            it in their last digits.
        background : (red, green, blue) each in [0, 1], on which the picture is composited, alpha 1.

        Raises ValueError as `at` and `render` do, and for a pose that is not rigid.  What lies behind the camera, or is not seen,
        has zero gradients.
        """
        behind = checked_background(background)
        gaussians = self.deformed(parameters)
        if pose is None:
            view = self.normalization.camera(camera)
            projected = primitives(gaussians, view)
        else:
            view = replace(posed(camera, pose), world_to_camera=np.eye(4))
            projected = in_camera(gaussians, self.normalization, pose)
        picture = self.rasterizer.draw_primitives(projected, gaussians, view, BLACK)  # [H, W, 4]
        if behind is None:
            return picture
        color = picture[..., :3] + (1.0 - picture[..., 3:]) * torch.from_numpy(behind).to(picture)
        return torch.cat([color, torch.ones_like(picture[..., 3:])], dim=2)

    def deformed(self, parameters: Tensor | Mapping[str, Any]) -> Gaussians:
        """The Gaussians of one member, in normalized coordinates, differentiable as `forward` is."""
        named = self._named(parameters)
        numbers = {n: float(v.detach()) if isinstance(v, Tensor) else v for n, v in named.items()}
        place = place_of(self.space, self._visualizations, numbers, "allow")
        self._check_differentiable(place, named)
        normalized = self._normalized(place, named).to(self._gaussians.means)  # [P + V]
        if place.visualization is None:
            gaussians = self._deformation.deformed(self._gaussians, normalized).drawn()
        else:
            gaussians = place.visualization.gaussians_at(self._gaussians, self._deformation, normalized)
        if place.warnings:
            place.check_finite(gaussians)
        return gaussians

    def __repr__(self) -> str:
        like = self._gaussians.means
        return f"<DifferentiableSurrogate of {self.space}: {len(self._gaussians):,} Gaussians, {like.dtype}, {like.device}>"

    def _registered(self, prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Copies of tensors as torch parameters of this module, under their names after a prefix."""
        own = {name: torch.nn.Parameter(tensor.detach().clone()) for name, tensor in tensors.items()}
        for name, parameter in own.items():
            self.register_parameter(prefix + name.replace(".", "_"), parameter)
        return dict(own)

    def _named(self, parameters: Any) -> dict[str, Any]:
        if isinstance(parameters, Mapping):
            named = dict(parameters)
        elif isinstance(parameters, Tensor) and parameters.shape == (len(self.space),):
            named = dict(zip(self.space.names, parameters.unbind(0), strict=True))
        else:
            raise ValueError(
                f"parameters must be a tensor of shape ({len(self.space)},), for {joined_names(self.space.names)}, "
                "or a mapping of names, "
                f"got {getattr(parameters, 'shape', type(parameters).__name__)}"
            )
        for name, value in named.items():
            if isinstance(value, Tensor) and value.numel() != 1:
                raise ValueError(f"parameter {name} must be one number, got shape {tuple(value.shape)}")
        return {n: v.reshape(()) if isinstance(v, Tensor) else v for n, v in named.items()}

    def _check_differentiable(self, place: ParameterPoint, named: Mapping[str, Any]) -> None:
        """Raise ValueError for a gradient by a transfer function that is applied to carried values, which there is none of."""
        if place.visualization is None or place.visualization.deformation is not None:
            return
        for name in place.visualization.variation.argument_names:
            if isinstance(named.get(name), Tensor) and named[name].requires_grad:
                raise ValueError(
                    f"pictures have no gradient by {name}, for the Gaussians carry values to which functions are applied: pass a "
                    "number, or detach it"
                )

    def _normalized(self, place: ParameterPoint, named: Mapping[str, Any]) -> Tensor:
        """The normalized parameters (P + V,) float64 of a place, with the gradient by those that were given as tensors."""
        parts = [_follow(place.simulation, self.space.names, named, _slopes(self.space, place.parameters))]
        if place.visualization is not None and place.settings is not None:
            variation = place.visualization.variation
            slopes = _visual_slopes(variation, place.parameters)
            parts.append(_follow(place.settings, variation.space.names, named, slopes))
        return torch.cat(parts)


def _follow(
    numbers: NDArray[np.float64], names: Sequence[str], named: Mapping[str, Any], slopes: Mapping[str, float]
) -> Tensor:
    """Normalized `numbers` as they are, with the derivative `slopes` by the tensors among what was given."""
    rows = []
    for number, name in zip(numbers.tolist(), names, strict=True):
        value, row = named.get(name), torch.tensor(number, dtype=torch.float64)
        if isinstance(value, Tensor) and name in slopes:
            moved = value.double()
            row = row.to(moved.device) + slopes[name] * (moved - moved.detach())
        rows.append(row.cpu())
    return torch.stack(rows) if rows else torch.zeros(0, dtype=torch.float64)


def _slopes(space: ParameterSpace, values: Mapping[str, Any]) -> dict[str, float]:
    """The derivative of each normalized parameter by the parameter."""
    return {
        p.name: 2.0 / (math.log(p.high / p.low) * values[p.name]) if p.scale == "log" else 2.0 / (p.high - p.low)
        for p in space.parameters
        if isinstance(values.get(p.name), int | float)
    }


def _visual_slopes(variation: Variation, values: Mapping[str, Any]) -> dict[str, float]:
    """The same for visualization parameters; of an isovalue that of the piece of its normalization, which is piecewise linear."""
    if not isinstance(variation, IsovalueVariation):
        return _slopes(variation.space, values)
    name = variation.space.names[0]
    trained = np.array(sorted(value for (value,) in variation.trained))  # [T]
    k = int(np.clip(np.searchsorted(trained, values[name], side="right"), 1, len(trained) - 1))
    return {name: 2.0 / (len(trained) - 1) / float(trained[k] - trained[k - 1])}
