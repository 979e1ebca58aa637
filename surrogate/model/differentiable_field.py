"""Pictures of an emulated field that have gradients, and modules that draw by what `Surrogate.at` would draw by."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.holes import continued
from catalogs.vocabulary.words import joined_names
from surrogate.derivatives import require_no_second_derivative
from surrogate.emulation import FieldEmulator
from surrogate.model.deformed import checked_background
from surrogate.model.differentiable import (
    DifferentiableSurrogate,
    composited,
    named_tensors,
    numbers_of,
    simulation_tensor,
)
from surrogate.model.emulated_member import EmulatedMember
from surrogate.model.field_model import FieldModel, FieldPoint
from surrogate.model.representation import FIELD, GAUSSIANS
from surrogate.model.rigid import posed
from surrogate.ray_casting import volume_image
from surrogate.ray_casting.reference import draw_volume_reference

OF_GAUSSIANS = 'detach it, or take pictures of `using("gaussians")`'


class DifferentiableField(torch.nn.Module):
    """An emulated field as a torch module, made by `Surrogate.differentiable`; it has no torch parameters.

    Volume renderings have gradients by the simulation's parameters, and by opacities and colours of a transfer function's control
    points: the emulator's derivative times the ray caster's.  Isosurfaces have none, nor has the camera's pose, nor has a field
    whose holes move.  In float32 it draws by the kernels, which differentiate volumes without shading; in float64 by torch.
    """

    def __init__(self, field: FieldModel, dtype: torch.dtype) -> None:
        super().__init__()
        self.space, self.field, self.dtype = field.space, field, dtype

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
        parameters, background : as `DifferentiableSurrogate.forward` takes them.
        pose : (4, 4) world to camera, rigid, instead of the camera's; without a gradient.
        transfer_function : any, as `Surrogate.under` takes it.
        opacities, colors : (P,) and (Q, 3), each in [0, 1], in place of those of the function's control points.

        Raises ValueError as `at` and `under` do, and for a gradient that there is none of.
        """
        behind = checked_background(background)
        named = named_tensors(self.space, parameters)
        point = self.field.point(numbers_of(named), "allow", transfer_function)
        if opacities is not None or colors is not None:
            point = _with_control_points(point, opacities, colors)
        member = self.field.member(point)
        tensors = {**named, "pose": pose, "opacities": opacities, "colors": colors}
        wanted = [
            n for n, v in tensors.items() if isinstance(v, Tensor) and v.requires_grad and torch.is_grad_enabled()
        ]
        self._require_gradients(member, wanted)
        view = camera if pose is None else posed(camera, pose)
        if not isinstance(point.appearance, VolumeRendering) or point.appearance.shaded > (self.dtype == torch.float64):
            picture = torch.from_numpy(member.picture(view, None)).to(self.dtype)
        else:
            normalized = simulation_tensor(self.space, point.simulation, named, point.parameters)
            values: Tensor = _EmulatedValues.apply(member.emulator, member.samples.values, normalized, self.dtype)
            picture = _image(member, point.appearance, values, view, {"opacities": opacities, "colors": colors})
        return composited(picture, behind)

    def __repr__(self) -> str:
        return f"<DifferentiableField of {self.space}: {joined_names(self.field.labels())}, {self.dtype}>"

    def _require_gradients(self, member: EmulatedMember, wanted: Sequence[str]) -> None:
        """Raise ValueError where one of the gradients that are `wanted` does not exist."""
        if not wanted:
            return
        appearance, moves = member.appearance, set(wanted) & set(self.space.names)
        if not isinstance(appearance, VolumeRendering):
            raise ValueError(
                f"{appearance.name!r} is an isosurface, whose pictures from the emulated field have no gradients: {OF_GAUSSIANS}"
            )
        if strange := [n for n in wanted if n not in (*self.space.names, "opacities", "colors")]:
            raise ValueError(
                f"pictures from the emulated field have gradients by {joined_names(self.space.names)}, `opacities` and `colors` "
                f"alone, not by {joined_names(strange)}: {OF_GAUSSIANS}"
            )
        if moves and member.emulator.outline is not None:
            raise ValueError(
                "the field's holes move with the parameters, and pictures from the emulated field have no gradient by that: "
                f"{OF_GAUSSIANS}"
            )
        if appearance.shaded and self.dtype != torch.float64:
            raise ValueError(
                f"{appearance.name!r} is shaded, and pictures from the emulated field then have gradients in float64 alone: "
                "`differentiable(dtype=torch.float64)`"
            )


class DifferentiableChoice(torch.nn.Module):
    """Gaussians and an emulated field as one torch module: what `Surrogate.at` would draw by draws, or both.

    `drawn_by` is `Surrogate.drawn_by`.  Torch parameters are those of
    `gaussians`.
    """

    def __init__(
        self,
        gaussians: DifferentiableSurrogate,
        field: DifferentiableField,
        drawn_by: Callable[..., str],
    ) -> None:
        super().__init__()
        self.gaussians, self.field, self._drawn_by = gaussians, field, drawn_by

    def forward(self, parameters: Tensor | Mapping[str, Any], camera: Camera, **options: Any) -> Tensor:
        """The picture (H, W, 4) that `at(...).render(camera)` shows, before it is cut to [0, 1] unless it is a mean.

        Options are those of `DifferentiableField.forward`.  Raises ValueError as the module does that draws.
        """
        under = any(options.get(name) is not None for name in ("transfer_function", "opacities", "colors"))
        drawn_by = self._drawn_by(parameters if isinstance(parameters, Mapping) else (), under=under)
        if drawn_by in (GAUSSIANS, FIELD):
            picture: Tensor = (self.gaussians if drawn_by == GAUSSIANS else self.field)(parameters, camera, **options)
            return picture
        first, second = (m(parameters, camera, **options).clamp(0.0, 1.0) for m in (self.gaussians, self.field))
        return 0.5 * (first + second)

    def __repr__(self) -> str:
        return f"<DifferentiableChoice of {self.gaussians!r} and {self.field!r}>"


class _EmulatedValues(torch.autograd.Function):
    """The emulated `values` (Z, Y, X) at a normalized point (P,), in a dtype, with their derivative by the point."""

    @staticmethod
    def forward(
        ctx: Any, emulator: FieldEmulator, values: NDArray[np.float32], point: Tensor, dtype: torch.dtype
    ) -> Tensor:
        ctx.emulator, ctx.point = emulator, point.detach().numpy()
        return torch.from_numpy(values.copy()).to(dtype)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        require_no_second_derivative("an emulated field", "")
        if not ctx.needs_input_grad[2]:
            return None, None, None, None
        slopes = torch.from_numpy(ctx.emulator.derivative(ctx.point))  # [P, Z, Y, X]
        return None, None, torch.tensordot(slopes.double(), gradients[0].double(), 3), None


def _image(
    member: EmulatedMember,
    appearance: VolumeRendering,
    values: Tensor,
    camera: Camera,
    control_points: Mapping[str, Any],
) -> Tensor:
    """The picture of emulated values (Z, Y, X): by the kernels, or by torch where they are float64."""
    samples = member.samples
    if values.dtype == torch.float32:
        place = samples.spacing, samples.origin
        return volume_image(
            values, samples.holes, *place, appearance, camera, sample_distance=member.distance, **control_points
        )
    if samples.holes is not None:  # where light takes the values that they are filled with
        sources = continued(np.arange(samples.values.size).reshape(samples.values.shape), samples.holes)
        values = values.reshape(-1)[torch.from_numpy(sources)]
    return draw_volume_reference(
        samples, appearance, camera, sample_distance=member.distance, values=values, **control_points
    )


def _with_control_points(point: FieldPoint, opacities: Tensor | None, colors: Tensor | None) -> FieldPoint:
    """The point with other opacities (P,) and colours (Q, 3) of its transfer function; raises ValueError for other shapes."""
    appearance = point.appearance
    if not isinstance(appearance, VolumeRendering):
        raise ValueError(f"{appearance.name!r} is drawn by isosurfaces, which have no transfer function")
    function = appearance.transfer_function
    shapes = {"opacities": (len(function.opacity_points),), "colors": (len(function.color_points), 3)}
    for (name, shape), tensor in zip(shapes.items(), (opacities, colors), strict=True):
        if tensor is not None and (not isinstance(tensor, Tensor) or tuple(tensor.shape) != shape):
            got = tuple(tensor.shape) if isinstance(tensor, Tensor) else type(tensor).__name__
            raise ValueError(f"{name} must be a tensor of shape {shape}, for the function's control points, got {got}")
    opacity_points, color_points = function.opacity_points, function.color_points
    if opacities is not None:
        opacity_points = tuple((v, o) for (v, _), o in zip(opacity_points, opacities.tolist(), strict=True))
    if colors is not None:
        color_points = tuple((p[0], *rgb) for p, rgb in zip(color_points, colors.tolist(), strict=True))
    changed = TransferFunction(color_points, opacity_points, function.opacity_unit_distance)
    return replace(point, appearance=replace(appearance, transfer_function=changed), sample_distance=None)
