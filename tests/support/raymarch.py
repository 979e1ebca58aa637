"""The float64 reference that VTK is checked against: slow, short and independent of it.

Emission-absorption volume rendering (Max, "Optical models for direct volume rendering", 1995, eq. 7) by the
midpoint rule.  The field is trilinear between samples, and the transfer function is evaluated exactly.  Each ray is cut into
equal steps between where it enters and leaves the box.  Nothing is tabulated, clamped or stopped early.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from render.grids import Grid
from render.shaders import AMBIENT, DIFFUSE, SPECULAR, SPECULAR_POWER

RAYS_AT_ONCE = 4096
ROUNDING = 1e-14  # of the values: double precision tells no smaller difference of two interpolated values from 0


def march(grid: Grid, appearance: VolumeRendering, camera: Camera, sample_distance: float) -> NDArray[np.float64]:
    """Premultiplied RGBA [height, width, 4] of the volume, float64.

    Each ray takes `ceil(length / sample_distance)` equal steps, one sample in the middle of each: halving the
    distance quarters the error where field and transfer function are smooth.  A shaded volume is lit as
    `render.shaders` says.
    """
    origin, directions = camera.rays()  # [3], [H, W, 3]
    flat = directions.reshape(-1, 3)  # [R, 3]
    enter, leave = box_intersections(grid, origin, flat)  # [R], [R]
    image = np.zeros((len(flat), 4))  # [R, 4]
    hit = np.flatnonzero(leave > enter)
    for start in range(0, len(hit), RAYS_AT_ONCE):
        part = hit[start : start + RAYS_AT_ONCE]
        image[part] = _march_rays(grid, appearance, origin, flat[part], enter[part], leave[part], sample_distance)
    return image.reshape(camera.height, camera.width, 4)


def converged(
    grid: Grid, appearance: VolumeRendering, camera: Camera, *, tolerance: float = 1e-5
) -> tuple[NDArray[np.float64], float]:
    """(`march` at a step small enough, root-mean-square change over all channels that halving it last made).

    Halves the step from a quarter of the smallest spacing until the picture moves by no more than `tolerance`
    (1e-5: what remains lies below -100 dB).  Raises RuntimeError if 1/64 of the spacing is not enough.
    """
    distance = min(grid.spacing) / 4
    image = march(grid, appearance, camera, distance)
    for _ in range(4):
        distance /= 2
        finer = march(grid, appearance, camera, distance)
        change = float(np.sqrt(np.mean((finer - image) ** 2)))
        image = finer
        if change <= tolerance:
            return image, change
    raise RuntimeError(
        f"the ray-marcher still changes by {change:.1e} at 1/64 of the spacing: the transfer function is "
        "too steep for this grid"
    )


def trilinear(grid: Grid, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(values (...), hidden (...)) of the field at world `points` (..., 3), clamped to the box.

    `hidden` is true in grid cells that have a hole at a corner (see `Grid.holes`).
    """
    nz, ny, nx = grid.shape
    index = (points - np.array(grid.origin)) / np.array(grid.spacing)  # [..., 3]
    index = np.clip(index, 0.0, np.array([nx, ny, nz]) - 1.0)
    corner = np.minimum(index.astype(np.int64), np.array([nx, ny, nz]) - 2)  # [..., 3]
    fx, fy, fz = np.moveaxis(index - corner, -1, 0)
    first = (corner[..., 2] * ny + corner[..., 1]) * nx + corner[..., 0]  # [...]
    values = grid.values.reshape(-1)
    total = np.zeros(first.shape)
    hidden = np.zeros(first.shape, dtype=bool)
    for (dz, wz), (dy, wy), (dx, wx) in product(*(((0, 1 - f), (1, f)) for f in (fz, fy, fx))):
        at = first + (dz * ny + dy) * nx + dx
        total += wz * wy * wx * values[at]
        if grid.holes is not None:
            hidden |= grid.holes.reshape(-1)[at]
    return total, hidden


def gradient(grid: Grid, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Central differences over one spacing to either side, (..., 3), at world `points` (..., 3).

    A difference within the rounding of the interpolation (`ROUNDING` of the values) is 0: constant regions have no slope.
    """
    slopes = []
    for axis, spacing in enumerate(grid.spacing):
        offset = np.zeros(3)
        offset[axis] = spacing
        ahead, behind = trilinear(grid, points + offset)[0], trilinear(grid, points - offset)[0]
        told_apart = np.abs(ahead - behind) > ROUNDING * (np.abs(ahead) + np.abs(behind))
        slopes.append(np.where(told_apart, ahead - behind, 0.0) / (2 * spacing))
    return np.stack(slopes, axis=-1)


def box_intersections(
    grid: Grid, origin: NDArray[np.float64], directions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distances (enter (R,), leave (R,)) along rays `directions` (R, 3) from `origin` (3,); a miss has leave <= enter.

    The slab method (Kay & Kajiya 1986); `enter` is never behind the origin.
    """
    low, high = grid.bounds
    with np.errstate(divide="ignore", invalid="ignore"):
        near = (low - origin) / directions  # [R, 3]
        far = (high - origin) / directions  # [R, 3]
    near, far = np.fmin(near, far), np.fmax(near, far)
    return np.maximum(near.max(axis=1), 0.0), far.min(axis=1)


def _march_rays(
    grid: Grid,
    appearance: VolumeRendering,
    origin: NDArray[np.float64],
    directions: NDArray[np.float64],
    enter: NDArray[np.float64],
    leave: NDArray[np.float64],
    sample_distance: float,
) -> NDArray[np.float64]:
    transfer = appearance.transfer_function
    lengths = leave - enter  # [R]
    steps = np.maximum(np.ceil(lengths / sample_distance - 1e-9), 1.0)  # [R]
    step = lengths / steps  # [R]
    exponents = step / transfer.opacity_unit_distance  # [R]
    color, through = np.zeros((len(directions), 3)), np.ones(len(directions))
    for k in range(int(steps.max())):
        alive = np.flatnonzero(k < steps)
        along = enter[alive] + (k + 0.5) * step[alive]
        points = origin + along[:, None] * directions[alive]  # [A, 3]
        values, hidden = trilinear(grid, points)  # [A], [A]
        opacity = 1.0 - (1.0 - transfer.opacities(values)) ** exponents[alive]
        weight = through[alive] * np.where(hidden, 0.0, opacity)
        straight = transfer.colors(values)  # [A, 3]
        if appearance.shaded:
            straight = _lit(straight, gradient(grid, points), -directions[alive])
        color[alive] += weight[:, None] * straight
        through[alive] -= weight
    return np.concatenate([color, 1.0 - through[:, None]], axis=1)


def _lit(
    colors: NDArray[np.float64], gradients: NDArray[np.float64], towards_eye: NDArray[np.float64]
) -> NDArray[np.float64]:
    """`colors` (A, 3) under a two-sided headlight: Blinn-Phong with light and eye in one direction."""
    largest = np.abs(gradients).max(axis=-1, keepdims=True)
    gradients = gradients / np.where(largest > 0, largest, 1.0)  # so that no square overflows
    steepness = np.linalg.norm(gradients, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        facing = np.abs(np.sum(gradients * towards_eye, axis=-1)) / steepness
    facing = np.where(steepness > 0, np.minimum(facing, 1.0), 0.0)[:, None]
    return np.clip((AMBIENT + DIFFUSE * facing) * colors + SPECULAR * facing**SPECULAR_POWER, 0.0, 1.0)
