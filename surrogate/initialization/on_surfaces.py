"""A start on isosurfaces of the emulated field: Gaussians that move with the surfaces before anything is learnt.

Each begins on a surface of the middle member and follows the gradient to the surfaces of other members and isovalues.  Latents are
the strongest components of all these moves, and the network is taught what they do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.words import one_line
from native.ray_casting import SampledField
from native.ray_casting.triangles import Triangles
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.bilinear import LATENT_SPREAD
from surrogate.deformation.offsets import UNITS
from surrogate.emulation import FieldEmulator
from surrogate.emulation.corners import Corners
from surrogate.gaussians import Gaussians, Normalization
from surrogate.randomness import generator
from surrogate.settings import TrainingSettings

SIZE, THIN = 0.58, 0.3  # of a Gaussian along the surface, in distances of neighbours, and across it, as a share of that
OPACITY, NORMAL = 0.6, 0.95
FAINT = 4.0  # less is the logit of the opacity where no surface is near
REACH, NEAR, STEPS = (
    4.0,
    0.5,
    4,
)  # samples that a Gaussian moves at most, from where on no surface is near, and Newton's steps
MOST_MEMBERS, MOST_ISOVALUES = 4, 8  # that are followed
TAUGHT, RATE = 1_000, 1e-2  # steps of Adam, and its first rate
COLUMNS = {
    "means": slice(0, 3),
    "opacity_logits": slice(10, 11),
    "colors": slice(11, 14),
}  # of the offsets, that are taught
COUNTS = {"means": 4.0, "opacity_logits": 0.3, "colors": 1.0}  # of errors in units of the deformation

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EmulatedSurfaces:
    """The isosurfaces of an emulated field that a variation trains.

    Attributes
    ----------
    places : (T, 3, 3) corners of the middle member's triangles, world units, at all trained isovalues.
    shares : (T,) of the Gaussians that begin on each triangle.
    largest : the area of the largest surface.
    """

    emulator: FieldEmulator
    variation: Variation
    places: Array  # [T, 3, 3]
    shares: Array  # [T]
    largest: float

    __repr__ = one_line

    @classmethod
    def of(cls, emulator: FieldEmulator, variation: Variation) -> EmulatedSurfaces | None:
        """Those of the middle member; None where it has none."""
        points = emulator.processes.points
        field = _sampled(emulator, points[np.linalg.norm(points - points.mean(axis=0), axis=1).argmin()])
        places, shares, largest = [], [], 0.0
        for (isovalue,) in variation.trained:
            surface = Triangles.of(field, isovalue)
            world = np.array(field.origin) + np.array(field.spacing) * surface.places  # [V, 3]
            corners = world[surface.corners]  # [T, 3, 3]
            sides = corners[:, 1:] - corners[:, :1]  # [T, 2, 3]
            areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)  # [T]
            if areas.any():
                places.append(corners)
                shares.append(areas / math.sqrt(areas.sum()))  # small surfaces have more for their size
                largest = max(largest, float(areas.sum()))
        if not places:
            return None
        every = np.concatenate(shares)
        return cls(emulator, variation, np.concatenate(places), every / every.sum(), largest)

    def start(self, settings: TrainingSettings, normalization: Normalization) -> tuple[Gaussians, BilinearDeformation]:
        """The Gaussians, `settings.count_on_surfaces` many with normals for colours, and what moves them."""
        count, random = settings.count_on_surfaces, generator(settings.seed, "initialization")
        chosen, (u, v) = random.choice(len(self.shares), count, p=self.shares), random.random((2, count, 1))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)  # [N, 1]
        first, second, third = self.places[chosen].swapaxes(0, 1)  # [N, 3] each
        inputs, moved = self._moved(first + u * (second - first) + v * (third - first))  # [S, P + 1], [N, S, 7]
        moved[..., :3] = normalization.points(moved[..., :3].reshape(-1, 3)).reshape(*moved.shape[:2], 3)
        middle = torch.from_numpy(moved.mean(axis=1))  # [N, 7]
        size = SIZE * math.sqrt(self.largest / count) / normalization.extent
        gaussians = Gaussians(
            means=middle[:, :3].float(),
            log_scales=torch.tensor([1.0, 1.0, THIN]).mul(size).log().repeat(count, 1),
            quats=_turned(middle[:, 4:]).float(),
            opacity_logits=(math.log(OPACITY / (1.0 - OPACITY)) + middle[:, 3]).float(),
            colors=middle[:, 4:].float(),
        )
        deformation = BilinearDeformation.create(gaussians, inputs.shape[1], settings, for_visualization=True)
        return gaussians, _taught(deformation, inputs, moved - middle.numpy()[:, None])

    def _moved(self, places: Array) -> tuple[Array, NDArray[np.float32]]:
        """Normalized parameters (S, P + 1), and places, changes of opacity and normals there (N, S, 7) of Gaussians."""
        points = self.emulator.processes.points
        trained, inputs, moved = sorted(self.variation.trained), [], []
        for point in points[_spread(len(points), MOST_MEMBERS)]:
            level = _Levels.of(_sampled(self.emulator, point))
            for values in (trained[i] for i in _spread(len(trained), MOST_ISOVALUES)):
                inputs.append(np.append(point, self.variation.normalize(values)))
                moved.append(level.followed(places, values[0]))
        return np.array(inputs), np.stack(moved, axis=1)


def _spread(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most that many of `count` things, from the first to the last."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(np.int64))


def _sampled(emulator: FieldEmulator, point: Array) -> SampledField:
    field = emulator.at(point)
    return SampledField(field.values, field.holes, field.spacing, field.origin)


@dataclass(frozen=True, eq=False)
class _Levels:
    """A field's values and gradients, (V, 4)."""

    field: SampledField
    table: Array

    @classmethod
    def of(cls, field: SampledField) -> _Levels:
        values = field.filled.astype(np.float64)
        slopes = [np.gradient(values, field.spacing[axis], axis=2 - axis) for axis in range(3)]
        return cls(field, np.stack([values, *slopes], axis=-1).reshape(-1, 4))

    def followed(self, places: Array, isovalue: float) -> NDArray[np.float32]:
        """Places (N, 3) moved to a surface, how much fainter Gaussians are there, and the normals: (N, 7)."""
        side, at = min(self.field.spacing), places
        for _ in range(STEPS):
            values, slopes = self._at(at)
            step = slopes * ((isovalue - values) / np.maximum((slopes**2).sum(axis=1), 1e-300))[:, None]  # [N, 3]
            at = places + _shortened(at + _shortened(step, side) - places, REACH * side)
        values, slopes = self._at(at)
        steepness = np.maximum(np.linalg.norm(slopes, axis=1), 1e-150)  # [N]
        off = np.abs(isovalue - values) / (steepness * side)  # [N], samples
        faintness = -FAINT * np.clip(off / NEAR, 0.0, 1.0)  # [N]
        normals = NORMAL * slopes / steepness[:, None]  # [N, 3]
        return np.concatenate([at, faintness[:, None], normals], axis=1).astype(np.float32)

    def _at(self, places: Array) -> tuple[Array, Array]:
        """Values (N,) and gradients (N, 3) at places (N, 3), moved into the box."""
        high = self.field.origin + (self.field.size - 1) * self.field.spacing  # [3]
        inside = np.clip(places, self.field.origin, high)
        corners = Corners.of(inside, self.field.values.shape, self.field.spacing, self.field.origin)
        numbers = np.einsum("nc,nck->nk", corners.weights, self.table[corners.indices])  # [N, 4]
        return numbers[:, 0], numbers[:, 1:]


def _shortened(vectors: Array, longest: float) -> Array:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)  # [N, 1]
    return vectors * np.minimum(1.0, longest / np.maximum(lengths, 1e-300))


def _turned(normals: Tensor) -> Tensor:
    """Quaternions (N, 4) that turn z along normals (N, 3), in one direction or the other."""
    x, y, z = torch.nn.functional.normalize(normals * torch.where(normals[:, 2:] < 0.0, -1.0, 1.0), dim=1).unbind(1)
    return torch.nn.functional.normalize(torch.stack([1.0 + z, -y, x, torch.zeros_like(z)], dim=1), dim=1)


def _taught(deformation: BilinearDeformation, inputs: Array, moves: NDArray[np.float32]) -> BilinearDeformation:
    """The deformation whose offsets at `inputs` (S, P) are `moves` (N, S, 7), as nearly as its modes can."""
    count, settings, size = len(moves), len(inputs), deformation.latent_size
    used = np.r_[tuple(COLUMNS.values())]  # [7]
    factors = np.concatenate([np.full(c.stop - c.start, COUNTS[name] / UNITS[name]) for name, c in COLUMNS.items()])
    table = (moves * factors.astype(np.float32)).reshape(count, -1)  # [N, 7 S]
    _, directions = np.linalg.eigh((table.T @ table).astype(np.float64))  # [7 S, 7 S], the strongest last
    directions = directions[:, ::-1][:, :size]  # [7 S, L]
    latents = table @ directions  # [N, L]
    sizes = np.maximum(latents.std(axis=0) / LATENT_SPREAD, 1e-9)  # [L]
    wanted = np.zeros((settings, size, len(deformation.units)))
    wanted[:, : directions.shape[1], used] = (directions * sizes).reshape(settings, 7, -1).swapaxes(1, 2)
    own = deformation.latents.double().numpy().copy()  # [N, L]
    own[:, : directions.shape[1]] = latents / sizes
    deformation = replace(deformation, latents=torch.from_numpy(own).float()).copy()
    scales = torch.zeros(len(deformation.units))
    scales[torch.from_numpy(used)] = torch.from_numpy(factors).float()
    _teach(deformation, torch.from_numpy(inputs).float(), torch.from_numpy(wanted).float(), scales)
    return deformation.copy()


def _teach(deformation: BilinearDeformation, inputs: Tensor, modes: Tensor, scales: Tensor) -> None:
    """Let the network's modes at inputs (S, P), times scales (C,), come near `modes` (S, L, C): in place."""
    weights: Sequence[Tensor] = [
        tensor.requires_grad_()
        for name, tensor in deformation.tensors().items()
        if name not in deformation.per_gaussian
    ]
    adam = torch.optim.Adam(weights, lr=RATE)
    for k in range(TAUGHT):
        adam.param_groups[0]["lr"] = RATE * (1.0 - k / TAUGHT)
        adam.zero_grad()
        torch.nn.functional.mse_loss(torch.vmap(deformation.embedding)(inputs) * scales, modes).backward()
        adam.step()
