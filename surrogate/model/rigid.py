"""Gaussians in the coordinates of a camera, as a differentiable function of its pose."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Gaussians, Normalization
from surrogate.splatting import Primitives


def look_at(position: Tensor, target: Tensor, up: Tensor | None = None) -> Tensor:
    """The pose (4, 4), world to camera in OpenCV axes, of a camera at `position` (3,) that looks at `target` (3,).

    Differentiable in all three.  `up` (3,), by default +z, points to the top of the picture; it must not be parallel to the
    viewing direction.  The same as `Camera.look_at`, but that it takes no other `up` near the poles.

    Examples
    --------
    >>> import torch
    >>> from surrogate import look_at
    >>> position = torch.tensor([0.0, -4.0, 1.0], requires_grad=True)
    >>> pose = look_at(position, torch.zeros(3))
    >>> round(float(pose[2, 3].detach()), 3)  # the target's depth
    4.123
    """
    forward = torch.nn.functional.normalize(target - position, dim=0)  # [3]
    upward = torch.tensor([0.0, 0.0, 1.0]).to(position) if up is None else up  # [3]
    right = torch.nn.functional.normalize(torch.linalg.cross(forward, upward), dim=0)  # [3]
    rotation = torch.stack([right, torch.linalg.cross(forward, right), forward])  # [3, 3]
    last = torch.tensor([[0.0, 0.0, 0.0, 1.0]]).to(position)  # [1, 4]
    return torch.cat([torch.cat([rotation, -(rotation @ position)[:, None]], dim=1), last])


def posed(camera: Camera, pose: Any) -> Camera:
    """`camera` with the pose (4, 4); raises ValueError unless that is a rigid world-to-camera matrix."""
    if not isinstance(pose, Tensor) or tuple(pose.shape) != (4, 4):
        raise ValueError(
            f"pose must be a tensor (4, 4), world to camera, got {getattr(pose, 'shape', type(pose).__name__)}"
        )
    return replace(camera, world_to_camera=pose.detach().cpu().double().numpy())


def in_camera(gaussians: Gaussians, normalization: Normalization, pose: Tensor) -> Primitives:
    """The Gaussians, which are in normalized coordinates, as a camera of this pose (4, 4) in world units has them before it.

    Drawn by a camera whose own pose is the identity they give the same picture, and gradients by the pose are exact.  Means and
    rotations move rigidly; colours and opacities are those seen from the camera's position.
    """
    matrix = pose.double()  # so that boxes far from the origin lose nothing
    rotation = matrix[:3, :3]  # [3, 3]
    center = torch.from_numpy(np.ascontiguousarray(normalization.center)).to(matrix)  # [3]
    shift = (rotation @ center + matrix[:3, 3]) / normalization.extent  # [3]
    position = (-rotation.T @ shift).to(gaussians.means)  # [3]
    turned = rotation.to(gaussians.means)  # [3, 3]
    return Primitives(
        gaussians.means @ turned.T + shift.to(gaussians.means),
        gaussians.scales(),
        _product(_quaternion(rotation).to(gaussians.means), gaussians.quats),
        gaussians.opacities_from(position),
        gaussians.colors_from(position),
    )


def _quaternion(rotation: Tensor) -> Tensor:
    """A quaternion w, x, y, z (4,) of a rotation (3, 3), at least 2 long: four times the outer product with itself has these rows.

    Shepperd 1978: the row of the largest component loses no digits.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.unbind(0)[0], rotation.unbind(0)[1], rotation.unbind(0)[2]
    rows = torch.stack(
        [
            torch.stack([1 + a + e + i, h - f, c - g, d - b]),
            torch.stack([h - f, 1 + a - e - i, d + b, c + g]),
            torch.stack([c - g, d + b, 1 - a + e - i, h + f]),
            torch.stack([d - b, c + g, h + f, 1 - a - e + i]),
        ]
    )  # [4, 4]
    return rows[int(rows.detach().diagonal().argmax())]


def _product(first: Tensor, second: Tensor) -> Tensor:
    """The quaternions (N, 4) of the rotations `second` (N, 4) followed by `first` (4,)."""
    w, x, y, z = first.unbind(0)
    matrix = torch.stack(
        [
            torch.stack([w, -x, -y, -z]),
            torch.stack([x, w, -z, y]),
            torch.stack([y, z, w, -x]),
            torch.stack([z, -y, x, w]),
        ]
    )  # [4, 4]
    return second @ matrix.T
