"""Inputs and outputs of every backend: Gaussians, rendering constants, and the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from torch import Tensor

from catalogs.vocabulary.words import one_line


@dataclass(frozen=True)
class Constants:
    """Rendering constants, the same for every backend.

    Attributes
    ----------
    near : Gaussians with nearer centres, in world units along the camera's axis, are not drawn: the projection has a
        pole at 0.
    dilation : variance in pixels squared added to each projected Gaussian, so that none is infinitely thin. It makes them
        larger than they are, most in small pictures.
    alpha_floor : smaller alphas are left out, which bounds each Gaussian's extent; one step of an 8-bit image.
    alpha_cap : alphas are clipped to it, because an alpha of 1 would block all light and have no derivative; below 1.
    min_transmittance : pixels with a lower transmittance take no further Gaussian; at most a fortieth of an 8-bit step.
    frame_margin : the projection is linearised at most this fraction of the frame beyond its border, as by Kerbl et al. 2023.
    shortest_quaternion : a shorter one gives no rotation and no gradient.
    """

    near: float = 0.02
    dilation: float = 1e-4
    alpha_floor: float = 1.0 / 255.0
    alpha_cap: float = 0.999
    min_transmittance: ClassVar[float] = 1e-4
    frame_margin: ClassVar[float] = 0.15
    shortest_quaternion: ClassVar[float] = 1e-12


class Primitives(NamedTuple):
    """N Gaussians in constrained parameters, ready to be rendered.

    Attributes
    ----------
    means : (N, 3) centres, world units.
    scales : (N, 3) standard deviations along the axes, world units, positive.
    quats : (N, 4) rotations w, x, y, z, of any length.
    opacities : (N,) opacity at the centre, in [0, 1].
    colors : (N, 3) colours, not limited to [0, 1].
    """

    means: Tensor  # [N, 3]
    scales: Tensor  # [N, 3]
    quats: Tensor  # [N, 4]
    opacities: Tensor  # [N]
    colors: Tensor  # [N, 3]

    def __repr__(self) -> str:
        return one_line(self)


class Rendering(NamedTuple):
    """An image: premultiplied `color` (H, W, 3), `alpha` (H, W) and, if requested, premultiplied `depth` (H, W)."""

    color: Tensor  # [H, W, 3]
    alpha: Tensor  # [H, W]
    depth: Tensor | None = None  # [H, W], world units

    def __repr__(self) -> str:
        return one_line(self)

    def over(self, background: Sequence[float] | Tensor) -> Tensor:
        """The image (H, W, 3) over a background colour (3,)."""
        behind = background if isinstance(background, Tensor) else self.color.new_tensor(background)  # [3]
        return self.color + (1.0 - self.alpha).unsqueeze(-1) * behind
