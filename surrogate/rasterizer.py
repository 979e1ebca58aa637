"""How Gaussians become pictures, with the constants of the rasterizer: the same in training and afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import torch
from torch import Tensor

from catalogs.cameras import Camera
from catalogs.numbers import finite, positive
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings
from surrogate.splatting import AUTO, BACKENDS, Constants, Primitives, Rendering, draw, draw_over


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
        """The rasterizer that `to_json` described; raises ValueError naming a value that is unknown or can't be."""
        if unknown := sorted(set(values) - {"backend", *(each.name for each in fields(Constants))}):
            raise ValueError(f"unknown values {unknown}")
        constants = Constants(**{name: finite(value, name) for name, value in values.items() if name != "backend"})
        positive(constants.near, "near")
        if not constants.dilation >= 0.0:
            raise ValueError(f"dilation must not be negative, got {constants.dilation:g}")
        if not 0.0 <= constants.alpha_floor < constants.alpha_cap < 1.0:
            raise ValueError(
                f"alpha_floor and alpha_cap must lie in this order in [0, 1), got {constants.alpha_floor:g} and "
                f"{constants.alpha_cap:g}"
            )
        backend = values.get("backend", AUTO)
        if backend not in (AUTO, *BACKENDS):
            raise ValueError(f"backend must be one of {[AUTO, *sorted(BACKENDS)]}, got {backend!r}")
        return cls(constants, backend)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values: the constants and the backend."""
        return asdict(self.constants) | {"backend": self.backend}

    def for_any_device(self) -> Rasterizer:
        """The same, which draws also what has left the GPU, as a model does that is stored."""
        return replace(self, backend=AUTO) if self.backend == "cuda" else self

    def draw(self, gaussians: Gaussians, camera: Camera, *, threads: int | None = None) -> Rendering:
        """Premultiplied colour (H, W, 3) and alpha (H, W) of `gaussians`; `camera` in their coordinates.

        `threads` are those of the backend cpu, by default one for each core; the picture is the same.
        """
        options: dict[str, Any] = (
            {"threads": threads} if self.backend in (AUTO, "cpu") and not gaussians.means.is_cuda else {}
        )
        seen = primitives(gaussians, camera, threads=threads)
        return draw(seen, camera, self.constants, backend=self.backend, **options)

    def draw_over(self, gaussians: Gaussians, camera: Camera, background: Sequence[float]) -> Tensor:
        """What training compares: colours over `background` (3,) and alpha, (H, W, 4)."""
        return draw_over(primitives(gaussians, camera), camera, background, self.constants, backend=self.backend)


def primitives(gaussians: Gaussians, camera: Camera, *, threads: int | None = None) -> Primitives:
    """The Gaussians as they are drawn: their colours and opacities as `camera` sees them."""
    position = torch.from_numpy(camera.position).to(gaussians.means)  # [3]
    colors = gaussians.colors_from(position, threads=threads)  # [N, 3]
    opacities = gaussians.opacities_from(position, threads=threads)  # [N]
    return Primitives(gaussians.means, gaussians.scales(), gaussians.quats, opacities, colors)
