"""What every backend takes and gives: Gaussians as they are drawn, the constants that define a picture, and the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from torch import Tensor

from catalogs.vocabulary.words import one_line


@dataclass(frozen=True)
class Constants:
    """What a picture of Gaussians depends on beside them and the camera; every backend draws by one such record.

    Attributes
    ----------
    near : Gaussians whose centre is nearer than this, in world units along the camera's axis, are not drawn: the projection has a
        pole at 0.
    dilation : variance in pixels squared added to each projected Gaussian, so that one smaller than a pixel is seen at all; it
        also makes such Gaussians larger than they are.  The usual 0.3 costs volumes a decibel, and ten at other sizes.
    alpha_floor : alphas below it are left out, which bounds each Gaussian's extent: one step of an 8-bit picture.
    alpha_cap : alphas are cut to it, because one of 1 would let nothing through and have no derivative; below 1.
    min_transmittance : a pixel that lets less light through takes no further Gaussian: at most a fortieth of an 8-bit step.
    frame_margin : the projection is linearised at most this fraction of the frame beyond its border, as by Kerbl et al. 2023.
    shortest_quaternion : a shorter one is no rotation, and has no gradient.
    """

    near: float = 0.02
    dilation: float = 0.003
    alpha_floor: float = 1.0 / 255.0
    alpha_cap: float = 0.999
    min_transmittance: ClassVar[float] = 1e-4
    frame_margin: ClassVar[float] = 0.15
    shortest_quaternion: ClassVar[float] = 1e-12


class Primitives(NamedTuple):
    """N Gaussians as they are drawn.

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
    """A picture: premultiplied `color` (H, W, 3), `alpha` (H, W) and, where asked for, premultiplied `depth` (H, W)."""

    color: Tensor  # [H, W, 3]
    alpha: Tensor  # [H, W]
    depth: Tensor | None = None  # [H, W], world units

    def __repr__(self) -> str:
        return one_line(self)

    def over(self, background: Sequence[float] | Tensor) -> Tensor:
        """The picture (H, W, 3) over a background colour (3,)."""
        behind = background if isinstance(background, Tensor) else self.color.new_tensor(background)  # [3]
        return self.color + (1.0 - self.alpha).unsqueeze(-1) * behind
