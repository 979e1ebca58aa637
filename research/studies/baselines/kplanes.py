"""K-Planes factorizes a radiance field over space and parameters into planes, one for each pair of coordinates; its hybrid form.

Fridovich-Keil et al. 2023, "K-Planes: Explicit Radiance Fields in Space, Time, and Appearance", CVPR.  Sizes, rates, weights and
starts are those of the official code (github.com/sarafridov/K-Planes) for the synthetic dynamic scenes of D-NeRF.

    features(q) = product over all pairs (a, b) of coordinates of plane_ab(q_a, q_b),   those of several resolutions side by side
    geometry, log density = network(features),   color = network(harmonics of the direction, geometry)

Here q are three coordinates in the volume's box and any number of parameters; the publication has one, time. A plane
that involves parameters starts at 1: initially nothing depends on them. The official code does so with one parameter
only. With more it draws all planes from U(0.1, 0.5). Gradients, products of all planes but one, then shrink with each:
with six parameters, thus 36 planes, nothing is learnt. `METHOD` starts any number at 1, `NAIVE` is the other start.

Near and far are where a ray crosses the box, not the official 2 and 6.  Weights of networks start as in tiny-cuda-nn, but without
its padding to multiples of 16.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines.kplanes_field import (
    HIGHEST,
    HIGHEST_OF_PROPOSALS,
    OFFICIAL,
    SMALL,
    SMOOTHNESS,
    SMOOTHNESS_OF_PROPOSALS,
    KPlanesArchitecture,
    Planes,
    ProposalField,
    RadianceField,
    SamplePoints,
)
from research.studies.baselines.kplanes_proposals import (
    STEPS,
    WeightedSamples,
    interlevel_loss,
    middles,
    proposals_learn,
    proposed,
    sampled,
    sharpness_at,
)
from research.studies.baselines.method import Fit, Method, Plan, Prepared, Renderer, TrainingImages
from research.studies.baselines.radiance import composite
from research.studies.baselines.rays import PixelSampler, Rays, all_rays, crossings
from research.studies.baselines.state import State, inner, of_optimizer, outer, restore_optimizer

RATE = 0.01  # Adam's, of everything
WARM_UP = 512  # steps in which it grows to that
CYCLES = 0.999  # fraction of half a cosine of the decay afterwards
EPSILON = 1e-15  # Adam's
CHUNK = 1024  # rays of a picture at once; official are 8,192, which on a processor takes a third longer


class Traced(NamedTuple):
    """Colours of R rays, premultiplied RGBA `pixels` (R, 4), and the samples of each proposal and of the radiance field."""

    pixels: Tensor  # [R, 4]
    samples: Sequence[WeightedSamples]


class KPlanes(nn.Module):
    """The radiance field and its proposals."""

    def __init__(self, parameters: int, architecture: KPlanesArchitecture) -> None:
        super().__init__()
        self.counts = architecture.samples
        self.proposals = nn.ModuleList(ProposalField(parameters, r, architecture) for r in architecture.proposals)
        self.radiance = RadianceField(parameters, architecture)

    def start(self, random: torch.Generator, parameters_at_one: bool = True) -> None:
        """Initialize all planes and weights."""
        for name, part in self.named_modules():
            if isinstance(part, Planes):
                part.start(random, HIGHEST_OF_PROPOSALS if name.startswith("proposals") else HIGHEST, parameters_at_one)
            elif isinstance(part, nn.Linear):
                nn.init.xavier_uniform_(part.weight, generator=random)

    def forward(
        self,
        rays: Rays,
        parameters: Tensor,
        box: Tensor,
        sharpness: float = 1.0,
        *,
        random: torch.Generator | None = None,
        bfloat16: bool = False,
        teach_proposals: bool = True,
    ) -> Traced:
        """Colours of rays with parameters (R, P) in a box (2, 3), all of which cross it."""
        low, scale = box[0], 2.0 / (box[1] - box[0])  # [3]
        origins = ((rays.origins - low) * scale - 1.0).T[:, :, None]  # [3, R, 1]
        directions = (rays.directions * scale).T[:, :, None]  # [3, R, 1]

        def points(distances: Tensor) -> SamplePoints:
            return SamplePoints(origins + directions * distances, parameters.T)

        def densities(proposal: nn.Module) -> Callable[[Tensor], Tensor]:
            return lambda distances: cast(Tensor, proposal(points(distances), bfloat16))

        with torch.set_grad_enabled(teach_proposals and torch.is_grad_enabled()):
            proposals = [densities(proposal) for proposal in self.proposals]
            samples, borders = proposed(*crossings(rays, box), proposals, self.counts, sharpness, random)
        density, colors = self.radiance(points(middles(borders)), rays.directions, bfloat16)  # [R, S], [R, S, 3]
        last = sampled(borders, density)
        return Traced(composite(last.weights, colors), [*samples, last])

    def regularization(self) -> Tensor:
        """The weighted losses of all planes."""
        levels = [cast(Planes, level).regularization(SMOOTHNESS) for level in self.radiance.levels]
        planes = [cast(ProposalField, proposal).planes for proposal in self.proposals]
        return torch.stack(levels + [each.regularization(SMOOTHNESS_OF_PROPOSALS) for each in planes]).sum()


def rate_at(fraction: float) -> float:
    """The factor on Adam's rate after a `fraction` of all steps: it grows from 0, then falls to nearly 0 like half a cosine."""
    place = fraction * STEPS
    if place < WARM_UP:
        return place / WARM_UP
    return 0.5 * (1.0 + math.cos(math.pi * CYCLES * (place - WARM_UP) / (STEPS - WARM_UP)))


class KPlanesTraining:
    """Training of K-Planes on images, on the device of their parameters."""

    def __init__(self, pictures: TrainingImages, plan: Plan, parameters_at_one: bool = True) -> None:
        device = pictures.parameters.device
        self.architecture = OFFICIAL if plan.size == "official" else SMALL
        self._plan, self._step, self._waited = plan, 0, 0
        self._random = torch.Generator().manual_seed(plan.seed)
        self._jitter = self._random if device.type == "cpu" else torch.Generator(device).manual_seed(plan.seed)
        with torch.device("meta"):  # or torch.nn would draw from its own random numbers
            self.model = KPlanes(pictures.parameters.shape[1], self.architecture)
        self.model.to_empty(device="cpu").start(self._random, parameters_at_one)
        self.model.to(device)
        self._optimizer = torch.optim.Adam(self.model.parameters(), eps=EPSILON, fused=True)
        views, parameters = pictures.views.cpu(), pictures.parameters.cpu()
        self._pixels = PixelSampler(replace(pictures, views=views, parameters=parameters))
        self._box = pictures.box.to(device)
        self._background = None if pictures.background is None else torch.tensor(pictures.background, device=device)

    def advance(self) -> float:
        """One step; returns the sum of all losses."""
        fraction = self._step / self._plan.steps
        learn = proposals_learn(fraction, self._waited)
        loss = self._loss(sharpness_at(fraction), learn)
        for group in self._optimizer.param_groups:
            group["lr"] = RATE * self._plan.rate * rate_at(fraction)
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        self._step, self._waited = self._step + 1, 1 if learn else self._waited + 1
        return float(loss.detach())

    def at(self, parameters: Tensor) -> Renderer:
        """See `Fit`."""
        return partial(self._picture, parameters)

    def tensors(self) -> Mapping[str, Tensor]:
        """All planes and weights, including the proposals'."""
        return {name: tensor for name, tensor in self.model.state_dict().items() if tensor.numel()}

    def state(self) -> State:
        """See `Fit`."""
        draws = {"pixels": self._random.get_state(), "jitter": self._jitter.get_state()}
        waited = {"steps": torch.tensor(float(self._waited))}
        return outer(adam=of_optimizer(self._optimizer), random=draws, waited=waited)

    def restore(self, step: int, state: State) -> None:
        """See `Fit`."""
        restore_optimizer(self._optimizer, inner(state, "adam"))
        self._random.set_state(state["random.pixels"])
        self._jitter.set_state(state["random.jitter"])
        self._step, self._waited = step, int(state["waited.steps"])

    def _picture(self, parameters: Tensor, camera: Camera) -> NDArray[np.float32]:
        rays = Rays(*(tensor.to(self._box) for tensor in all_rays(camera)))
        sharpness = sharpness_at(self._step / self._plan.steps)
        with torch.no_grad():
            chunks = [
                self._seen(Rays(*chunk), parameters.to(self._box).expand(len(chunk[0]), -1), sharpness).pixels
                for chunk in zip(*(tensor.split(CHUNK) for tensor in rays), strict=True)
            ]
        return torch.cat(chunks).view(camera.height, camera.width, 4).cpu().numpy()

    def _loss(self, sharpness: float, learn: bool) -> Tensor:
        batch = self._pixels.draw(self.architecture.rays, self._random)
        rays = Rays(*(tensor.to(self._box) for tensor in batch.rays))
        truths, parameters = batch.pixels.to(self._box), batch.parameters.to(self._box)  # [R, 4], [R, P]
        seen = self._seen(rays, parameters, sharpness, random=self._jitter, teach_proposals=learn)
        behind = torch.rand(3, generator=self._random).to(self._box) if self._background is None else self._background
        drawn, true = (pixels[:, :3] + (1.0 - pixels[:, 3:]) * behind for pixels in (seen.pixels, truths))  # [R, 3]
        *proposals, final = seen.samples
        count = len(truths) * final.weights.shape[1]  # rays that miss the box have no loss
        interlevel = sum((interlevel_loss(proposal, final).sum() for proposal in proposals), start=drawn.new_zeros(()))
        return mse_loss(drawn, true) + interlevel / count + self.model.regularization()

    def _seen(self, rays: Rays, parameters: Tensor, sharpness: float, **options: Any) -> Traced:
        """Colours of rays with parameters (R, P); rays that miss the box have no samples."""
        near, far = crossings(rays, self._box)
        (hit,) = torch.nonzero(far > near, as_tuple=True)  # [H]
        bfloat16 = self._plan.precision == "bfloat16"
        crossing = Rays(*(tensor[hit] for tensor in rays))
        traced = self.model(crossing, parameters[hit], self._box, sharpness, bfloat16=bfloat16, **options)
        pixels = traced.pixels.new_zeros(len(near), 4).index_copy(0, hit, traced.pixels)  # [R, 4]
        return Traced(pixels, traced.samples)


def begin(pictures: TrainingImages, plan: Plan, prepared: Prepared, *, parameters_at_one: bool = True) -> Fit:
    """The training before its first step."""
    return KPlanesTraining(pictures, plan, parameters_at_one)


METHOD = Method("k-planes", "K-Planes (hybrid)", "Fridovich-Keil et al. 2023", STEPS, begin)
NAIVE = Method(
    "k-planes-naive",
    "K-Planes (hybrid), all planes drawn from U(0.1, 0.5)",
    METHOD.source,
    STEPS,
    partial(begin, parameters_at_one=False),
)
