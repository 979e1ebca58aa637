"""What every backend takes and gives: Gaussians as they are drawn, and the picture of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from torch import Tensor

from catalogs.words import one_line


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
