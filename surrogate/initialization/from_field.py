"""A start from the emulated field: Gaussians spread like the medium that members show, whose values follow the emulator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.vocabulary.words import one_line
from surrogate.appearance.field_gaussians import FieldGaussians, FieldValues
from surrogate.deformation.emulated_values import EmulatedValues
from surrogate.emulation import FieldEmulator
from surrogate.emulation.corners import Corners
from surrogate.gaussians import Normalization
from surrogate.randomness import generator
from surrogate.settings import TrainingSettings

SCALE = 0.5  # of a Gaussian, times the mean distance of its neighbours
SPREAD = 0.03  # of the values in a Gaussian, on their scale
# Thickness of Gaussians that together are the medium, in distances of neighbours: a ball of half a distance on a lattice.
THICKNESS = 0.637
EVEN = 0.3  # of the Gaussians are spread evenly over the box, the others where members are opaque
MOST_MEMBERS = 24  # whose opacity is looked at


@dataclass(frozen=True, eq=False)
class StartFromField:
    """The Gaussians that training starts from, and the emulated values that they follow."""

    gaussians: FieldGaussians
    emulated: EmulatedValues

    __repr__ = one_line


def start_from_field(
    settings: TrainingSettings, emulator: FieldEmulator, field: FieldValues, normalization: Normalization
) -> StartFromField:
    """The start of `settings.gaussians` Gaussians that carry values of `field`.

    Each is a ball as large as the room that it has, of the mean value at its place, and as thick as the medium there.
    """
    count, random = settings.gaussians, generator(settings.seed, "initialization")
    places, distances = _places(emulator, field, count, random)  # [N, 3], [N], world units
    thickness = torch.from_numpy(THICKNESS * distances / field.base.opacity_unit_distance).float().clamp(min=1e-3)
    emulated = values_at(emulator, field, places)
    values = torch.stack([emulated.carried_means, torch.full((count,), math.log(SPREAD))], dim=1)  # [N, 2]
    gaussians = FieldGaussians(
        means=torch.from_numpy(normalization.points(places)).float(),
        log_scales=torch.from_numpy(np.log(SCALE * distances / normalization.extent)).float()[:, None].repeat(1, 3),
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        opacity_logits=thickness + torch.log(-torch.expm1(-thickness)),
        values=values,
        field=field,
    )
    return StartFromField(gaussians, emulated)


def _places(
    emulator: FieldEmulator, field: FieldValues, count: int, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World places (N, 3), more of them where members are opaque, and the distance of neighbours around each (N,)."""
    shape, spacing, origin = emulator.shape, np.array(emulator.spacing), np.array(emulator.origin)
    density = _density(emulator, field)  # [V]
    chosen = random.choice(len(density), count, p=density)  # [N]
    cells = np.stack(np.unravel_index(chosen, shape), axis=1)[:, ::-1]  # [N, 3], x, y, z
    last = np.array(shape[::-1]) - 1  # [3]
    steps = np.clip(cells + random.uniform(-0.5, 0.5, (count, 3)), 0.0, last)  # [N, 3]
    room = spacing.prod() / (count * density[chosen])  # [N], world units cubed
    return origin + spacing * steps, room ** (1.0 / 3.0)


def _density(emulator: FieldEmulator, field: FieldValues) -> NDArray[np.float64]:
    """The share of the Gaussians in each sample's cell, (V,), none in holes that all members have."""
    points = emulator.processes.points
    some = points[:: max(1, len(points) // MOST_MEMBERS)][:MOST_MEMBERS]
    opacity = np.mean([field.base.opacities(emulator.at(point).values.ravel()) for point in some], axis=0)  # [V]
    inside = np.ones(len(opacity)) if emulator.solid is None else (~emulator.solid).astype(float)
    shares = [inside / inside.sum()]
    if (opacity * inside).any():
        shares.append(opacity * inside / (opacity * inside).sum())
    return shares[0] if len(shares) == 1 else EVEN * shares[0] + (1.0 - EVEN) * shares[1]


def values_at(emulator: FieldEmulator, field: FieldValues, places: NDArray[np.float64]) -> EmulatedValues:
    """The emulator's mean and modes at world places (N, 3), outside of its box those of the nearest place inside."""
    low = np.array(emulator.origin)  # [3]
    high = low + np.array(emulator.spacing) * (np.array(emulator.shape[::-1]) - 1)  # [3]
    corners = Corners.of(np.clip(places, low, high), emulator.shape, emulator.spacing, emulator.origin)
    means = torch.from_numpy(corners.average(emulator.mean)).float()  # [N]
    modes = torch.from_numpy(corners.average(emulator.modes).T.copy()).float()  # [N, K]
    return EmulatedValues(means, modes, emulator.processes, None if emulator.scale else field.scale)
