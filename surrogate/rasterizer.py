"""The rasterizer of a model and its constants, the same in training and afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import finite, positive
from catalogs.vocabulary.words import joined_names
from surrogate.gaussians import Gaussians
from surrogate.settings import MOST_SAMPLES, TrainingSettings
from surrogate.splatting import AUTO, BACKENDS, Constants, Primitives, Rendering, draw, draw_over
from surrogate.splatting.samples import averaged, finer

SAMPLES = ("samples", "surface_samples")


@dataclass(frozen=True)
class Rasterizer:
    """Settings of drawing; a model is only right with those it was trained with.

    Attributes
    ----------
    constants : in normalized units.
    backend : that draws.
    samples, surface_samples : along each side of a pixel, see `surrogate.splatting.samples`; the second on lit surfaces.
    edges : True for gradients that hold what passes the alpha floor, see `surrogate.splatting.draw`; training has none of it.
    """

    constants: Constants = field(default_factory=Constants)
    backend: str = AUTO
    samples: int = 1
    surface_samples: int = 1
    edges: bool = False

    @classmethod
    def of(cls, settings: TrainingSettings) -> Rasterizer:
        """The rasterizer of some settings."""
        return cls(backend=settings.backend, samples=settings.samples, surface_samples=settings.surface_samples)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Rasterizer:
        """The rasterizer that `to_json` described; raises ValueError naming a value that is unknown or can't be."""
        names = {each.name for each in fields(Constants)}
        if unknown := sorted(set(values) - {"backend", *SAMPLES, *names}):
            raise ValueError(f"unknown values {joined_names(unknown)}")
        constants = Constants(**{name: finite(value, name) for name, value in values.items() if name in names})
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
            raise ValueError(f"backend must be one of {joined_names([AUTO, *sorted(BACKENDS)])}, got {backend!r}")
        samples = {name: values[name] for name in SAMPLES}
        for name, number in samples.items():
            if type(number) is not int or not 1 <= number <= MOST_SAMPLES:
                raise ValueError(f"{name} must be an integer from 1 to {MOST_SAMPLES}, got {number!r}")
        return cls(constants, backend, **samples)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self.constants) | {"backend": self.backend} | {name: getattr(self, name) for name in SAMPLES}

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
        samples, projected = self._samples_of(gaussians), primitives(gaussians, camera, threads=threads)
        image = draw(projected, finer(camera, samples), self.constants, backend=self.backend, **options)
        return Rendering(*(averaged(part, samples) for part in (image.color, image.alpha)))

    def draw_over(self, gaussians: Gaussians, camera: Camera, background: Sequence[float]) -> Tensor:
        """The picture that training compares: colours over `background` (3,) and alpha, (H, W, 4)."""
        return self.draw_primitives(primitives(gaussians, camera), gaussians, camera, background)

    def draw_primitives(
        self, projected: Primitives, gaussians: Gaussians, camera: Camera, background: Sequence[float]
    ) -> Tensor:
        """The same of `gaussians`, `projected` to the coordinates of `camera`."""
        samples = self._samples_of(gaussians)
        options: dict[str, Any] = {"edges": True} if self.edges and not projected.means.is_cuda else {}
        picture = draw_over(
            projected, finer(camera, samples), background, self.constants, backend=self.backend, **options
        )
        return averaged(picture, samples)

    def _samples_of(self, gaussians: Gaussians) -> int:
        return self.samples if gaussians.lighting is None else self.surface_samples


def primitives(gaussians: Gaussians, camera: Camera, *, threads: int | None = None) -> Primitives:
    """The Gaussians as they are drawn: their colours and opacities as `camera` sees them."""
    position = torch.from_numpy(camera.position).to(gaussians.means)  # [3]
    colors = gaussians.colors_from(position, threads=threads)  # [N, 3]
    opacities = gaussians.opacities_from(position, threads=threads)  # [N]
    return Primitives(gaussians.means, gaussians.scales(), gaussians.quats, opacities, colors)
