"""How Gaussians become pictures, with the constants of the rasterizer: the same in training and afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import torch
from torch import Tensor

from catalogs.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings
from surrogate.splatting import AUTO, Rendering, render, render_over
from surrogate.splatting.rendering import ALPHA_CAP, DILATION


@dataclass(frozen=True)
class Rasterizer:
    """Constants of `surrogate.splatting.render`; a model is only right with those it was trained with.

    Attributes
    ----------
    near : depth below which a Gaussian is not drawn, in normalized units.
    dilation : variance added to every projected Gaussian, in pixels squared.
    alpha_floor : alphas below this are not drawn.
    alpha_cap : alphas above this are cut to it.
    backend : which implementation draws.
    """

    near: float = 0.02
    dilation: float = DILATION
    alpha_floor: float = 1.0 / 255.0
    alpha_cap: float = ALPHA_CAP
    backend: str = AUTO

    @classmethod
    def of(cls, settings: TrainingSettings) -> Rasterizer:
        """The rasterizer that `settings` ask for."""
        return cls(
            dilation=settings.dilation,
            alpha_floor=settings.alpha_floor,
            alpha_cap=settings.alpha_cap,
            backend=settings.backend,
        )

    def for_any_device(self) -> Rasterizer:
        """The same, which draws also what has left the GPU, as a model does that is stored."""
        return replace(self, backend=AUTO) if self.backend == "cuda" else self

    def draw(self, gaussians: Gaussians, camera: Camera) -> Rendering:
        """Premultiplied colour (H, W, 3) and alpha (H, W) of `gaussians`; `camera` in their coordinates."""
        return render(*_seen(gaussians, camera), camera, **self._constants())

    def draw_over(self, gaussians: Gaussians, camera: Camera, background: Sequence[float]) -> Tensor:
        """What training compares: colours over `background` (3,) and alpha, (H, W, 4)."""
        return render_over(*_seen(gaussians, camera), camera, background, **self._constants())

    def _constants(self) -> dict[str, Any]:
        return {
            "near": self.near,
            "dilation": self.dilation,
            "alpha_floor": self.alpha_floor,
            "alpha_cap": self.alpha_cap,
            "backend": self.backend,
        }

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values: the keyword arguments that make it again."""
        return asdict(self)


def _seen(gaussians: Gaussians, camera: Camera) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """The Gaussians as `render` takes them."""
    position = torch.from_numpy(camera.position).to(gaussians.means)  # [3]
    colors = gaussians.colors_from(position)  # [N, 3]
    return gaussians.means, gaussians.scales(), gaussians.quats, gaussians.opacities(), colors
