"""How Gaussians become pictures, with the constants of the rasterizer: the same in training and afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from catalogs.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings
from surrogate.splatting import AUTO, Constants, Primitives, Rendering, draw, draw_over


@dataclass(frozen=True)
class Rasterizer:
    """Constants in normalized units, and the backend that draws; a model is only right with those it was trained with."""

    constants: Constants = field(default_factory=Constants)
    backend: str = AUTO

    @classmethod
    def of(cls, settings: TrainingSettings) -> Rasterizer:
        """The rasterizer that `settings` ask for."""
        chosen = asdict(settings.splatting)
        backend = chosen.pop("backend")
        return cls(Constants(**chosen), backend)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Rasterizer:
        """The rasterizer that `to_json` described; raises TypeError where a value is unknown."""
        constants = {name: value for name, value in values.items() if name != "backend"}
        return cls(Constants(**constants), values.get("backend", AUTO))

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values: the constants and the backend."""
        return asdict(self.constants) | {"backend": self.backend}

    def for_any_device(self) -> Rasterizer:
        """The same, which draws also what has left the GPU, as a model does that is stored."""
        return replace(self, backend=AUTO) if self.backend == "cuda" else self

    def draw(self, gaussians: Gaussians, camera: Camera) -> Rendering:
        """Premultiplied colour (H, W, 3) and alpha (H, W) of `gaussians`; `camera` in their coordinates."""
        return draw(primitives(gaussians, camera), camera, self.constants, backend=self.backend)

    def draw_over(self, gaussians: Gaussians, camera: Camera, background: Sequence[float]) -> Tensor:
        """What training compares: colours over `background` (3,) and alpha, (H, W, 4)."""
        return draw_over(primitives(gaussians, camera), camera, background, self.constants, backend=self.backend)


def primitives(gaussians: Gaussians, camera: Camera) -> Primitives:
    """The Gaussians as they are drawn: their colours as `camera` sees them."""
    position = torch.from_numpy(camera.position).to(gaussians.means)  # [3]
    colors = gaussians.colors_from(position)  # [N, 3]
    return Primitives(gaussians.means, gaussians.scales(), gaussians.quats, gaussians.opacities(), colors)
