"""What every splatting backend returns, and the constants that define it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from torch import Tensor

ALPHA_CAP = 0.999  # no Gaussian hides everything behind it; where the cap holds, alpha has no gradient
DILATION = 0.003  # px^2: the usual 0.3 costs volumes a decibel, and ten at other sizes (docs/volume_fidelity.md)
MIN_TRANSMITTANCE = 1e-4  # a pixel that lets less through takes no further Gaussian
FRAME_MARGIN = 0.15  # the projection is linearised at most this fraction of the frame beyond its border
SHORTEST_QUATERNION = 1e-12  # a shorter one is no rotation


class Rendering(NamedTuple):
    """A picture: premultiplied `color` (H, W, 3), `alpha` (H, W) and, where asked for, premultiplied `depth` (H, W)."""

    color: Tensor  # [H, W, 3]
    alpha: Tensor  # [H, W]
    depth: Tensor | None = None  # [H, W], world units

    def over(self, background: Sequence[float] | Tensor) -> Tensor:
        """The picture (H, W, 3) over a background colour (3,)."""
        behind = background if isinstance(background, Tensor) else self.color.new_tensor(background)  # [3]
        return self.color + (1.0 - self.alpha).unsqueeze(-1) * behind
