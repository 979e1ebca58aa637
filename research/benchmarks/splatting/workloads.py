"""Scenes of random Gaussians, always the same ones, so that numbers can be compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.splatting import Constants, Primitives

DISTANCE = 4.3  # from the camera to the middle of the scene
HALF_THICKNESS = 0.6  # of the scene, along the camera's axis
FILLED = 0.86  # of the frame's width and height, by the Gaussians' centres
SEED = 0


class View(NamedTuple):
    """All inputs of an image."""

    scene: Primitives
    camera: Camera
    constants: Constants = Constants()


@dataclass(frozen=True)
class Workload:
    """`count` random Gaussians, `size` pixels square.

    Attributes
    ----------
    sigmas : lowest and highest standard deviation in pixels, drawn so that their cubes are spread evenly.
    opacities : lowest and highest, drawn evenly.
    shells : the Gaussians lie on three nested spheres; otherwise evenly, on the screen and in depth, in most of the frame.
    """

    name: str
    size: int
    count: int
    sigmas: tuple[float, float]
    opacities: tuple[float, float]
    shells: bool = False

    @property
    def title(self) -> str:
        return f"{self.name}, {self.size}², {thousands(self.count)}"

    def camera(self) -> Camera:
        position = (0.0, -DISTANCE, 0.3)
        return Camera.look_at(position, (0, 0, 0), vertical_fov_degrees=30.0, width=self.size, height=self.size)

    def scene(self) -> Primitives:
        """The Gaussians in float32, drawn by a fixed seed."""
        random = np.random.default_rng(SEED)
        camera = self.camera()
        if self.shells:
            directions = random.normal(size=(self.count, 3))
            radii = random.choice([0.4, 0.7, 1.0], self.count)
            means = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radii[:, None]
            depths = (means @ camera.rotation.T + camera.world_to_camera[:3, 3])[:, 2]
        else:
            depths = random.uniform(DISTANCE - HALF_THICKNESS, DISTANCE + HALF_THICKNESS, self.count)
            positions = self.size * (0.5 + FILLED * random.uniform(-0.5, 0.5, (self.count, 2)))  # px
            ratios = (positions - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
            local = np.column_stack([ratios, np.ones(self.count)]) * depths[:, None]
            means = (local - camera.world_to_camera[:3, 3]) @ camera.rotation
        low, high = np.power(self.sigmas, 3)
        values = (
            means,
            np.cbrt(random.uniform(low, high, (self.count, 3))) * depths[:, None] / camera.fx,
            random.normal(size=(self.count, 4)),
            random.uniform(*self.opacities, self.count),
            random.uniform(0, 1, (self.count, 3)),
        )
        return Primitives(*(torch.from_numpy(value).float() for value in values))

    def gaussians(self) -> Gaussians:
        """The Gaussians in unconstrained parameters."""
        scene = self.scene()
        return Gaussians(scene.means, scene.scales.log(), scene.quats, scene.opacities.logit(), scene.colors)

    def view(self) -> View:
        """The Gaussians, the camera and the usual constants."""
        return View(self.scene(), self.camera())

    def at_size(self, size: int) -> Workload:
        """The same scene in pictures of another size."""
        factor = size / self.size
        return replace(self, size=size, sigmas=(self.sigmas[0] * factor, self.sigmas[1] * factor))

    def with_count(self, count: int) -> Workload:
        """The same volume filled by another number of Gaussians, as much smaller as they are more."""
        factor = (self.count / count) ** (1 / 3)
        return replace(self, count=count, sigmas=(self.sigmas[0] * factor, self.sigmas[1] * factor))


FIXED = Workload("translucent", 256, 20_000, (2, 6), (0.02, 0.2))
OTHERS = (
    Workload("translucent", 256, 60_000, (2, 6), (0.02, 0.2)),
    Workload("translucent", 512, 60_000, (2, 6), (0.02, 0.2)),
    Workload("thin", 256, 20_000, (0.6, 2.2), (0.02, 0.2)),
    Workload("opaque shells", 256, 20_000, (1, 3), (0.6, 0.99), shells=True),
    Workload("opaque shells", 512, 60_000, (2, 6), (0.6, 0.99), shells=True),
)


def thousands(count: int) -> str:
    """20000 as 20k, 1000000 as 1M."""
    return f"{count // 1_000_000}M" if count >= 1_000_000 else f"{count // 1000}k" if count >= 1000 else str(count)
