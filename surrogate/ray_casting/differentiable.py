"""Volume renderings that torch differentiates, by the field's values and by the transfer function's control points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native import kernels
from native.ray_casting.fields import SampledField, Triple
from native.ray_casting.functions import Knots, drawn_range
from native.ray_casting.volume import checked_distance, drawn_values
from native.threads import cores
from surrogate.derivatives import require_no_second_derivative


def volume_image(
    values: Tensor,
    holes: NDArray[np.bool_] | None,
    spacing: Triple,
    origin: Triple,
    appearance: VolumeRendering,
    camera: Camera,
    *,
    opacities: Tensor | None = None,
    colors: Tensor | None = None,
    sample_distance: float | None = None,
    threads: int | None = None,
) -> Tensor:
    """`draw_volume` as a function that torch can differentiate once: premultiplied RGBA (height, width, 4), float32.

    Parameters
    ----------
    values : (nz, ny, nx) on a CPU; values in holes have no gradient.
    opacities, colors : (P,) and (Q, 3), in place of those of the function's control points, whose values stay.

    Raises ValueError for a shaded volume, which `surrogate.ray_casting.reference` differentiates.

    Examples
    --------
    >>> import torch
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from surrogate.ray_casting import volume_image
    >>> values = torch.from_numpy(simulate(0.8, 0.3)).float().requires_grad_()
    >>> volume_image(values, None, **PLACE, appearance=APPEARANCE, camera=CAMERA).mean().backward()
    >>> values.grad.shape
    torch.Size([24, 24, 24])
    """
    if appearance.shaded:
        raise ValueError(
            f"appearance {appearance.name!r} is shaded, and the kernels differentiate volumes without shading only: "
            "apply draw_volume_reference, which torch differentiates"
        )
    field = SampledField(values.detach().numpy(), holes, spacing, origin)
    transfer = appearance.transfer_function
    value_range = drawn_range(field.range, transfer)
    knots = Knots.of(transfer, value_range)
    distances = checked_distance(field, sample_distance), transfer.opacity_unit_distance
    view = _View(field, value_range, knots.places, distances, camera, cores() if threads is None else threads)
    own_opacities, own_colors = (
        torch.tensor(p, dtype=torch.float64)[:, 1:] for p in (transfer.opacity_points, transfer.color_points)
    )
    nodes = torch.cat(
        [
            torch.from_numpy(knots.of_opacities)
            @ (own_opacities if opacities is None else opacities.double()[:, None]),
            torch.from_numpy(knots.of_colors) @ (own_colors if colors is None else colors.double()),
        ],
        dim=1,
    )  # [K, 4]
    image: Tensor = _VolumeImage.apply(view, values, nodes)
    return image


@dataclass(frozen=True, eq=False)
class _View:
    field: SampledField
    value_range: tuple[float, float]
    places: NDArray[np.float64]  # [K]
    distances: tuple[float, float]
    camera: Camera
    threads: int

    def table(self, nodes: Tensor) -> NDArray[np.float64]:
        return np.concatenate([self.places[:, None], nodes.detach().numpy()], axis=1)


class _VolumeImage(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, view: _View, values: Tensor, nodes: Tensor) -> Tensor:
        samples, within = drawn_values(view.field, view.value_range, needs_neighbours=False)
        ctx.view, ctx.dtype = view, values.dtype
        ctx.samples = kernels.cast_field(samples, view.field.holes, *within, view.threads)
        size = view.camera.width, view.camera.height
        rays = view.field.rays(view.camera)
        image = torch.from_numpy(
            kernels.cast_volume(ctx.samples, view.table(nodes), view.distances, None, rays, size, view.threads)
        )
        ctx.save_for_backward(nodes, image)
        return image

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        require_no_second_derivative("volume_image", "draw_volume_reference")
        view: _View = ctx.view
        nodes, image = ctx.saved_tensors
        by_values, by_shown = kernels.cast_gradient(
            ctx.samples,
            view.table(nodes),
            view.distances,
            view.field.rays(view.camera),
            image.numpy(),
            gradients[0].contiguous().numpy(),
            ctx.needs_input_grad[2],
            view.threads,
        )
        low, high = view.value_range
        return None, torch.from_numpy(by_values).to(ctx.dtype) / (high - low), torch.from_numpy(by_shown)
