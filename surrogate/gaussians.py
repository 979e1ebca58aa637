"""The Gaussians: their parameters as they are optimized, and as they are drawn.

Source: Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", section 4.  A Gaussian has a mean, a
covariance R S Sᵀ Rᵀ from a quaternion and three scales, an opacity and a colour in spherical harmonics.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import positive, row
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.lighting import Lighting
from surrogate.splatting.along_rays import opacities_along_rays
from surrogate.splatting.directional import directional_colors

GEOMETRY = {"means": 3, "log_scales": 3, "quats": 4, "opacity_logits": 1}  # columns of what all Gaussians have
NAMES = (*GEOMETRY, "colors")


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N Gaussians in unconstrained parameters (float32), in the coordinates of a `Normalization`.

    Attributes
    ----------
    means : (N, 3).
    log_scales : (N, 3), logarithms of the standard deviations along the principal axes.
    quats : (N, 4), rotations as w, x, y, z, of any length but zero.
    opacity_logits : (N,), opacity is their sigmoid.
    colors : (N, 3 K), K spherical-harmonics coefficients of 3 channels each.  K is 1 (the colour itself) or 4 (with those of
        degree 1 in the usual order y, z, x).  With a `lighting`, K = 1 and these are normals.
    lighting : of the surface that they show, which then says their colours by `colors` as normals; it is not trained.
    medium : whether they absorb along rays, so that their opacity depends on where they are seen from; else the sigmoid holds from
        everywhere.
    """

    means: Tensor  # [N, 3]
    log_scales: Tensor  # [N, 3]
    quats: Tensor  # [N, 4]
    opacity_logits: Tensor  # [N]
    colors: Tensor  # [N, 3 K]
    lighting: Lighting | None = field(default=None, kw_only=True)
    medium: bool = field(default=False, kw_only=True)

    __repr__ = one_line

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, Tensor]) -> Gaussians:
        """The Gaussians that had these `tensors()`; raises ValueError naming the tensor whose shape is another."""
        if set(tensors) != set(NAMES):
            raise ValueError(f"they must consist of {joined_names(NAMES)}, got {joined_names(sorted(tensors))}")
        count = len(tensors["means"]) if tensors["means"].ndim else 0
        shapes: dict[str, list[tuple[int, ...]]] = {name: [(count, width)] for name, width in GEOMETRY.items()}
        shapes |= {"opacity_logits": [(count,)], "colors": [(count, 3), (count, 12)]}
        for name, allowed in shapes.items():
            if tuple(tensors[name].shape) not in allowed:
                raise ValueError(
                    f"{name} must be of shape {' or '.join(map(str, allowed))}, got {tuple(tensors[name].shape)}"
                )
        return cls(*(tensors[name] for name in NAMES))

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def color_degree(self) -> int:
        return 0 if self.colors.shape[1] == 3 else 1

    def tensors(self) -> dict[str, Tensor]:
        """The parameters by name."""
        return {name: getattr(self, name) for name in NAMES}

    def with_color_degree(self, degree: int) -> Gaussians:
        """The same, whose colours may depend on the direction (degree 1) but do not yet; raises ValueError for a lower degree."""
        if degree < self.color_degree:
            raise ValueError(f"colours of degree {self.color_degree} can't be of degree {degree}")
        flat = self.colors.new_zeros(len(self), 9 * (degree - self.color_degree))  # [N, 0 or 9]
        return replace(self, colors=torch.cat([self.colors, flat], dim=1))

    def of(self, rows: Tensor) -> Gaussians:
        """Some of them, by index (M,)."""
        return self._with(tensor[rows] for tensor in self.tensors().values())

    def to(self, device: torch.device | torch.dtype) -> Gaussians:
        """The same on another device, or in another precision."""
        return self._with(tensor.to(device) for tensor in self.tensors().values())

    def copy(self) -> Gaussians:
        """The same numbers in tensors of their own."""
        return self._with(tensor.detach().clone() for tensor in self.tensors().values())

    def _with(self, tensors: Iterable[Tensor]) -> Gaussians:
        return Gaussians(*tensors, lighting=self.lighting, medium=self.medium)

    def record(self) -> dict[str, Any]:
        """JSON values that are needed beside the tensors: none."""
        return {}

    def with_tensors(self, tensors: Sequence[Tensor]) -> Gaussians:
        """The same with other tensors, in the order of `tensors()`."""
        return Gaussians(*tensors)

    def drawn(self, function: TransferFunction | None = None) -> Gaussians:
        """The Gaussians to draw, these; raises ValueError for a transfer function, of which colours know nothing."""
        if function is not None:
            raise ValueError(
                'these Gaussians carry colours and know no transfer functions: train with carried = "values" for any'
            )
        return self

    def scales(self) -> Tensor:
        """Standard deviations along the principal axes, (N, 3)."""
        return self.log_scales.exp()

    def opacities(self) -> Tensor:
        """Opacities in (0, 1), (N,); of a medium those of balls of the same volume."""
        return self.opacity_logits.sigmoid()

    def opacities_from(self, position: Tensor, *, threads: int | None = None) -> Tensor:
        """Opacities in [0, 1], (N,), as seen from `position` (3,), in the Gaussians' coordinates."""
        if not self.medium:
            return self.opacities()
        shapes = self.means, self.log_scales, self.quats
        return opacities_along_rays(*shapes, self.opacity_logits, position, threads=threads)

    def colors_from(self, position: Tensor, *, threads: int | None = None) -> Tensor:
        """Colours (N, 3) as seen from `position` (3,), in the Gaussians' coordinates; not clamped."""
        if self.lighting is not None:
            return self.lighting.colors_from(self.means, self.colors, position, threads=threads)
        if self.color_degree == 0:
            return self.colors
        return directional_colors(self.means, self.colors, position, threads=threads)


@dataclass(frozen=True, eq=False)
class Normalization:
    """The map from world coordinates to those of the Gaussians: (world - center) / extent.

    It is taken in float64, so that boxes far from the origin (coordinates around 1e6) lose nothing; the box becomes
    [-1, 1] along its longest side.  A uniform scale leaves perspective images unchanged.
    """

    center: NDArray[np.float64]  # [3]
    extent: float

    @classmethod
    def of_box(cls, bounds: ArrayLike) -> Normalization:
        """The normalization of a world box (low (3,), high (3,))."""
        low, high = np.asarray(bounds, dtype=np.float64)  # [3], [3]
        extent = float((high - low).max()) / 2.0
        if not (np.isfinite(extent) and extent > 0):
            raise ValueError(
                f"the box of the volume must be finite and have a size, got {low.tolist()}, {high.tolist()}"
            )
        return cls((low + high) / 2.0, extent)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Normalization:
        """The normalization that `to_json` described; raises ValueError for a centre or an extent that none can have."""
        return cls(np.array(row(values["center"], 3, "center")), positive(values["extent"], "extent"))

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {"center": self.center.tolist(), "extent": self.extent}

    def points(self, world: ArrayLike) -> NDArray[np.float64]:
        """World points (..., 3) in the Gaussians' coordinates."""
        return (np.asarray(world, dtype=np.float64) - self.center) / self.extent

    def world(self, points: ArrayLike) -> NDArray[np.float64]:
        """World places of points (..., 3) in the Gaussians' coordinates."""
        return np.asarray(points, dtype=np.float64) * self.extent + self.center

    def camera(self, camera: Camera) -> Camera:
        """The camera that sees normalized points where `camera` sees world points."""
        matrix = camera.world_to_camera.copy()  # [4, 4]
        matrix[:3, 3] = (camera.rotation @ self.center + camera.world_to_camera[:3, 3]) / self.extent
        return Camera(matrix, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
