"""The loss's gradient at each Gaussian's place on the screen: where it is large, more Gaussians are needed.

Kerbl et al. 2023, section 5.2: a Gaussian whose mean gradient, in normalized device coordinates, is large covers more detail than
one Gaussian can show.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from catalogs.cameras import Camera


@dataclass(frozen=True, eq=False)
class ScreenGradients:
    """For each Gaussian the sum of its screen gradients, and in how many pictures it was seen, since the last `forget`."""

    totals: Tensor  # [N]
    pictures: Tensor  # [N]

    @classmethod
    def none(cls, count: int, like: Tensor) -> ScreenGradients:
        """Of `count` Gaussians, on the device of `like`."""
        return cls(torch.zeros(count, device=like.device), torch.zeros(count, device=like.device))

    def __len__(self) -> int:
        return len(self.totals)

    def add(self, means: Tensor, gradients: Tensor | None, camera: Camera) -> None:
        """Count one picture: `means` (N, 3) as it showed them, `gradients` (N, 3) of its loss with respect to them.

        A place on the screen moves by f / depth pixels per unit of length, of which width / 2 are one device coordinate.
        """
        if gradients is None:
            return
        rotation = torch.from_numpy(camera.world_to_camera[2, :3].copy()).to(means)  # [3]
        depths = means @ rotation + float(camera.world_to_camera[2, 3])  # [N]
        sizes = gradients.norm(dim=1) * depths.abs() * (camera.width / (2.0 * camera.fx))  # [N]
        self.totals.add_(sizes)
        self.pictures.add_((sizes > 0).to(self.pictures.dtype))

    def above(self, threshold: float) -> Tensor:
        """The mean of each Gaussian (N,), zero where it does not exceed `threshold`."""
        means = self.totals / self.pictures.clamp(min=1.0)  # [N]
        return torch.where(means > threshold, means, 0.0)

    def forget(self) -> None:
        """Set all sums to zero."""
        self.totals.zero_()
        self.pictures.zero_()

    def tensors(self) -> dict[str, Tensor]:
        """The state by name."""
        return {"screen_gradients.totals": self.totals, "screen_gradients.pictures": self.pictures}

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """Take up the state of `tensors()`."""
        for name, own in self.tensors().items():
            own.copy_(tensors[name])
