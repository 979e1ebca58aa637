"""Bilinear lookup in grids, shared by K-Planes and ViSNeRF."""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import grid_sample

from surrogate.training.loop import Diverged


def bilinear(grids: Tensor, at: Tensor) -> Tensor:
    """Grids (B, C, height, width) at (B, N, 2) in [-1, 1], across before down: (B, C, N).

    The corners are the centres of the outermost entries; values beyond are those of the border. Raises `Diverged` for
    coordinates that are not finite: torch (2.13, on a processor) would read outside its memory.
    """
    if at.isnan().any():
        raise Diverged("a field is evaluated at coordinates that are not finite: its training has diverged")
    values = grid_sample(grids, at[:, None], mode="bilinear", padding_mode="border", align_corners=True)  # [B, C, 1, N]
    return values.squeeze(2)
