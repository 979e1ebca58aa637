"""Splatting of Gaussians to an image: one signature for every backend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from types import ModuleType
from typing import Any

import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import joined_names
from surrogate.splatting import cpu, cuda, reference
from surrogate.splatting.rendering import Constants, Primitives, Rendering

__all__ = ["BACKENDS", "Constants", "Primitives", "Rendering", "draw", "draw_over", "render"]

BACKENDS: dict[str, ModuleType] = {"cpu": cpu, "cuda": cuda, "reference": reference}
AUTO = "auto"  # the backend of the device that holds the Gaussians


def render(
    means: Tensor, scales: Tensor, quats: Tensor, opacities: Tensor, colors: Tensor, camera: Camera, **options: Any
) -> Rendering:
    """Render N Gaussians as seen by `camera`; differentiable in all five tensors.

    Parameters
    ----------
    means, scales, quats, opacities, colors : (N, 3), (N, 3), (N, 4), (N,), (N, 3), as in `Primitives`.
    options : fields of `Constants`, such as `near` and `dilation`; `backend`, `depth` and others of `draw`.

    Returns
    -------
    Rendering of premultiplied colour (H, W, 3), alpha (H, W) and, with `depth`, premultiplied depth (H, W). Divided by
    alpha, it is the mean depth of a pixel. Depth costs a second rendering pass.

    For a gradient by the camera's pose, move the Gaussians by a rigid motion R, t in torch. Render the means R means +
    t with the quaternions multiplied by that of R.

    Sorting by centres is an approximation: Gaussians that interpenetrate are not integrated along the ray.

    Examples
    --------
    >>> import torch
    >>> from catalogs import Camera
    >>> from surrogate import render
    >>> camera = Camera.look_at((0, -4, 0), (0, 0, 0), vertical_fov_degrees=30, width=64, height=64)
    >>> means, quats = torch.zeros(1, 3), torch.tensor([[1.0, 0.0, 0.0, 0.0]])
    >>> drawn = render(means, torch.full((1, 3), 0.2), quats, torch.tensor([0.9]), torch.tensor([[1.0, 0.5, 0.0]]), camera)
    >>> f"{drawn.alpha[32, 32]:.2f}"
    '0.89'
    """
    chosen = {field.name: options.pop(field.name) for field in fields(Constants) if field.name in options}
    return draw(Primitives(means, scales, quats, opacities, colors), camera, Constants(**chosen), **options)


def draw(
    primitives: Primitives,
    camera: Camera,
    constants: Constants,
    *,
    backend: str = AUTO,
    depth: bool = False,
    **options: Any,
) -> Rendering:
    """Render Gaussians and constants in records; see `render`.

    Parameters
    ----------
    backend : "cpu" (C++ kernels, float32), "cuda" (gsplat, float32; see `surrogate.splatting.cuda` for the
        differences), "reference" or "auto". The reference is plain torch in the dtype of the means: slow, but it
        defines the result. "auto" is "cuda" for tensors on a GPU, otherwise "cpu".
    depth : also return the depth of the centres along the camera's axis, in world units, composited like a colour.
    options : `threads` and `instruction_set` of cpu; `edges` of cpu and reference, True for gradients that hold what
        passes the alpha floor, which those of single pixels do not.
    """
    chosen = _backend(backend, primitives.means)
    rendering = chosen.render(primitives, camera, constants, **options)
    if not depth:
        return rendering
    as_colors = primitives._replace(colors=_depths(primitives.means, camera)[:, None].expand(-1, 3))
    return rendering._replace(depth=chosen.render(as_colors, camera, constants, **options).color[..., 0])


def draw_over(
    primitives: Primitives,
    camera: Camera,
    background: Sequence[float],
    constants: Constants,
    *,
    backend: str = AUTO,
    **options: Any,
) -> Tensor:
    """The image of `draw` over a `background` colour (3,), with alpha as its fourth channel: (H, W, 4).

    Training compares these images. The result equals `Rendering.over` and a concatenation, but the cpu backend writes
    it, and reads its gradient, in one pass.
    """
    chosen = _backend(backend, primitives.means)
    if chosen is cpu:
        return cpu.render_over(primitives, camera, background, constants, **options)
    rendering = chosen.render(primitives, camera, constants, **options)
    return torch.cat([rendering.over(background), rendering.alpha.unsqueeze(-1)], dim=2)


def _backend(name: str, means: Tensor) -> ModuleType:
    if name == AUTO:
        return cuda if means.is_cuda else cpu
    if name not in BACKENDS:
        raise ValueError(f"backend must be one of {joined_names([AUTO, *sorted(BACKENDS)])}, got {name!r}")
    return BACKENDS[name]


def _depths(means: Tensor, camera: Camera) -> Tensor:
    """Depth of each centre along the camera's axis, (N,); in float64, and finite however far away the centre is."""
    axis = torch.tensor(camera.forward, device=means.device)  # [3]
    depths = means.double() @ axis + float(camera.world_to_camera[2, 3])  # [N]
    return depths.clamp(-torch.finfo(means.dtype).max, torch.finfo(means.dtype).max).to(means.dtype)
