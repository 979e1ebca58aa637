"""The reference implementation of the ray caster in torch: slow, short, differentiable, float64.

Emission and absorption (Max 1995, "Optical models for direct volume rendering", equation 7) by the midpoint rule.  Each ray is
cut into equal steps between the places where it enters and leaves the box, and sampled in the middle of each.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import torch
from torch import Tensor

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from surrogate.ray_casting.fields import SampledField
from surrogate.ray_casting.functions import Knots, drawn_range
from surrogate.ray_casting.volume import HEADLIGHT, checked_distance

OPAQUE = 1.0 / 8192.0  # light that is left where a ray ends early
SLACK = 1e-3  # of a step, that a ray may be longer than its steps
FARTHEST = 1e6  # widths of the drawn range: values beyond are held there
ROUNDING = 2.0**-22  # of the values: a smaller difference of two interpolated ones is none
RAYS_AT_ONCE = 4096


def draw_volume_reference(
    field: SampledField,
    appearance: VolumeRendering,
    camera: Camera,
    *,
    sample_distance: float | None = None,
    values: Tensor | None = None,
    opacities: Tensor | None = None,
    colors: Tensor | None = None,
) -> Tensor:
    """Premultiplied RGBA (height, width, 4), float64, as `draw_volume` defines it.

    Differentiable by `values` (nz, ny, nx), `opacities` (P,) and `colors` (Q, 3) of the control points, where they are given in
    place of the field's and the function's.
    """
    distance, transfer = checked_distance(field, sample_distance), appearance.transfer_function
    drawn = drawn_range(field.range, transfer)
    knots = Knots.of(transfer, drawn)
    given = (np.array(transfer.opacity_points)[:, 1], np.array(transfer.color_points)[:, 1:])
    opacities, colors = (
        torch.from_numpy(own) if tensor is None else tensor.double()
        for own, tensor in zip(given, (opacities, colors), strict=True)
    )
    table = torch.cat(
        [torch.from_numpy(knots.of_opacities) @ opacities[:, None], torch.from_numpy(knots.of_colors) @ colors], dim=1
    )  # [K, 4]
    samples = torch.from_numpy(field.filled.astype(np.float64)) if values is None else values.double()
    samples = ((samples - drawn[0]) / (drawn[1] - drawn[0])).clamp(-FARTHEST, FARTHEST)
    march = _March(field, samples, torch.from_numpy(knots.places), table, appearance, distance)
    eye, directions = camera.rays()
    parts = torch.from_numpy(directions.reshape(-1, 3).copy()).split(RAYS_AT_ONCE)
    return torch.cat([march.along(torch.from_numpy(eye), part) for part in parts]).reshape(
        camera.height, camera.width, 4
    )


class _March:
    def __init__(
        self,
        field: SampledField,
        samples: Tensor,
        places: Tensor,
        table: Tensor,
        appearance: VolumeRendering,
        distance: float,
    ) -> None:
        self.samples, self.places, self.table, self.appearance, self.distance = (
            samples,
            places,
            table,
            appearance,
            distance,
        )
        self.spacing, self.origin = torch.tensor(field.spacing).double(), torch.tensor(field.origin).double()
        self.last = torch.from_numpy(field.size).double() - 1.0  # [3], x, y, z
        self.holes = None if field.holes is None else torch.from_numpy(field.holes)

    def along(self, eye: Tensor, directions: Tensor) -> Tensor:
        """Premultiplied RGBA (R, 4) of rays `directions` (R, 3), of unit length, from `eye` (3,)."""
        enter, leave = self.box(eye, directions)  # [R], [R]
        steps = torch.ceil((leave - enter) / self.distance - SLACK).clamp(min=1.0)  # [R]
        steps = torch.where(leave > enter, steps, 0.0)
        step = (leave - enter) / steps.clamp(min=1.0)  # [R]
        color, through = directions.new_zeros(len(directions), 3), directions.new_ones(len(directions))
        for k in range(int(steps.max()) if len(steps) else 0):
            going = (steps > k) & (through >= OPAQUE)  # [R]
            (rays,) = torch.nonzero(going, as_tuple=True)
            points = eye + (enter[rays] + (k + 0.5) * step[rays])[:, None] * directions[rays]  # [A, 3]
            index = (points - self.origin) / self.spacing  # [A, 3]
            values, hidden = self.trilinear(index)  # [A], [A]
            shown = self.function(values.clamp(0.0, 1.0))  # [A, 4]
            exponents = step[rays] / self.appearance.transfer_function.opacity_unit_distance
            alphas = 1.0 - (1.0 - shown[:, 0]) ** exponents  # [A]
            straight = self.lit(shown[:, 1:], index, directions[rays]) if self.appearance.shaded else shown[:, 1:]
            weights = through[rays] * torch.where(hidden, 0.0, alphas)  # [A]
            color = color.index_add(0, rays, weights[:, None] * straight)
            through = through.index_add(0, rays, -weights)
        return torch.cat([color, 1.0 - through[:, None]], dim=1)

    def box(self, eye: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Distances (R,), (R,) at which rays enter and leave the box (Kay & Kajiya 1986); a miss leaves before it enters."""
        held = torch.where(directions.abs() > 1e-200, directions, 1e-200)
        first = (self.origin - eye) / held  # [R, 3]
        second = (self.origin + self.last * self.spacing - eye) / held  # [R, 3]
        near, far = torch.minimum(first, second), torch.maximum(first, second)
        return near.amax(dim=1).clamp(min=0.0), far.amin(dim=1)

    def trilinear(self, index: Tensor) -> tuple[Tensor, Tensor]:
        """The field (A,) at places in samples (A, 3), those beyond the box as on its face, and where the cell is hidden (A,)."""
        index = torch.minimum(index.clamp(min=0.0), self.last)
        corner = torch.minimum(index.floor(), self.last - 1.0)  # [A, 3]
        share, (i, j, k) = index - corner, corner.long().unbind(1)
        total, hidden = torch.zeros_like(share[:, 0]), torch.zeros(len(index), dtype=torch.bool)
        for x, y, z in product((0, 1), repeat=3):
            weight = torch.ones_like(total)
            for axis, side in enumerate((x, y, z)):
                weight = weight * (share[:, axis] if side else 1.0 - share[:, axis])
            total = total + weight * self.samples[k + z, j + y, i + x]
            if self.holes is not None:
                hidden = hidden | self.holes[k + z, j + y, i + x]
        return total, hidden

    def function(self, values: Tensor) -> Tensor:
        """Opacities and colours (A, 4) at values (A,) from 0 to 1, linear between the knots."""
        after = torch.searchsorted(self.places, values.detach(), right=True).clamp(1, len(self.places) - 1)  # [A]
        before = after - 1
        share = (values - self.places[before]) / (self.places[after] - self.places[before])
        return torch.lerp(self.table[before], self.table[after], share[:, None])

    def lit(self, colors: Tensor, index: Tensor, directions: Tensor) -> Tensor:
        """Colours (A, 3) under a two-sided headlight: Blinn-Phong by central differences over one sample to either side."""
        slopes = []
        for axis in range(3):
            offset = torch.zeros(3, dtype=index.dtype)
            offset[axis] = 1.0
            ahead, behind = (self.trilinear(index + side * offset)[0] for side in (1.0, -1.0))
            bound = ROUNDING * torch.maximum(ahead.abs(), behind.abs())
            slopes.append(torch.where((ahead - behind).abs() > bound, ahead - behind, 0.0) / self.spacing[axis])
        gradients = torch.stack(slopes, dim=1)  # [A, 3]
        largest = gradients.detach().abs().amax(dim=1, keepdim=True)
        gradients = gradients / torch.where(largest > 0.0, largest, 1.0)
        steepness = gradients.square().sum(dim=1)  # [A]
        steepness = torch.where(steepness > 0.0, steepness, 1.0).sqrt()
        ambient, diffuse, specular, power = HEADLIGHT
        facing = ((gradients * directions).sum(dim=1).abs() / steepness).clamp(max=1.0)[:, None]  # [A, 1]
        return ((ambient + diffuse * facing) * colors + specular * facing**power).clamp(0.0, 1.0)
