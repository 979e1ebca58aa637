"""InSituNet renders a whole image from parameters and a viewpoint with one convolutional network.

He et al. 2019, "InSituNet: Deep Image Synthesis for Parameter Space Exploration of Ensemble Simulations", IEEE TVCG
26(1). Where paper and official code (github.com/hewenbin/insitu_net) differ, the code is followed, except for Adam's
momentum, which is the paper's. The networks are in `insitunet_networks`.

    loss = mean squared error + 1e-2 softplus(-D(picture)),   D = a discriminator that sees parameters and view, too

The published loss compares features of VGG19, whose weights this package does not include: this is the official code's
`--mse-loss` mode, with its adversarial loss. Rates are constant as published, so the planned number of steps changes
nothing.

Limits: images are opaque and as large as the training images. The view is a direction, without the camera's distance,
field of view or roll. At the poles the azimuth is undefined, and views close to them that look alike have codes far
apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import mse_loss, softplus

from catalogs.vocabulary.cameras import Camera, spherical_angles
from research.studies.baselines.insitunet_networks import Discriminator, Generator, InSituNetArchitecture, start
from research.studies.baselines.method import Fit, Method, Plan, Prepared, Renderer, Size, TrainingImages
from research.studies.baselines.state import State, inner, of_optimizer, outer, restore_optimizer
from surrogate.training.sampling import ShuffledEpochs

ADVERSARIAL = 1e-2  # weight of the adversarial loss
RATE = 1e-3  # Adam's, of both networks
MOMENTA = (0.0, 0.999)  # Adam's betas, the paper's; the code's own are 0.9 and 0.999
OFFICIAL_STEPS = 125_000  # of batches of 50


class NetworkSize(NamedTuple):
    """The unit of the networks' channels, and pictures a step."""

    channels: int
    batch: int


EXTENTS: dict[Size, NetworkSize] = {"official": NetworkSize(64, 50), "small": NetworkSize(16, 8)}


def discriminator_loss(real: Tensor, fake: Tensor) -> Tensor:
    """Loss of a discriminator with the scores `real` and `fake` (B,) of true and generated images."""
    return softplus(-real).mean() + softplus(fake).mean()


def generator_loss(drawn: Tensor, truths: Tensor, scores: Tensor) -> Tensor:
    """Loss of a generator whose images (B, 3, S, S), to match `truths`, got these scores (B,)."""
    return mse_loss(drawn, truths) + ADVERSARIAL * softplus(-scores).mean()


def encoded_view(camera: Camera, box: Tensor) -> Tensor:
    """(cos azimuth, sin azimuth, elevation / 90 degrees) of a camera around the middle of a box (2, 3), (3,) float32."""
    azimuth, polar = spherical_angles(camera.position - box.mean(dim=0).double().cpu().numpy())
    turn = np.deg2rad(azimuth)
    return torch.tensor([np.cos(turn), np.sin(turn), 1.0 - polar / 90.0], dtype=torch.float32)


class InSituNetTraining:
    """Training of a generator and a discriminator by turns, on the device of the images' parameters."""

    def __init__(self, pictures: TrainingImages, plan: Plan) -> None:
        extent = EXTENTS[plan.size]
        height, width = pictures.pixels.shape[1:3]
        if height != width:
            raise ValueError(f"InSituNet draws square pictures, got {height} x {width}")
        self._pictures, self._precision = pictures, plan.precision
        self._batch, self._step = min(extent.batch, len(pictures)), 0
        self._order = ShuffledEpochs(len(pictures), plan.seed)
        self._device = pictures.parameters.device
        self.architecture = InSituNetArchitecture(height, pictures.parameters.shape[1], channels=extent.channels)
        views = torch.stack([encoded_view(camera, pictures.box) for camera in pictures.cameras])  # [V, 3]
        seen = views[pictures.views.cpu()].to(self._device)  # [M, 3]
        self._conditions = torch.cat([pictures.parameters, seen], dim=1)  # [M, P + 3]
        random = torch.Generator().manual_seed(plan.seed)
        with torch.device("meta"):  # so that torch.nn draws no random numbers of its own
            self.generator, self.discriminator = Generator(self.architecture), Discriminator(self.architecture)
        for network in (self.generator, self.discriminator):
            start(network.to_empty(device="cpu"), random)
            # channels last take bfloat16 steps 0.6 of the time on a processor; the stubs do not know the argument
            network.to(self._device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._generator_steps = _adam(self.generator, plan)
        self._discriminator_steps = _adam(self.discriminator, plan)

    def advance(self) -> float:
        """One step of the discriminator, then one of the generator on the same images; returns the generator's loss."""
        chosen = [self._order[self._step * self._batch + place] for place in range(self._batch)]
        conditions = self._conditions[chosen]  # [B, P + 3]
        truths = 2.0 * self._pictures.over(chosen).permute(0, 3, 1, 2).to(self._device) - 1.0  # [B, 3, S, S]
        self.generator.train()
        with self._cast():
            drawn = self.generator(conditions)  # [B, 3, S, S]
        self._teach(conditions, truths, drawn.detach())
        self._step += 1
        return self._improve(conditions, truths, drawn)

    def at(self, parameters: Tensor) -> Renderer:
        """See `Fit`; images are opaque, over the background, and cameras of another size raise ValueError."""
        return partial(self._picture, parameters)

    def tensors(self) -> Mapping[str, Tensor]:
        """A copy of the generator's tensors, with the running means and variances of its normalizations."""
        state = self.generator.state_dict()
        drawn_with = {name: tensor for name, tensor in state.items() if not name.endswith("num_batches_tracked")}
        return {name: t.clone(memory_format=torch.contiguous_format) for name, t in drawn_with.items()}

    def state(self) -> State:
        """See `Fit`; includes the running means and variances of the maps."""
        return outer(
            generator=of_optimizer(self._generator_steps),
            discriminator=of_optimizer(self._discriminator_steps),
            maps={name: tensor for name, tensor in self.generator.named_buffers() if tensor.is_floating_point()},
        )

    def restore(self, step: int, state: State) -> None:
        """See `Fit`."""
        restore_optimizer(self._generator_steps, inner(state, "generator"))
        restore_optimizer(self._discriminator_steps, inner(state, "discriminator"))
        maps = dict(self.generator.named_buffers())
        for name, tensor in inner(state, "maps").items():
            maps[name].copy_(tensor)
        self._step = step

    def _picture(self, parameters: Tensor, camera: Camera) -> NDArray[np.float32]:
        size = self.architecture.resolution
        if (camera.height, camera.width) != (size, size):
            raise ValueError(f"pictures have {size} x {size} pixels, the camera {camera.height} x {camera.width}")
        conditions = torch.cat([parameters.to(self._device), encoded_view(camera, self._pictures.box).to(self._device)])
        self.generator.eval()
        with torch.no_grad(), self._cast():
            drawn = self.generator(conditions.unsqueeze(0))[0]  # [3, S, S]
        colors = (drawn.permute(1, 2, 0) + 1.0) / 2.0  # [S, S, 3]
        return torch.cat([colors, torch.ones_like(colors[..., :1])], dim=-1).cpu().numpy()

    def _teach(self, conditions: Tensor, truths: Tensor, drawn: Tensor) -> None:
        with self._cast():
            real, fake = self.discriminator(conditions, truths), self.discriminator(conditions, drawn)  # [B]
        self._discriminator_steps.zero_grad()
        discriminator_loss(real, fake).backward()
        self._discriminator_steps.step()

    def _improve(self, conditions: Tensor, truths: Tensor, drawn: Tensor) -> float:
        self.discriminator.requires_grad_(False)
        with self._cast():
            scores = self.discriminator(conditions, drawn)  # [B]
        loss = generator_loss(drawn, truths, scores)
        self._generator_steps.zero_grad()
        loss.backward()
        self._generator_steps.step()
        self.discriminator.requires_grad_(True)
        return float(loss.detach())

    def _cast(self) -> AbstractContextManager[object]:
        return torch.autocast(self._device.type, dtype=torch.bfloat16, enabled=self._precision == "bfloat16")


def _adam(network: nn.Module, plan: Plan) -> torch.optim.Adam:
    return torch.optim.Adam(network.parameters(), lr=RATE * plan.rate, betas=MOMENTA)


def begin(pictures: TrainingImages, plan: Plan, prepared: Prepared) -> Fit:
    """The training before its first step. Raises ValueError for images that are not square or of none of `RESOLUTIONS`."""
    return InSituNetTraining(pictures, plan)


METHOD = Method("insitunet", "InSituNet", "He et al. 2019", OFFICIAL_STEPS, begin)
