"""How Gaussians become pictures, with the constants of the rasterizer: the same in training and afterwards."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch

from catalogs.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings
from surrogate.splatting import Rendering, render


@dataclass(frozen=True)
class Rasterizer:
    """Constants of `surrogate.splatting.render`; a model is only right with those it was trained with.

    Attributes
    ----------
    near : depth below which a Gaussian is not drawn, in normalized units.
    dilation : variance added to every projected Gaussian, in pixels squared.
    alpha_floor : alphas below this are not drawn.
    backend : which implementation draws.
    """

    near: float = 0.02
    dilation: float = 0.1
    alpha_floor: float = 1.0 / 255.0
    backend: str = "cpu"

    @classmethod
    def of(cls, settings: TrainingSettings) -> Rasterizer:
        """The rasterizer that `settings` ask for."""
        return cls(dilation=settings.dilation, alpha_floor=settings.alpha_floor, backend=settings.backend)

    def draw(self, gaussians: Gaussians, camera: Camera) -> Rendering:
        """Premultiplied colour (H, W, 3) and alpha (H, W) of `gaussians`; `camera` in their coordinates."""
        position = torch.from_numpy(camera.position).to(gaussians.means)  # [3]
        return render(
            gaussians.means,
            gaussians.scales(),
            gaussians.quats,
            gaussians.opacities(),
            gaussians.colors_from(position),
            camera,
            near=self.near,
            dilation=self.dilation,
            alpha_floor=self.alpha_floor,
            backend=self.backend,
        )

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values: the keyword arguments that make it again."""
        return asdict(self)
