"""The reference implementation of the ray caster in torch: slow, short, differentiable, float64.

Emission and absorption (Max 1995, "Optical models for direct volume rendering", equation 7) by the midpoint rule.  Each ray is
cut into equal steps between the places where it enters and leaves the box, and sampled in the middle of each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from torch import Tensor

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native.ray_casting.fields import SampledField
from native.ray_casting.functions import Knots, drawn_range
from native.ray_casting.isosurface import SAMPLES
from native.ray_casting.triangles import Triangles
from native.ray_casting.volume import HEADLIGHT, checked_distance

OPAQUE = 1.0 / 8192.0  # light that is left where a ray ends early
SLACK = 1e-3  # of a step, that a ray may be longer than its steps
FARTHEST = 1e6  # widths of the drawn range: values beyond are held there
NEARLY_OPAQUE = 1e-6  # no derivative by an opacity that lies closer to 1
ROUNDING = 2.0**-22  # of the values: a smaller difference of two interpolated ones is none
RAYS_AT_ONCE, SURFACE_RAYS = 4096, 512


def draw_volume_reference(
    field: SampledField,
    appearance: VolumeRendering,
    camera: Camera,
    *,
    sample_distance: float | None = None,
    values: Tensor | None = None,
    opacities: Tensor | None = None,
    colors: Tensor | None = None,
    bounds: np.ndarray | None = None,
) -> Tensor:
    """Premultiplied RGBA (height, width, 4), float64, as `draw_volume` defines it.

    Differentiable by `values` (nz, ny, nx), `opacities` (P,) and `colors` (Q, 3) of the control points, where they are given in
    place of the field's and the function's.  Rays begin and end at `bounds` (2, 3) in samples, by default the field's own.
    """
    distance, transfer = checked_distance(field, sample_distance), appearance.transfer_function
    value_range = drawn_range(field.range, transfer)
    knots = Knots.of(transfer, value_range)
    own_points = (np.array(transfer.opacity_points)[:, 1], np.array(transfer.color_points)[:, 1:])
    opacities, colors = (
        torch.from_numpy(own) if tensor is None else tensor.double()
        for own, tensor in zip(own_points, (opacities, colors), strict=True)
    )
    table = torch.cat(
        [torch.from_numpy(knots.of_opacities) @ opacities[:, None], torch.from_numpy(knots.of_colors) @ colors], dim=1
    )  # [K, 4]
    samples = torch.from_numpy(field.filled.astype(np.float64)) if values is None else values.double()
    samples = ((samples - value_range[0]) / (value_range[1] - value_range[0])).clamp(-FARTHEST, FARTHEST)
    march = _March(_Box.of(field, bounds), samples, torch.from_numpy(knots.places), table, appearance, distance)
    nothing = 0.0 * (samples.sum() + table.sum())  # with gradients of zero, where no ray meets the box
    return _by_rays(camera, march.along) + nothing


def draw_isosurface_reference(
    field: SampledField,
    appearance: Isosurface,
    camera: Camera,
    *,
    samples: int = SAMPLES,
    bounds: np.ndarray | None = None,
) -> Tensor:
    """Premultiplied RGBA (height, width, 4), float64, as `draw_isosurface` defines it: every ray meets every triangle.

    Only what lies in `bounds` (2, 3), in samples, is seen.
    """
    triangles = Triangles.of(field, appearance.isovalue)
    spacing, origin = (torch.tensor(numbers, dtype=torch.float64) for numbers in (field.spacing, field.origin))
    corners = torch.from_numpy(triangles.corners).long()  # [T, 3]
    first, second, third = (origin + torch.from_numpy(triangles.places) * spacing)[corners].unbind(1)  # [T, 3] each
    normals = torch.from_numpy(triangles.normals)[corners]  # [T, 3, 3]
    light = appearance.ambient, appearance.diffuse, appearance.specular, appearance.specular_power

    def along(eye: Tensor, directions: Tensor) -> Tensor:
        sides, away = (second - first, third - first), eye - first  # the method of Möller & Trumbore (1997)
        over = directions @ torch.cross(sides[1], sides[0], dim=1).T  # [R, T]
        u = directions @ torch.cross(sides[1], away, dim=1).T / over
        v = directions @ torch.cross(away, sides[0], dim=1).T / over
        closeness = over / (sides[1] * torch.cross(away, sides[0], dim=1)).sum(dim=1)  # 1 over the distance
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (closeness > 0.0)
        for axis, (low, high) in enumerate(() if bounds is None else bounds.T):
            place = (eye[axis] + directions[:, axis, None] / closeness - origin[axis]) / spacing[axis]  # [R, T]
            inside &= (place >= low) & (place <= high)
        image = torch.zeros(len(directions), 4, dtype=directions.dtype)
        (rays,) = torch.nonzero(inside.any(dim=1), as_tuple=True)
        chosen = torch.where(inside[rays], closeness[rays], 0.0).max(dim=1).indices if len(rays) else rays
        u, v = u[rays, chosen][:, None], v[rays, chosen][:, None]
        gradients = (1.0 - u - v) * normals[chosen, 0] + u * normals[chosen, 1] + v * normals[chosen, 2]
        color = torch.tensor(appearance.color, dtype=image.dtype).expand(len(rays), 3)
        image[rays] = torch.cat([_lit(color, gradients, directions[rays], light), image.new_ones(len(rays), 1)], dim=1)
        return image

    picture = _by_rays(camera.resized(samples * camera.width, samples * camera.height), along, SURFACE_RAYS)
    return picture.reshape(camera.height, samples, camera.width, samples, 4).mean(dim=(1, 3))


def _by_rays(camera: Camera, along: Callable[[Tensor, Tensor], Tensor], at_once: int = RAYS_AT_ONCE) -> Tensor:
    """The image (height, width, 4) of what `along` shows of the eye (3,) and unit directions (R, 3), a part at a time."""
    eye, directions = camera.rays()
    parts = torch.from_numpy(directions.reshape(-1, 3).copy()).split(at_once)
    return torch.cat([along(torch.from_numpy(eye), part) for part in parts]).reshape(camera.height, camera.width, 4)


@dataclass(frozen=True, eq=False)
class _Box:
    """The grid: `last` (3,) are the last samples along x, y and z, `low` and `high` (3,) where rays begin and end, in samples."""

    last: Tensor
    low: Tensor
    high: Tensor
    spacing: Tensor
    origin: Tensor
    holes: Tensor | None

    @classmethod
    def of(cls, field: SampledField, bounds: np.ndarray | None = None) -> _Box:
        spacing, origin = (torch.tensor(numbers, dtype=torch.float64) for numbers in (field.spacing, field.origin))
        holes = None if field.holes is None else torch.from_numpy(field.holes)
        last = torch.from_numpy(field.size).double() - 1.0
        low, high = (torch.zeros_like(last), last) if bounds is None else torch.from_numpy(bounds)
        return cls(last, low, high, spacing, origin, holes)

    def cut(self, eye: Tensor, directions: Tensor, measure: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Of rays (R, 3) of unit length: where they enter (R, 3) and their steps (R, 3), in samples, and how many (R,).

        A world unit along each axis is `measure` (3,) of the longest steps.
        """
        nonzero = torch.where(directions.abs() > 1e-200, directions, 1e-200)
        first = (self.origin + self.low * self.spacing - eye) / nonzero  # [R, 3], the slab method (Kay & Kajiya 1986)
        second = (self.origin + self.high * self.spacing - eye) / nonzero  # [R, 3]
        near, far = torch.minimum(first, second), torch.maximum(first, second)
        enter, leave = near.amax(dim=1).clamp(min=0.0), far.amin(dim=1)  # [R], [R]
        inside = (leave - enter).clamp(min=0.0)
        steps = torch.ceil(inside * (directions * measure).norm(dim=1) - SLACK).clamp(min=1.0)
        begin = (eye + enter[:, None] * directions - self.origin) / self.spacing
        return begin, directions * (inside / steps)[:, None] / self.spacing, torch.where(leave > enter, steps, 0.0)

    def trilinear(self, samples: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        """`samples` (A,) at places in samples (A, 3), beyond the box those on its face, and where the cell is hidden (A,)."""
        index = torch.minimum(index.clamp(min=0.0), self.last)
        corner = torch.minimum(index.floor(), self.last - 1.0)  # [A, 3]
        share, (i, j, k) = index - corner, corner.long().unbind(1)
        total, hidden = torch.zeros_like(share[:, 0]), torch.zeros(len(index), dtype=torch.bool)
        for x, y, z in product((0, 1), repeat=3):
            weight = torch.ones_like(total)
            for axis, side in enumerate((x, y, z)):
                weight = weight * (share[:, axis] if side else 1.0 - share[:, axis])
            total = total + weight * samples[k + z, j + y, i + x]
            if self.holes is not None:
                hidden = hidden | self.holes[k + z, j + y, i + x]
        return total, hidden


@dataclass(frozen=True, eq=False)
class _March:
    """A volume: `samples` (nz, ny, nx) of which 0 to 1 is drawn, `places` (K,) and `table` (K, 4) of the knots."""

    box: _Box
    samples: Tensor
    places: Tensor
    table: Tensor
    appearance: VolumeRendering
    distance: float

    def along(self, eye: Tensor, directions: Tensor) -> Tensor:
        """Premultiplied RGBA (R, 4) of rays `directions` (R, 3), of unit length, from `eye` (3,)."""
        begin, step, steps = self.box.cut(eye, directions, torch.full((3,), 1.0 / self.distance, dtype=torch.float64))
        lengths = (step * self.box.spacing).norm(dim=1)  # [R], world units
        color, through = directions.new_zeros(len(directions), 3), directions.new_ones(len(directions))
        for k in range(int(steps.max())):
            (rays,) = torch.nonzero((steps > k) & (through >= OPAQUE), as_tuple=True)
            index = begin[rays] + (k + 0.5) * step[rays]  # [A, 3]
            values, hidden = self.box.trilinear(self.samples, index)  # [A], [A]
            samples = self.function(values.clamp(0.0, 1.0))  # [A, 4]
            exponents = lengths[rays] / self.appearance.transfer_function.opacity_unit_distance
            passing = 1.0 - samples[:, 0]
            passing = torch.where(passing > NEARLY_OPAQUE, passing, passing.detach())
            alphas = 1.0 - passing**exponents  # [A]
            straight = (
                _lit(samples[:, 1:], self.gradients(index), directions[rays])
                if self.appearance.shaded
                else samples[:, 1:]
            )
            weights = through[rays] * torch.where(hidden, 0.0, alphas)  # [A]
            color = color.index_add(0, rays, weights[:, None] * straight)
            through = through.index_add(0, rays, -weights)
        return torch.cat([color, 1.0 - through[:, None]], dim=1)

    def function(self, values: Tensor) -> Tensor:
        """Opacities and colours (A, 4) at values (A,) from 0 to 1, linear between the knots."""
        after = torch.searchsorted(self.places, values.detach(), right=True).clamp(1, len(self.places) - 1)  # [A]
        before = after - 1
        share = (values - self.places[before]) / (self.places[after] - self.places[before])
        return torch.lerp(self.table[before], self.table[after], share[:, None])

    def gradients(self, index: Tensor) -> Tensor:
        """Differences (A, 3) over one sample to either side, per world unit; those that rounding may make are 0."""
        slopes = []
        for offset in torch.eye(3, dtype=index.dtype):
            ahead, behind = (self.box.trilinear(self.samples, index + side * offset)[0] for side in (1.0, -1.0))
            bound = ROUNDING * torch.maximum(ahead.abs(), behind.abs())
            slopes.append(torch.where((ahead - behind).abs() > bound, ahead - behind, 0.0))
        return torch.stack(slopes, dim=1) / self.box.spacing


def _lit(colors: Tensor, gradients: Tensor, directions: Tensor, light: Sequence[float] = HEADLIGHT) -> Tensor:
    """Colours (A, 3) under a two-sided headlight (Blinn-Phong), of gradients and unit rays (A, 3)."""
    largest = gradients.detach().abs().amax(dim=1, keepdim=True)  # [A, 1]
    gradients = gradients / torch.where(largest > 0.0, largest, 1.0)
    steepness = gradients.square().sum(dim=1)  # [A]
    steepness = torch.where(steepness > 0.0, steepness, 1.0).sqrt()
    ambient, diffuse, specular, power = light
    facing = ((gradients * directions).sum(dim=1).abs() / steepness).clamp(max=1.0)[:, None]  # [A, 1]
    return ((ambient + diffuse * facing) * colors + specular * facing**power).clamp(0.0, 1.0)
