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

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from catalogs.vocabulary.words import joined_names
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians, Normalization
from surrogate.model.deformed import checked_background
from surrogate.model.places import ParameterPoint, place_of, transfer_place
from surrogate.model.rigid import in_camera, posed
from surrogate.rasterizer import Rasterizer, primitives

BLACK = (0.0, 0.0, 0.0)
Slope = tuple[float, bool]  # a derivative, and whether it is by a logarithm


class DifferentiableSurrogate(torch.nn.Module):
    """A surrogate as a torch module, made by `Surrogate.differentiable`.

    Its torch parameters are copies of the Gaussians' tensors (`means`, `log_scales`, `quats`, `opacity_logits`, and `colors` or
    `values`) and of the deformations'.  `requires_grad_(False)` saves their gradients where only those by the arguments are wanted.

    There are no gradients by the camera's intrinsics, a transfer function's control points, or the order of the Gaussians in
    depth.  Displacements of a function by tensors raise ValueError where the Gaussians carry values.  The kernels can be
    differentiated once.

    Examples
    --------
    >>> import torch
    >>> from blobs import CAMERA, make_run
    >>> from surrogate import Surrogate
    >>> model = Surrogate.load(make_run() / "surrogate").differentiable().requires_grad_(False)
    >>> parameters = torch.tensor([0.83, 0.27], requires_grad=True)  # in the order and units of surrogate.space
    >>> model(parameters, CAMERA).mean().backward()
    >>> float(parameters.grad[1]) > 0  # wider blobs fill more of the picture
    True
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
        transfer_function: TransferFunction | None = None,
        opacities: Tensor | None = None,
        colors: Tensor | None = None,
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
        transfer_function : any, as `Surrogate.under` takes it.
        opacities, colors : None, for Gaussians have no gradient by those of the function's control points.

        Raises ValueError as `at`, `under` and `render` do, and for a pose that is not rigid.  What lies behind the camera, or is
        not seen, has zero gradients.
        """
        behind = checked_background(background)
        if opacities is not None or colors is not None:
            raise ValueError(
                "pictures by Gaussians have no gradient by a function's control points: give all in `transfer_function`, or "
                'take pictures of `using("field")`'
            )
        gaussians = self.deformed(parameters, transfer_function)
        if pose is None:
            view = self.normalization.camera(camera)
            projected = primitives(gaussians, view)
        else:
            view = replace(posed(camera, pose), world_to_camera=np.eye(4))
            projected = in_camera(gaussians, self.normalization, pose)
        picture = self.rasterizer.draw_primitives(projected, gaussians, view, BLACK)  # [H, W, 4]
        return composited(picture, behind)

    def deformed(
        self, parameters: Tensor | Mapping[str, Any], transfer_function: TransferFunction | None = None
    ) -> Gaussians:
        """The Gaussians of one member, in normalized coordinates, differentiable as `forward` is."""
        named = named_tensors(self.space, parameters)
        numbers, among = numbers_of(named), (self.space, self._visualizations)
        if transfer_function is None:
            place = place_of(*among, numbers, "allow")
        else:
            carried = isinstance(self._gaussians, FieldGaussians)
            place = transfer_place(*among, numbers, transfer_function, "allow", carried=carried)
        self._check_differentiable(place, named)
        normalized = self._normalized(place, named).to(self._gaussians.means)  # [P + V]
        return place.deformed(self._gaussians, self._deformation, normalized)

    def __repr__(self) -> str:
        like = self._gaussians.means
        return f"<DifferentiableSurrogate of {self.space}: {len(self._gaussians):,} Gaussians, {like.dtype}, {like.device}>"

    def _registered(self, prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Copies of tensors as torch parameters of this module, under their names after a prefix."""
        own = {name: torch.nn.Parameter(tensor.detach().clone()) for name, tensor in tensors.items()}
        for name, parameter in own.items():
            self.register_parameter(prefix + name.replace(".", "_"), parameter)
        return dict(own)

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
        parts = [simulation_tensor(self.space, place.simulation, named, place.parameters)]
        if place.visualization is not None and place.settings is not None:
            variation = place.visualization.variation
            slopes = _visual_slopes(variation, place.parameters)
            parts.append(_follow(place.settings, variation.space.names, named, slopes))
        return torch.cat(parts)


def named_tensors(space: ParameterSpace, parameters: Any) -> dict[str, Any]:
    """Parameters by name, tensors among them of shape ().

    Raises ValueError for other shapes, or what is neither (P,) nor a mapping.
    """
    if isinstance(parameters, Mapping):
        named = dict(parameters)
    elif isinstance(parameters, Tensor) and parameters.shape == (len(space),):
        named = dict(zip(space.names, parameters.unbind(0), strict=True))
    else:
        raise ValueError(
            f"parameters must be a tensor of shape ({len(space)},), for {joined_names(space.names)}, or a mapping of names, "
            f"got {getattr(parameters, 'shape', type(parameters).__name__)}"
        )
    for name, value in named.items():
        if isinstance(value, Tensor) and value.numel() != 1:
            raise ValueError(f"parameter {name} must be one number, got shape {tuple(value.shape)}")
    return {n: v.reshape(()) if isinstance(v, Tensor) else v for n, v in named.items()}


def numbers_of(named: Mapping[str, Any]) -> dict[str, Any]:
    """The same with numbers instead of tensors."""
    return {n: float(v.detach()) if isinstance(v, Tensor) else v for n, v in named.items()}


def simulation_tensor(
    space: ParameterSpace, normalized: NDArray[np.float64], named: Mapping[str, Any], values: Mapping[str, Any]
) -> Tensor:
    """Normalized simulation parameters (P,) float64 of `values`, with the gradient by those that were `named` as tensors."""
    return _follow(normalized, space.names, named, _slopes(space, values))


def composited(picture: Tensor, background: NDArray[np.float32] | None) -> Tensor:
    """A picture (H, W, 4), premultiplied RGBA, on a background (3,), where there is one."""
    if background is None:
        return picture
    color = picture[..., :3] + (1.0 - picture[..., 3:]) * torch.from_numpy(background).to(picture)
    return torch.cat([color, torch.ones_like(picture[..., 3:])], dim=2)


def _follow(
    numbers: NDArray[np.float64], names: Sequence[str], named: Mapping[str, Any], slopes: Mapping[str, Slope]
) -> Tensor:
    """Normalized `numbers` as they are, with the derivatives that `slopes` give by the tensors among what was given."""
    rows = []
    for number, name in zip(numbers.tolist(), names, strict=True):
        value, row = named.get(name), torch.tensor(number, dtype=torch.float64)
        if isinstance(value, Tensor) and name in slopes:
            slope, is_logarithmic = slopes[name]
            moved = value.double().log() if is_logarithmic else value.double()
            row = row.to(moved.device) + slope * (moved - moved.detach())
        rows.append(row.cpu())
    return torch.stack(rows) if rows else torch.zeros(0, dtype=torch.float64)


def _slopes(space: ParameterSpace, values: Mapping[str, Any]) -> dict[str, Slope]:
    """The derivative of each normalized parameter by the parameter, or by its logarithm where True follows."""
    return {
        p.name: (2.0 / math.log(p.high / p.low), True) if p.scale == "log" else (2.0 / (p.high - p.low), False)
        for p in space.parameters
        if isinstance(values.get(p.name), int | float)
    }


def _visual_slopes(variation: Variation, values: Mapping[str, Any]) -> dict[str, Slope]:
    """The same for visualization parameters; of an isovalue that of the piece of its normalization, which is piecewise linear."""
    if not isinstance(variation, IsovalueVariation):
        return _slopes(variation.space, values)
    name = variation.space.names[0]
    trained = np.array(sorted(value for (value,) in variation.trained))  # [T]
    k = int(np.clip(np.searchsorted(trained, values[name], side="right"), 1, len(trained) - 1))
    return {name: (2.0 / (len(trained) - 1) / float(trained[k] - trained[k - 1]), False)}
