"""InSituNet draws a whole picture from parameters and a viewpoint with one convolutional network.

He et al. 2019, "InSituNet: Deep Image Synthesis for Parameter Space Exploration of Ensemble Simulations", IEEE TVCG 26(1); where
paper and official code (github.com/hewenbin/insitu_net) differ, the code is followed, except for Adam's momentum, the paper's.

    subnets: Linear-ReLU-Linear-ReLU, one each for simulation parameters, visualization parameters and the view, concatenated
    generator: linear map of the subnets' features to 4x4 pixels, then residual blocks that double the resolution each
    loss = mean squared error + 1e-2 softplus(-D(picture)),   D = a discriminator that sees parameters and view, too

The published loss compares features of VGG19, whose weights are no part of this package: this is the official code's `--mse-loss`
mode, with its adversarial loss and, as by default there, without spectral normalization.  Rates are constant as published, so
the planned number of steps changes nothing.

What it can't do: pictures are opaque and as large as those it learnt from, and the view is a direction: neither the camera's
distance nor its field of view nor its roll is seen.  At the poles the azimuth is undefined, and views close to them that look
alike have codes far apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, mse_loss, relu, softplus

from catalogs.cameras import Camera, spherical_angles
from surrogate.studies.baselines.method import Fit, Method, Pictures, Plan, Prepared, Renderer, Size
from surrogate.studies.baselines.state import State, inner, of_optimizer, outer, restore_optimizer
from surrogate.training.sampling import ShuffledEpochs

VIEW = 3  # numbers that a viewpoint is encoded by
FIRST_RESOLUTION = 4  # of the generator's first maps
MAPS = (16, 16, 8, 8, 4, 2, 1, 1)  # channels at 4, 8, 16, ... 512 pixels, in units of `Architecture.channels`
RESOLUTIONS = tuple(FIRST_RESOLUTION << doublings for doublings in range(2, len(MAPS)))
ADVERSARIAL = 1e-2  # weight of the adversarial loss
RATE = 1e-3  # Adam's, of both networks
MOMENTA = (0.0, 0.999)  # Adam's betas, the paper's; the code's own are 0.9 and 0.999
OFFICIAL_STEPS = 125_000  # of batches of 50


class Extent(NamedTuple):
    """The unit of the networks' channels, and pictures a step."""

    channels: int
    batch: int


EXTENTS: dict[Size, Extent] = {"official": Extent(64, 50), "small": Extent(16, 8)}


@dataclass(frozen=True)
class Architecture:
    """How large both networks are.

    Attributes
    ----------
    resolution : pixels of a picture's side, one of `RESOLUTIONS`.
    parameters : how many the ensemble has.
    visualization : so many of the last parameters belong to the visualization and have a subnet of their own.
    channels : the unit of the channels of all maps.
    width : of the subnets' layers.

    Published for 256 pixels; fewer drop the generator's last blocks, 512 add one, and the discriminator mirrors them.  With 6
    parameters, 3 of them of the visualization, the published networks have 60,974,019 and 45,769,409 parameters.
    """

    resolution: int
    parameters: int
    visualization: int = 0
    channels: int = 64
    width: int = 512

    def __post_init__(self) -> None:
        if self.resolution not in RESOLUTIONS:
            raise ValueError(f"InSituNet draws square pictures of {RESOLUTIONS} pixels, got {self.resolution}")
        if not 0 <= self.visualization <= self.parameters:
            raise ValueError(f"visualization must be 0 to {self.parameters}, all parameters, got {self.visualization}")

    @property
    def kinds(self) -> list[int]:
        """How many numbers each subnet sees: simulation parameters, visualization parameters, view; kinds of none are left out."""
        sizes = [self.parameters - self.visualization, self.visualization, VIEW]
        return [size for size in sizes if size]

    @property
    def maps(self) -> list[int]:
        """Channels at 4 pixels, at 8, and so on up to the resolution."""
        doublings = (self.resolution // FIRST_RESOLUTION).bit_length() - 1
        return [self.channels * units for units in MAPS[: doublings + 1]]


class Subnets(nn.Module):
    """Features of what a picture depends on: each kind's from its own two layers, side by side."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.kinds, width = architecture.kinds, architecture.width
        self.columns = len(self.kinds) * width
        self.subnets = nn.ModuleList(
            nn.Sequential(nn.Linear(size, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()) for size in self.kinds
        )

    def forward(self, conditions: Tensor) -> Tensor:
        """Features (B, `columns`) of conditions (B, P + 3)."""
        parts = conditions.split(self.kinds, dim=1)
        return torch.cat([subnet(part) for subnet, part in zip(self.subnets, parts, strict=True)], dim=1)


class GeneratorBlock(nn.Module):
    """Doubles the resolution: BN-ReLU-up-conv3-BN-ReLU-conv3, plus a 1x1 convolution of the input, all without biases."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.shortcut = nn.Conv2d(before, after, 1, bias=False)
        self.first_norm = nn.BatchNorm2d(before)
        self.first = nn.Conv2d(before, after, 3, padding=1, bias=False)
        self.second_norm = nn.BatchNorm2d(after)
        self.second = nn.Conv2d(after, after, 3, padding=1, bias=False)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, before, S, S) to (B, after, 2 S, 2 S)."""
        inner = self.first(_doubled(relu(self.first_norm(maps))))  # [B, after, 2 S, 2 S]
        inner = self.second(relu(self.second_norm(inner)))
        # the shortcut's 1x1 convolution gives the same before the doubling as after it, at a quarter of the cost
        return inner + _doubled(self.shortcut(maps))


class Generator(nn.Module):
    """Draws pictures."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        maps = architecture.maps
        self.subnets = Subnets(architecture)
        self.start = nn.Linear(self.subnets.columns, maps[0] * FIRST_RESOLUTION**2, bias=False)
        self.blocks = nn.Sequential(*(GeneratorBlock(before, after) for before, after in pairwise(maps)))
        self.norm = nn.BatchNorm2d(maps[-1])
        self.colors = nn.Conv2d(maps[-1], 3, 3, padding=1)

    def forward(self, conditions: Tensor) -> Tensor:
        """Pictures (B, 3, S, S) in [-1, 1] for conditions (B, P + 3)."""
        start = self.start(self.subnets(conditions))
        maps = start.reshape(len(start), -1, FIRST_RESOLUTION, FIRST_RESOLUTION)  # [B, C, 4, 4]
        return torch.tanh(self.colors(relu(self.norm(self.blocks(maps)))).float())


class DiscriminatorBlock(nn.Module):
    """Halves the resolution, or keeps it: ReLU-conv3-ReLU-conv3-pool, plus a pooled 1x1 convolution where anything changes.

    The one that sees `pixels` has no ReLU before its first convolution.
    """

    def __init__(self, before: int, after: int, *, halved: bool = True, pixels: bool = False) -> None:
        super().__init__()
        self.halved, self.pixels = halved, pixels
        self.shortcut = nn.Conv2d(before, after, 1) if halved or before != after else nn.Identity()
        self.first = nn.Conv2d(before, after, 3, padding=1)
        self.second = nn.Conv2d(after, after, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, before, S, S) to (B, after, S / 2, S / 2), or S where it is not halved."""
        inner = self.second(relu(self.first(maps if self.pixels else relu(maps))))
        if not self.halved:
            return inner + self.shortcut(maps)
        # the shortcut's 1x1 convolution gives the same after the mean as before it, at a quarter of the cost
        return avg_pool2d(inner, 2) + self.shortcut(avg_pool2d(maps, 2))


class Discriminator(nn.Module):
    """Scores how real pictures look for their conditions: a linear map of their features plus a projection on the conditions'.

    Miyato & Koyama 2018, "cGANs with Projection Discriminator".
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        maps = architecture.maps[::-1]
        self.subnets = Subnets(architecture)
        self.projection = nn.Linear(self.subnets.columns, maps[-1])
        self.blocks = nn.Sequential(
            DiscriminatorBlock(3, maps[0], pixels=True),
            *(DiscriminatorBlock(before, after) for before, after in pairwise(maps[:-1])),
            DiscriminatorBlock(maps[-2], maps[-1], halved=False),
        )
        self.score = nn.Linear(maps[-1], 1)

    def forward(self, conditions: Tensor, pictures: Tensor) -> Tensor:
        """Scores (B,) of conditions (B, P + 3) and pictures (B, 3, S, S): large where they look real."""
        features = relu(self.blocks(pictures)).float().sum(dim=(2, 3))  # [B, C]
        projected = relu(self.projection(self.subnets(conditions))).float()  # [B, C]
        return (features * (projected + self.score.weight)).sum(dim=1) + self.score.bias


def discriminator_loss(real: Tensor, fake: Tensor) -> Tensor:
    """The loss of a discriminator that gave scores `real` and `fake` (B,) to true pictures and to the generator's."""
    return softplus(-real).mean() + softplus(fake).mean()


def generator_loss(drawn: Tensor, truths: Tensor, scores: Tensor) -> Tensor:
    """The loss of a generator whose pictures (B, 3, S, S), to be like `truths`, got these scores (B,)."""
    return mse_loss(drawn, truths) + ADVERSARIAL * softplus(-scores).mean()


def encoded_view(camera: Camera, box: Tensor) -> Tensor:
    """(cos azimuth, sin azimuth, elevation / 90 degrees) of a camera around the middle of a box (2, 3), (3,) float32."""
    azimuth, polar = spherical_angles(camera.position - box.mean(dim=0).double().cpu().numpy())
    turn = np.deg2rad(azimuth)
    return torch.tensor([np.cos(turn), np.sin(turn), 1.0 - polar / 90.0], dtype=torch.float32)


class Training:
    """A generator and a discriminator that learn from pictures by turns, on the device of the pictures' parameters."""

    def __init__(self, pictures: Pictures, plan: Plan) -> None:
        extent = EXTENTS[plan.size]
        height, width = pictures.pixels.shape[1:3]
        if height != width:
            raise ValueError(f"InSituNet draws square pictures, got {height} x {width}")
        self._pictures, self._precision = pictures, plan.precision
        self._batch, self._step = min(extent.batch, len(pictures)), 0
        self._order = ShuffledEpochs(len(pictures), plan.seed)
        self._device = pictures.parameters.device
        self.architecture = Architecture(height, pictures.parameters.shape[1], channels=extent.channels)
        views = torch.stack([encoded_view(camera, pictures.box) for camera in pictures.cameras])  # [V, 3]
        seen = views[pictures.views.cpu()].to(self._device)  # [M, 3]
        self._conditions = torch.cat([pictures.parameters, seen], dim=1)  # [M, P + 3]
        random = torch.Generator().manual_seed(plan.seed)
        with torch.device("meta"):  # or torch.nn would draw from its own random numbers
            self.generator, self.discriminator = Generator(self.architecture), Discriminator(self.architecture)
        for network in (self.generator, self.discriminator):
            start(network.to_empty(device="cpu"), random)
            # channels last take bfloat16 steps 0.6 of the time on a processor; the stubs do not know the argument
            network.to(self._device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._generator_steps = _adam(self.generator, plan)
        self._discriminator_steps = _adam(self.discriminator, plan)

    def advance(self) -> float:
        """One step of the discriminator, then one of the generator on the same pictures; returns the generator's loss."""
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
        """See `Fit`; pictures are opaque, over the background, and cameras of another size a ValueError."""
        return partial(self._picture, parameters)

    def tensors(self) -> Mapping[str, Tensor]:
        """A copy of what the generator consists of, with the running means and variances that its maps are normalized by."""
        state = self.generator.state_dict()
        drawn_with = {name: tensor for name, tensor in state.items() if not name.endswith("num_batches_tracked")}
        return {name: t.clone(memory_format=torch.contiguous_format) for name, t in drawn_with.items()}

    def state(self) -> State:
        """See `Fit`; with the running means and variances of the maps."""
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


def start(network: nn.Module, random: torch.Generator) -> None:
    """Set weights to random orthogonal matrices, biases to zero, and normalizations to the identity, as the official code does."""
    for part in network.modules():
        if isinstance(part, nn.Linear | nn.Conv2d):
            nn.init.orthogonal_(part.weight, generator=random)
            if part.bias is not None:
                nn.init.zeros_(part.bias)
        elif isinstance(part, nn.BatchNorm2d):
            part.reset_parameters()


def _adam(network: nn.Module, plan: Plan) -> torch.optim.Adam:
    return torch.optim.Adam(network.parameters(), lr=RATE * plan.rate, betas=MOMENTA)


def _doubled(maps: Tensor) -> Tensor:
    """(B, C, S, S) to (B, C, 2 S, 2 S), each value four times."""
    return interpolate(maps, scale_factor=2)


def begin(pictures: Pictures, plan: Plan, prepared: Prepared) -> Fit:
    """Both networks at their start.  Raises ValueError for pictures that are not square or of none of `RESOLUTIONS`."""
    return Training(pictures, plan)


METHOD = Method("insitunet", "InSituNet", "He et al. 2019", OFFICIAL_STEPS, begin)
