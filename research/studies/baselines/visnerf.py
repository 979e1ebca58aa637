"""ViSNeRF learns a radiance field over space and the parameters, whose rays are summed up sample by sample.

Yao et al. 2025, IEEE PacificVis; the field and the full reference are in `visnerf_field`. Rendering, losses and
schedules are those of the released code with its settings for Nyx. Every image is shown over the background that it is
judged on. Alpha, the sum of a ray's weights, is therefore learnt from the background that shows through.

    loss = mean squared error + 8e-5 (mean |plane| + mean |line| + mean |vector - 1|), of the density,
           + w(step) (1e-2 TV(planes) + 1e-3 TV(vectors)), of the colour, w = 1 at first and 0.1 in the end

A training ray has 64 samples at first and 196 after two thirds of the steps. They lie a common distance apart and are
moved together by a random part of it. An image has a sample every half voxel. These settings have no mask of empty
space.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines.method import Fit, Method, Plan, Prepared, Renderer, Size, TrainingImages
from research.studies.baselines.radiance import composite, weights_of
from research.studies.baselines.rays import Batch, PixelSampler, Rays, all_rays, crossings
from research.studies.baselines.state import State, inner, of_optimizer, outer, restore_optimizer
from research.studies.baselines.visnerf_field import (
    AXES,
    QUANTITIES,
    ViSNeRFArchitecture,
    ViSNeRFField,
    grid_of,
    line_name,
    plane_name,
    variation,
    vector_lengths,
    vector_name,
)
from surrogate.randomness import generator

GRID_RATE, NETWORK_RATE = 0.02, 1e-3  # Adam's
MOMENTA = (0.9, 0.99)  # Adam's betas
DECAY = 0.1  # of rates and of the weight of total variation, over all steps
OFFICIAL_STEPS = 90_000
RESETS = (6_000, 9_000, 12_000, 16_500, 21_000)  # of these steps: Adam and the rates are reset
REFINED = 60_000  # of these steps: the number of samples is final
DISTANCE_SCALE = 25.0  # factor on lengths, to the unit of densities
LEAST_WEIGHT = 1e-4  # of a sample whose colour is evaluated
SPARSITY, PLANE_VARIATION, VECTOR_VARIATION = 8e-5, 1e-2, 1e-3
MOST_DRAWS = 64  # batches until enough rays cross the box
RAYS_AT_ONCE = 512  # in a picture


@dataclass(frozen=True)
class Sizes:
    """Sizes that are smaller on a processor: `rays` of a step, samples along one at first and finally, and voxels.

    `stride` is the number of voxels between the samples of an image.
    """

    rays: int = 4096
    first_samples: int = 64
    last_samples: int = 196
    stride: float = 0.5
    voxels: int = 2_097_156  # 128 cubed, and a little against rounding


SIZES: Mapping[Size, Sizes] = {
    "official": Sizes(),
    "small": Sizes(rays=1024, first_samples=32, last_samples=98, stride=1.0),
}


def resets(steps: int) -> frozenset[int]:
    """The steps, of all `steps`, before which Adam and the rates are reset."""
    return frozenset(round(at * steps / OFFICIAL_STEPS) for at in RESETS) - {0, steps}


def rate_factor(step: int, steps: int) -> float:
    """The factor on the rates at a step."""
    since = max((at for at in resets(steps) if at <= step), default=0)
    return float(DECAY ** ((step - since) / steps))


def variation_weight(step: int, steps: int) -> float:
    """The weight of total variation at a step; it is not reset."""
    return float(DECAY ** ((step + 1) / steps))


def sample_count(step: int, steps: int, sizes: Sizes) -> int:
    """Number of samples of a ray at a step."""
    part = min(step * OFFICIAL_STEPS / (steps * REFINED), 1.0)
    return math.ceil(sizes.first_samples + (sizes.last_samples - sizes.first_samples) * part)


class RaySamples(NamedTuple):
    """S samples along each of R rays, in scene coordinates, and the `lengths` (R, S) that they represent."""

    points: Tensor  # [R, S, 3]
    lengths: Tensor  # [R, S]


def marched(rays: Rays, near: Tensor, distance: Tensor | float, count: int, shift: Tensor | float = 0.0) -> RaySamples:
    """`count` samples from `near` (R,) on, `distance` apart, all moved by `shift` (R, 1) of it; the last one has no length."""
    numbers = torch.arange(count, device=near.device) + torch.as_tensor(shift, device=near.device)  # [R or none, S]
    at = near[:, None] + distance * numbers  # [R, S]
    lengths = torch.cat([at.diff(dim=1), torch.zeros_like(at[:, :1])], dim=1)
    return RaySamples(rays.origins[:, None] + rays.directions[:, None] * at[..., None], lengths)


def rendered(
    field: ViSNeRFField, box: Tensor, rays: Rays, parameters: Tensor, samples: RaySamples, skipped: Tensor
) -> Tensor:
    """Premultiplied RGBA (R, 4) of rays at parameters (R, P); samples of little weight have the colour `skipped` (3,)."""
    rows, count = samples.lengths.shape
    inside = ((samples.points >= box[0]) & (samples.points <= box[1])).all(dim=2)  # [R, S]
    points = ((samples.points - box[0]) * (2.0 / (box[1] - box[0])) - 1.0).flatten(0, 1)  # [R S, 3]

    at = inside.flatten().nonzero().squeeze(1)  # [N]
    values = field.densities(points[at], field.vectors_at("density", parameters)[at // count])  # [N]
    densities = values.new_zeros(rows * count).index_copy(0, at, values).view(rows, count)
    weights = weights_of(densities, samples.lengths * DISTANCE_SCALE)  # [R, S]

    at = (weights.detach() > LEAST_WEIGHT).flatten().nonzero().squeeze(1)  # [K]
    colors = skipped.expand(rows * count, 3)
    if len(at):  # otherwise the colour networks have no gradient, and Adam skips them
        seen = field.colors(
            points[at], field.vectors_at("color", parameters)[at // count], rays.directions[at // count]
        )
        colors = colors.index_copy(0, at, seen)
    return composite(weights, colors.view(rows, count, 3))


def skipped_color(behind: tuple[float, float, float]) -> tuple[float, ...]:
    """The colour of samples of little weight: black in front of white, as published.

    It must differ from the background. Nothing has much weight at first, and samples that look like the background are
    never learnt: the published black never begins to learn in front of black.
    """
    return tuple(0.0 if channel >= 0.5 else 1.0 for channel in behind)


class ViSNeRFTraining:
    """Training of a field; see `Fit`."""

    def __init__(self, pictures: TrainingImages, plan: Plan, sizes: Sizes) -> None:
        self._plan, self._sizes, self._box = plan, sizes, pictures.box
        architecture = ViSNeRFArchitecture(grid_of(pictures.box, sizes.voxels), vector_lengths(pictures.parameters))
        initial = architecture.initial(generator(plan.seed, "initialization"))
        tensors = {name: tensor.to(pictures.box.device).requires_grad_() for name, tensor in initial.items()}
        self.field = ViSNeRFField(tensors, architecture, plan.precision == "bfloat16")
        self._sampler = PixelSampler(pictures)
        self._random = torch.Generator().manual_seed(int(generator(plan.seed, "order").integers(2**63)))
        self._behind = self._box.new_tensor(pictures.behind)  # [3]
        self._skipped = self._box.new_tensor(skipped_color(pictures.behind))  # [3]
        self._optimizer = self._new_optimizer()
        self._step = 0

    def advance(self) -> float:
        """One step; returns its loss with all regularizers.  Raises ValueError where no ray crosses the box."""
        step, steps = self._step, self._plan.steps
        if step in resets(steps):
            self._optimizer = self._new_optimizer()
        for group in self._optimizer.param_groups:
            group["lr"] = group["first_rate"] * rate_factor(step, steps)
        loss = self._error(sample_count(step, steps, self._sizes)) + regularization(
            self.field, variation_weight(step, steps)
        )
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        self._step += 1
        return float(loss.detach())

    def at(self, parameters: Tensor) -> Renderer:
        """See `Fit`; a sample every `Sizes.stride` voxels."""
        return partial(self._picture, parameters)

    def tensors(self) -> Mapping[str, Tensor]:
        """See `Fit`."""
        return {name: tensor.detach() for name, tensor in self.field.tensors.items()}

    def state(self) -> State:
        """See `Fit`."""
        return outer(adam=of_optimizer(self._optimizer), random={"pixels": self._random.get_state()})

    def restore(self, step: int, state: State) -> None:
        """See `Fit`."""
        restore_optimizer(self._optimizer, inner(state, "adam"))
        self._random.set_state(state["random.pixels"])
        self._step = step

    @torch.no_grad()
    def _picture(self, parameters: Tensor, camera: Camera) -> NDArray[np.float32]:
        grid = torch.tensor(self.field.architecture.grid)  # [3]
        sides = (self._box[1] - self._box[0]).cpu()  # [3]
        distance = float((sides / (grid - 1)).mean()) * self._sizes.stride
        count = max(2, int(float(grid.double().norm()) / self._sizes.stride))
        parameters = parameters.to(self._box)[None]  # [1, P]
        parts = []
        everything = all_rays(camera)
        for start in range(0, len(everything.origins), RAYS_AT_ONCE):
            rays = Rays(*(part[start : start + RAYS_AT_ONCE].to(self._box) for part in everything))
            samples = marched(rays, crossings(rays, self._box)[0], distance, count)
            repeated = parameters.expand(len(rays.origins), -1)
            parts.append(rendered(self.field, self._box, rays, repeated, samples, self._skipped))
        picture: NDArray[np.float32] = torch.cat(parts).view(camera.height, camera.width, 4).cpu().numpy()
        return picture

    def _new_optimizer(self) -> torch.optim.Adam:
        tensors = self.field.tensors
        grids = {name for quantity in QUANTITIES for name in self.field.architecture.grids(quantity)}
        rates = {GRID_RATE: grids, NETWORK_RATE: tensors.keys() - grids}
        groups = [
            {
                "params": [tensor for name, tensor in tensors.items() if name in names],
                "first_rate": rate * self._plan.rate,
            }
            for rate, names in rates.items()
        ]
        return torch.optim.Adam(groups, betas=MOMENTA)

    def _error(self, count: int) -> Tensor:
        batch = crossing_pixels(self._sampler, self._box, self._sizes.rays, self._random)
        near, far = crossings(batch.rays, self._box)  # [R]
        shift = torch.rand(len(near), 1, generator=self._random).to(near)  # [R, 1]
        samples = marched(batch.rays, near, (far - near).max() / count, count, shift)
        drawn = rendered(self.field, self._box, batch.rays, batch.parameters, samples, self._skipped)  # [R, 4]
        return (self._over(drawn) - self._over(batch.pixels)).square().mean()

    def _over(self, pixels: Tensor) -> Tensor:
        return pixels[:, :3] + (1.0 - pixels[:, 3:]) * self._behind


def crossing_pixels(sampler: PixelSampler, box: Tensor, count: int, random: torch.Generator) -> Batch:
    """Pixels whose rays cross the box, on its device; the official code drops the others beforehand.

    They are `count`, or fewer where hardly any ray crosses the box. Raises ValueError where none does.
    """
    batches: list[Batch] = []
    missing = count
    for _ in range(MOST_DRAWS):
        drawn = sampler.draw(count, random)
        near, far = crossings(drawn.rays, box.cpu())  # [R]
        batches.append(_chosen(drawn, (far > near).nonzero().squeeze(1)[:missing]))
        missing -= len(batches[-1].pixels)
        if not missing:
            break
    if missing == count:
        raise ValueError(f"none of {MOST_DRAWS * count} rays crosses the box {box.tolist()}")
    rays = Rays(*(torch.cat(parts).to(box) for parts in zip(*(batch.rays for batch in batches), strict=True)))
    pixels = torch.cat([batch.pixels for batch in batches]).to(box)
    return Batch(rays, pixels, torch.cat([batch.parameters for batch in batches]).to(box))


def _chosen(batch: Batch, rows: Tensor) -> Batch:
    rays = Rays(batch.rays.origins[rows], batch.rays.directions[rows])
    return Batch(rays, batch.pixels[rows], batch.parameters[rows])


def regularization(field: ViSNeRFField, weight: float) -> Tensor:
    """Sparsity of the density's grids, vectors about 1, and total variation of the colour's with a `weight` (official code)."""
    tensors, parameters = field.tensors, range(len(field.architecture.vectors))
    density = [tensors[name("density", axes)].abs().mean() for axes in AXES for name in (plane_name, line_name)]
    density += [(tensors[vector_name("density", j)] - 1.0).abs().mean() for j in parameters]
    color = [PLANE_VARIATION * variation(tensors[plane_name("color", axes)]) for axes in AXES]
    color += [VECTOR_VARIATION * variation(tensors[vector_name("color", j)]) for j in parameters]
    return SPARSITY * torch.stack(density).sum() + weight * torch.stack(color).sum()


def begin(pictures: TrainingImages, plan: Plan, prepared: Prepared) -> Fit:
    """A training of `Plan.size`; "small" has a quarter of the rays and half the samples, in training and in images."""
    return ViSNeRFTraining(pictures, plan, SIZES[plan.size])


METHOD = Method("visnerf", "ViSNeRF", "Yao et al. 2025, IEEE PacificVis", OFFICIAL_STEPS, begin)
