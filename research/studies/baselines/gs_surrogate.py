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
simulation, of one joint network; `gs_surrogate_separate` has the authors' own networks for them. Both sizes of a plan
are the published one.
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
from numpy.typing import NDArray
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
NEWEST = 0.1  # of the newest loss in the mean of a group's
GAUSSIAN_EPSILON = 1e-15  # of Adam; the network has torch's 1e-8

Networks: TypeAlias = Mapping[str, Tensor]


@dataclass(frozen=True)
class GSSurrogateArchitecture:
    """Numbers of parameters, widths of the layers, and frequencies of the positional encodings.

    Attributes
    ----------
    parameters : that one encoder sees, in [0, 1].
    visualization : the number of those that follow, and have an encoder of their own; 0 for none.
    visualization_frequencies, visualization_low : of their encoding, and the lowest value of its range, which ends at 1.
    backbone_layers : before the heads.
    heads : the tensors of the Gaussians that change, of `COLUMNS`.
    """

    parameters: int
    feature_width: int = 128
    hidden_width: int = 512
    position_frequencies: int = 10
    parameter_frequencies: int = 2
    visualization: int = 0
    visualization_frequencies: int = 2
    visualization_low: float = 0.0
    backbone_layers: int = 3
    heads: tuple[str, ...] = tuple(COLUMNS)

    def widths(self) -> dict[str, tuple[int, ...]]:
        """Input columns of each perceptron, then the outputs of its layers; encoders, adapter, backbone, then heads."""
        feature, hidden = self.feature_width, self.hidden_width
        own = self.visualization * (1 + 2 * self.visualization_frequencies)
        return {
            "position": (3 * (1 + 2 * self.position_frequencies), hidden, hidden, feature),
            "parameters": (self.parameters * (1 + 2 * self.parameter_frequencies), hidden, feature),
            **({"visualization": (own, hidden, feature)} if own else {}),
            "adapter": (feature * (2 if own else 1), feature, feature),
            "backbone": (feature, *[hidden] * self.backbone_layers),
            **{head: (hidden, hidden, COLUMNS[head]) for head in self.heads},
        }

    def code(self, networks: Networks, parameters: Tensor) -> Tensor:
        """The encoders' outputs (1, F or 2 F), which the adapter sees, for parameters (P + V,) in [-1, 1]."""
        of_all, of_own = parameters[None, : self.parameters], parameters[None, self.parameters :]  # [1, P], [1, V]
        code = perceptron(networks, "parameters", encode((of_all + 1.0) / 2.0, self.parameter_frequencies))  # [1, F]
        if not self.visualization:
            return code
        low = self.visualization_low
        own = encode(low + (1.0 - low) * (of_own + 1.0) / 2.0, self.visualization_frequencies)
        return torch.cat([code, perceptron(networks, "visualization", own)], dim=1)

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
    mining_together : images of the same parameters share a loss, the mean of those before with a tenth of the newest.
    cosine : the network's rate falls along half a cosine, not exponentially.
    official_steps : of the published training, of which `RENEWAL` is counted.
    """

    rate: float = 1e-4
    mean_factor: float = 1e-3
    other_factor: float = 1.0
    ssim_weight: float = 0.2
    mining_power: float = 1.5
    mining_together: bool = False
    cosine: bool = False
    official_steps: int = OFFICIAL_STEPS

    def loss(self, drawn: Tensor, picture: Tensor) -> Tensor:
        """The loss of a rendered image (H, W, 4) against (H, W, 3 or 4), as in `image_loss`."""
        share = 1.0 - self.ssim_weight
        return share * image_loss(drawn, picture, ssim_weight=self.ssim_weight / share)


def rates(recipe: Recipe, plan: Plan, extent: float, step: int) -> dict[str, float]:
    """Adam's rates in a step, for the canonical Gaussians' leaves by name and for the "network"; `extent` as of `extent_of`."""
    decay = FINAL_FACTOR ** (step / plan.steps)
    by_name = {name: recipe.other_factor * rate for name, rate in canonical.RATES.items()}
    by_name["means"] = recipe.mean_factor * canonical.MEAN_RATE * extent / MARGIN * decay
    by_name["network"] = recipe.rate * (cosine_decay(step / plan.steps) if recipe.cosine else decay)
    return {name: plan.rate * rate for name, rate in by_name.items()}


def cosine_decay(fraction: float) -> float:
    """The factor on a rate after a fraction of the steps: from 1 to `FINAL_FACTOR` along half a cosine."""
    return FINAL_FACTOR + (1.0 - FINAL_FACTOR) * (1.0 + math.cos(math.pi * fraction)) / 2.0


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
    shift = perceptron(networks, "adapter", architecture.code(networks, parameters))  # [1, F]
    features = perceptron(networks, "backbone", perceptron(networks, "position", encoded) + shift)  # [N, H]
    outputs = {head: perceptron(networks, head, features).float() for head in architecture.heads}
    return outputs | {"opacity_logits": outputs["opacity_logits"].tanh()}


def moved(gaussians: HarmonicGaussians, moves: Mapping[str, Tensor], unit: float) -> HarmonicGaussians:
    """The Gaussians with `offsets` added; those of the means are in `unit`s."""
    tensors = gaussians.tensors()
    for head, move in moves.items():
        tensors[head] = tensors[head] + (unit * move if head == "means" else move).view_as(tensors[head])
    return HarmonicGaussians(**tensors)


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
        self._mining = mining(pictures, plan, self._recipe)
        self._step = 0

    def advance(self) -> float:
        """One training step; returns its loss."""
        picture = self._mining.drawn(self._step)
        gaussians = self.deformed(self._pictures.parameters[picture])
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
        return partial(self.deformed(parameters).picture, background=self._pictures.background)

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

    def places(self, means: Tensor) -> Tensor:
        """Places (N, 3) as the networks see them; detached as in the authors' code."""
        return (means.detach() - self._center) / self._extent

    def deformed(self, parameters: Tensor) -> HarmonicGaussians:
        """The Gaussians at normalized parameters (P,)."""
        gaussians = canonical.of_leaves(self._leaves)
        places = self.places(gaussians.means)  # [N, 3]
        with narrow(self._plan, places):
            moves = offsets(self._networks, self._architecture, places, parameters.to(places))
        return moved(gaussians, moves, self._extent / MARGIN)


def narrow(plan: Plan, tensor: Tensor) -> torch.autocast:
    """A context where networks compute in the plan's precision, on the device of `tensor`."""
    return torch.autocast(tensor.device.type, dtype=torch.bfloat16, enabled=plan.precision == "bfloat16")


def mining(pictures: TrainingImages, plan: Plan, recipe: Recipe) -> HardMining:
    """The sampler of a training."""
    groups = None
    if recipe.mining_together:
        groups = np.unique(pictures.parameters.cpu().numpy(), axis=0, return_inverse=True)[1].reshape(-1)  # [M]
    return HardMining(len(pictures), plan, recipe.mining_power, groups=groups, official_steps=recipe.official_steps)


class HardMining:
    """Image sampling with chances proportional to a power of the last losses, renewed from time to time.

    With `groups` (images,), numbers from 0, all images of a group have the same chance, from its losses' moving mean.
    """

    def __init__(
        self,
        pictures: int,
        plan: Plan,
        power: float,
        *,
        groups: NDArray[np.int64] | None = None,
        official_steps: int = OFFICIAL_STEPS,
    ) -> None:
        self._seed, self._power = plan.seed, power
        self._groups, self._newest = (np.arange(pictures), 1.0) if groups is None else (groups, NEWEST)
        self._interval = max(1, plan.steps * RENEWAL // official_steps)
        self._losses = np.full(self._groups.max() + 1, np.nan)  # [groups]
        self._cumulative = np.arange(1.0, pictures + 1.0)  # [pictures]

    def drawn(self, step: int) -> int:
        """The image of a step."""
        place = generator(self._seed, "hard examples", step).random() * self._cumulative[-1]
        return min(int(np.searchsorted(self._cumulative, place, side="right")), len(self._groups) - 1)

    def tell(self, step: int, picture: int, loss: float) -> None:
        """Record the loss of the image of a step; the chances follow at the next renewal."""
        group = self._groups[picture]
        before = loss if np.isnan(self._losses[group]) else self._losses[group]
        self._losses[group] = (1.0 - self._newest) * before + self._newest * loss
        if step and step % self._interval == 0:
            losses = np.where(np.isnan(self._losses), 1.0, self._losses)[self._groups]  # [pictures]
            self._cumulative = np.cumsum(np.maximum(losses, 1e-12) ** self._power)

    def state(self) -> State:
        """Losses (groups,) and chances (images,)."""
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
