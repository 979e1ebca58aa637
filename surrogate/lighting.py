"""Lighting of isosurfaces, known from the catalog, so that Gaussians learn only the orientation of their surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.appearance import Appearance, Isosurface
from catalogs.vocabulary.numbers import finite, fraction, row
from catalogs.vocabulary.words import joined_names
from native import kernels
from native.threads import cores
from surrogate.splatting.directional import directions
from surrogate.splatting.kernel_function import KernelFunction, kernel_takes

STRENGTHS = ("ambient", "diffuse", "specular", "specular_power")
LEAST_FACING = 1e-6  # a power of a smaller number may have no finite derivative
CLOSE, MOSTLY = (
    8.0 / 255.0,
    0.9,
)  # how far a pixel may be from every colour of a lit surface, and how many must be so near


@dataclass(frozen=True)
class Lighting:
    """A surface of one colour under a headlight at the eye, seen from both sides (Blinn-Phong, as `Isosurface` says).

    Attributes
    ----------
    color : straight RGB of the surface.
    ambient, diffuse, specular, specular_power : the light's, not negative.
    """

    color: tuple[float, float, float]
    ambient: float
    diffuse: float
    specular: float
    specular_power: float

    @classmethod
    def of(cls, appearances: Sequence[Appearance]) -> Lighting | None:
        """The common lighting of all appearances; None where they are not all isosurfaces, or are lit differently."""
        surfaces = [a for a in appearances if isinstance(a, Isosurface)]
        lightings = {cls(a.color, *(float(getattr(a, name)) for name in STRENGTHS)) for a in surfaces}
        return lightings.pop() if len(lightings) == 1 and len(surfaces) == len(appearances) else None

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Lighting:
        """The lighting described by `to_json` values; raises ValueError for an invalid strength or colour."""
        if set(values) != {"color", *STRENGTHS}:
            raise ValueError(
                f"lighting must consist of {joined_names(['color', *STRENGTHS])}, got {joined_names(sorted(values))}"
            )
        red, green, blue = (fraction(c, "lighting color") for c in row(values["color"], 3, "lighting color"))
        strengths = {name: finite(values[name], f"lighting {name}") for name in STRENGTHS}
        for name, strength in strengths.items():
            if strength < 0.0:
                raise ValueError(f"lighting {name} must not be negative, got {strength:g}")
        return cls((red, green, blue), **strengths)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {**asdict(self), "color": list(self.color)}

    def colors(self, normals: Tensor, directions: Tensor) -> Tensor:
        """Straight RGB (N, 3), at most 1, of surfaces with `normals` (N, 3) seen along unit `directions` (N, 3).

        A normal shorter than 1 means a surface of mixed orientations: it is shaded as dark as one that faces away.
        """
        facing = (normals * directions).sum(dim=1, keepdim=True).abs().clamp(LEAST_FACING, 1.0)  # [N, 1]
        color = normals.new_tensor(self.color)  # [3]
        shade = (self.ambient + self.diffuse * facing) * color + self.specular * facing**self.specular_power  # [N, 3]
        return shade.clamp(max=1.0)

    def colors_from(self, means: Tensor, normals: Tensor, position: Tensor, *, threads: int | None = None) -> Tensor:
        """`colors` (N, 3) at `means` (N, 3) as seen from `position` (3,), where only ambient light is at the very place.

        Differentiable by means and normals.  On a CPU in float32 the kernel does it, else `colors`, and also where a gradient by
        `position` is asked for.
        """
        if not kernel_takes(position, means, normals):
            return self.colors(normals, directions(means, position))
        light = *self.color, *(getattr(self, name) for name in STRENGTHS)
        place, count = position.tolist(), cores() if threads is None else threads
        kernel = KernelFunction(
            "Lighting.colors_from",
            "Lighting.colors",
            lambda means, normals: kernels.lit_colors(means, normals, light, place, count),
            lambda by, means, normals: kernels.lit_colors_gradient(means, normals, light, place, by, count),
        )
        return kernel(means, normals)

    def explains(self, pixels: NDArray[np.floating]) -> bool:
        """True if this lighting explains opaque `pixels` (M, 3) in [0, 1] of the surface; False without pixels."""
        facing = torch.linspace(0.0, 1.0, 128)[:, None]  # [128, 1]
        shades = self.colors(facing, torch.ones_like(facing)).numpy()  # [128, 3]
        nearest = np.abs(pixels[:, None] - shades).max(axis=2).min(axis=1)  # [M]
        return len(pixels) > 0 and bool(np.mean(nearest <= CLOSE) >= MOSTLY)
