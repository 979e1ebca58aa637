"""GS-Surrogate (Li et al. 2026, arXiv:2604.06358) as published: one network moves every Gaussian of a canonical field.

    feature(x, p) = s(x) + adapter(e(p)),    offsets(x, p) = heads(backbone(feature))

Layers, starts, rates, loss and sampling are those of the authors' code (github.com/RumaliPerera/GS-Surrogate, the script for
XCompact3D and its isosurfaces).  `surrogate.deformation.field` is a lighter variant of the same idea.  As in that code:

- Lengths are measured by the cameras: positions are encoded in units of `extent_of` the cameras, and an offset of 1 is the distance
  of the farthest of them.  Parameters are encoded in [0, 1].
- The adapter sees the parameters only, and its last layer starts at 0, as those of the heads do.
- The rate of the network, 1e-4, and that of the means fall to a tenth, exponentially.  `stage2_canonical_lr_scale`, 0.001, is
  applied to the means alone; all else of the canonical Gaussians goes on at the constant rates of 3DGS (`Recipe`).
- The loss is 0.8 L1 + 0.2 (1 - SSIM) of one picture a step; the penalty of the offsets, L_deform, is off.
- Images are sampled with chances proportional to the power 1.5 of their last loss, or to 1 before they were sampled.\n
These chances are renewed after every fortieth of the training (2,000 of 80,000 steps), and are equal before that.

Differences: the canonical Gaussians are those of `research.studies.baselines.canonical`, with Adam's moments of zero.
SSIM has zeros beyond the border, where theirs leaves the border out. The loss compares alpha too, where images have
any, as that of the canonical Gaussians does. Isovalues and transfer functions are parameters like those of the
simulation, of one joint network; the authors train a second network for them. Both sizes of a plan are the published
one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import layer_norm, linear

from research.studies.baselines import canonical
from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.method import Method, Plan, Prepared, Renderer, TrainingImages
from research.studies.baselines.state import State, inner, of_optimizer, outer, restore_optimizer
from surrogate.deformation.positional import encode
from surrogate.randomness import generator
from surrogate.training.losses import image_loss

COLUMNS = {"means": 3, "log_scales": 3, "quats": 4, "opacity_logits": 1, "harmonics": 48}  # moved by each head
STILL_AT_FIRST = ("adapter", *COLUMNS)  # networks whose last layer starts at 0
MARGIN = 1.1  # of `extent_of` beyond the farthest camera
FINAL_FACTOR = 0.1  # of the rates that fall
OFFICIAL_STEPS = 80_000  # of the second stage
RENEWAL = 2_000  # of these steps between renewals of the images' chances
GAUSSIAN_EPSILON = 1e-15  # of Adam; the network has torch's 1e-8

Networks: TypeAlias = Mapping[str, Tensor]


@dataclass(frozen=True)
class GSSurrogateArchitecture:
    """Numbers of parameters, widths of the layers, and frequencies of the positional encodings."""

    parameters: int
    feature_width: int = 128
    hidden_width: int = 512
    position_frequencies: int = 10
    parameter_frequencies: int = 2

    def widths(self) -> dict[str, tuple[int, ...]]:
        """Input columns of each perceptron, then the outputs of its layers; encoders, adapter, backbone, then heads."""
        feature, hidden = self.feature_width, self.hidden_width
        return {
            "position": (3 * (1 + 2 * self.position_frequencies), hidden, hidden, feature),
            "parameters": (self.parameters * (1 + 2 * self.parameter_frequencies), hidden, feature),
            "adapter": (feature, feature, feature),
            "backbone": (feature, hidden, hidden, hidden),
            **{head: (hidden, hidden, columns) for head, columns in COLUMNS.items()},
        }

    def initial(self, random: np.random.Generator) -> dict[str, Tensor]:
        """Initial tensors of the networks by name, which move nothing; `adapter.1.weights` are those of the adapter's second layer.

        Weights and biases are uniform within 1 / sqrt(columns), as in `torch.nn.Linear`, or 0. All layers but the last
        of a perceptron, and that of the backbone too, have the `gains` and `shifts` of a LayerNorm.
        """
        tensors: dict[str, Tensor] = {}
        for network, widths in self.widths().items():
            for layer, (columns, rows) in enumerate(pairwise(widths)):
                last = layer == len(widths) - 2
                bound = 0.0 if last and network in STILL_AT_FIRST else 1.0 / math.sqrt(max(columns, 1))
                for part, shape in {"weights": (rows, columns), "biases": (rows,)}.items():
                    values = random.uniform(-bound, bound, shape).astype(np.float32)
                    tensors[f"{network}.{layer}.{part}"] = torch.from_numpy(values)
                if not last or network == "backbone":
                    tensors[f"{network}.{layer}.gains"] = torch.ones(rows)
                    tensors[f"{network}.{layer}.shifts"] = torch.zeros(rows)
        return tensors


@dataclass(frozen=True)
class Recipe:
    """Training of the network; the defaults are those of the authors' code.

    Attributes
    ----------
    rate : Adam's rate for the network.
    mean_factor : factor on the rate of the canonical means in 3DGS.
    other_factor : factor on the other rates of the canonical Gaussians; 0.001 nearly freezes them.
    ssim_weight : weight of 1 - SSIM in the loss; L1 has the rest.
    mining_power : power of the losses that gives the sampling chances; 0 samples all images alike.
    """

    rate: float = 1e-4
    mean_factor: float = 1e-3
    other_factor: float = 1.0
    ssim_weight: float = 0.2
    mining_power: float = 1.5

    def loss(self, drawn: Tensor, picture: Tensor) -> Tensor:
        """The loss of a rendered image (H, W, 4) against (H, W, 3 or 4), as in `image_loss`."""
        share = 1.0 - self.ssim_weight
        return share * image_loss(drawn, picture, ssim_weight=self.ssim_weight / share)


def rates(recipe: Recipe, plan: Plan, extent: float, step: int) -> dict[str, float]:
    """Adam's rates in a step, for the canonical Gaussians' leaves by name and for the "network"; `extent` as of `extent_of`."""
    decay = FINAL_FACTOR ** (step / plan.steps)
    by_name = {name: recipe.other_factor * rate for name, rate in canonical.RATES.items()}
    by_name["means"] = recipe.mean_factor * canonical.MEAN_RATE * extent / MARGIN * decay
    by_name["network"] = recipe.rate * decay
    return {name: plan.rate * rate for name, rate in by_name.items()}


def perceptron(networks: Networks, name: str, inputs: Tensor) -> Tensor:
    """The outputs (N, last columns) of the layers `name` for `inputs` (N, first columns)."""
    layer = 0
    while (weights := networks.get(f"{name}.{layer}.weights")) is not None:
        inputs = linear(inputs, weights, networks[f"{name}.{layer}.biases"])
        if f"{name}.{layer}.gains" in networks:
            inputs = _normalized(inputs, networks[f"{name}.{layer}.gains"], networks[f"{name}.{layer}.shifts"]).relu_()
        layer += 1
    return inputs


def _normalized(inputs: Tensor, gains: Tensor, shifts: Tensor) -> Tensor:
    if inputs.dtype == torch.float32:
        return layer_norm(inputs, inputs.shape[1:], gains, shifts)
    # With gains of its own, torch would sum their gradient in bfloat16, and lose most of it.
    whitened = layer_norm(inputs, inputs.shape[1:])
    return torch.addcmul(shifts.to(whitened), whitened, gains.to(whitened))


def offsets(
    networks: Networks, architecture: GSSurrogateArchitecture, places: Tensor, parameters: Tensor
) -> dict[str, Tensor]:
    """The heads' outputs (N, columns) by name, float32, from `places` (N, 3) in units of the extent and parameters (P,) in [-1, 1].

    The opacity's output has passed a tanh: its logit changes by less than 1.
    """
    encoded = encode(places, architecture.position_frequencies)  # [N, 63]
    condition = encode((parameters[None] + 1.0) / 2.0, architecture.parameter_frequencies)  # [1, 5 P]
    shift = perceptron(networks, "adapter", perceptron(networks, "parameters", condition))  # [1, F]
    features = perceptron(networks, "backbone", perceptron(networks, "position", encoded) + shift)  # [N, H]
    outputs = {head: perceptron(networks, head, features).float() for head in COLUMNS}
    return outputs | {"opacity_logits": outputs["opacity_logits"].tanh()}


class GSSurrogate:
    """Training of the second stage: of the network, and of the canonical Gaussians with it."""

    def __init__(
        self,
        pictures: TrainingImages,
        plan: Plan,
        prepared: Prepared,
        architecture: GSSurrogateArchitecture | None = None,
        recipe: Recipe | None = None,
    ) -> None:
        """Start from the `prepared` tensors of `HarmonicGaussians`, on their device; raises KeyError where one is missing."""
        self._pictures, self._plan, self._recipe = pictures, plan, recipe or Recipe()
        self._architecture = architecture or GSSurrogateArchitecture(pictures.parameters.shape[1])
        self._extent = canonical.extent_of(pictures.cameras)
        self._leaves = canonical.leaves_of(HarmonicGaussians.of_tensors(prepared))
        device = self._leaves["means"].device
        initial = self._architecture.initial(generator(plan.seed, "latents"))
        self._networks = {name: tensor.to(device).requires_grad_() for name, tensor in initial.items()}
        positions = np.array([camera.position for camera in pictures.cameras])  # [V, 3]
        self._center = torch.from_numpy(positions.mean(axis=0)).to(self._leaves["means"])  # [3]
        groups: list[dict[str, Any]]
        groups = [{"name": name, "params": [leaf], "eps": GAUSSIAN_EPSILON} for name, leaf in self._leaves.items()]
        groups += [{"name": "network", "params": list(self._networks.values())}]
        self._adam = torch.optim.Adam(groups)
        self._mining = HardMining(len(pictures), plan, self._recipe.mining_power)
        self._step = 0

    def advance(self) -> float:
        """One training step; returns its loss."""
        picture = self._mining.drawn(self._step)
        gaussians = self._deformed(self._pictures.parameters[picture])
        drawn = gaussians.draw_over(self._pictures.camera(picture), self._pictures.behind)  # [H, W, 4]
        target = canonical.compared(self._pictures, picture).to(drawn.device)  # [H, W, 3 or 4]
        loss = self._recipe.loss(drawn, target)
        self._adam.zero_grad()
        loss.backward()
        current = rates(self._recipe, self._plan, self._extent, self._step)
        for group in self._adam.param_groups:
            group["lr"] = current[group["name"]]
        self._adam.step()
        self._mining.tell(self._step, picture, loss.item())
        self._step += 1
        return loss.item()

    @torch.no_grad()
    def at(self, parameters: Tensor) -> Renderer:
        """See `Fit`; the network is evaluated here, once for all cameras."""
        return partial(self._deformed(parameters).picture, background=self._pictures.background)

    def tensors(self) -> dict[str, Tensor]:
        """The canonical Gaussians' `harmonics` and so on, and the networks' tensors, such as `network.backbone.0.weights`."""
        networks = {f"network.{name}": tensor for name, tensor in self._networks.items()}
        return canonical.of_leaves(self._leaves).tensors() | networks

    def state(self) -> State:
        """See `Fit`; with the losses and chances of the pictures."""
        return outer(adam=of_optimizer(self._adam), mining=self._mining.state())

    def restore(self, step: int, state: State) -> None:
        """See `Fit`."""
        restore_optimizer(self._adam, inner(state, "adam"))
        self._mining.restore(inner(state, "mining"))
        self._step = step

    def _deformed(self, parameters: Tensor) -> HarmonicGaussians:
        """The Gaussians at normalized parameters (P,)."""
        gaussians = canonical.of_leaves(self._leaves)
        places = (gaussians.means.detach() - self._center) / self._extent  # [N, 3]; detached as in the authors' code
        narrow = self._plan.precision == "bfloat16"
        with torch.autocast(places.device.type, dtype=torch.bfloat16, enabled=narrow):
            moves = offsets(self._networks, self._architecture, places, parameters.to(places))
        return HarmonicGaussians(
            gaussians.means + self._extent / MARGIN * moves["means"],
            gaussians.log_scales + moves["log_scales"],
            gaussians.quats + moves["quats"],
            gaussians.opacity_logits + moves["opacity_logits"].squeeze(1),
            gaussians.harmonics + moves["harmonics"].view_as(gaussians.harmonics),
        )


class HardMining:
    """Image sampling with chances proportional to a power of the last losses, renewed from time to time."""

    def __init__(self, pictures: int, plan: Plan, power: float) -> None:
        self._seed, self._power = plan.seed, power
        self._interval = max(1, plan.steps * RENEWAL // OFFICIAL_STEPS)
        self._losses = np.ones(pictures)
        self._cumulative = np.arange(1.0, pictures + 1.0)  # [pictures]

    def drawn(self, step: int) -> int:
        """The image of a step."""
        place = generator(self._seed, "hard examples", step).random() * self._cumulative[-1]
        return min(int(np.searchsorted(self._cumulative, place, side="right")), len(self._losses) - 1)

    def tell(self, step: int, picture: int, loss: float) -> None:
        """Record the loss of the image of a step; the chances follow at the next renewal."""
        self._losses[picture] = loss
        if step and step % self._interval == 0:
            self._cumulative = np.cumsum(np.maximum(self._losses, 1e-12) ** self._power)

    def state(self) -> State:
        """Losses and chances (images,)."""
        return {"losses": torch.from_numpy(self._losses), "cumulative": torch.from_numpy(self._cumulative)}

    def restore(self, state: State) -> None:
        """Resume from another sampler's `state`."""
        self._losses, self._cumulative = state["losses"].numpy().copy(), state["cumulative"].numpy().copy()


METHOD = Method(
    name="gs-surrogate",
    title="GS-Surrogate (the paper's field)",
    source="Li et al. 2026, arXiv:2604.06358",
    official_steps=OFFICIAL_STEPS,
    begin=GSSurrogate,
    prepare=canonical.prepare,
)
