"""GS-Surrogate's separate networks for isosurfaces and for transfer functions, published by its authors after the paper.

Rules, sizes and rates are those of the folders `isosurface` and `tf_adapter` of their code (github.com/RumaliPerera/GS-Surrogate,
commits `e09e029` and `94037d3`), written anew. Both use the layers, loss and units of `gs_surrogate`; the rates of their networks
fall to a tenth along half a cosine.

Isosurfaces: 150,000 steps. The network is that of the simulation, but the isovalue, in [0, 1], has an encoder of its own.

    feature(x, p, v) = s(x) + adapter(e(p), i(v))

The canonical Gaussians go on as in `gs_surrogate`. Images of a member and an isovalue share their chance of being sampled: the
power 1.5 of the moving mean of their losses, renewed after every 2,000 steps.

Transfer functions: the network of `gs_surrogate` learns the images of the base in 80,000 steps; then all of that is frozen.
In 100,000 more, a narrower network changes opacities and harmonics alone: features of 64, layers of 256, two before the heads.
It sees the places of the Gaussians at the simulation's parameters, these parameters, and those of the function.
The latter are in [-1, 1], with the base at 0. The degree of the colours grows from 0 to 3 in the first 3,000 steps.
The network learns the base from all members, and each other function from a fifth of the members, drawn for each function.
Images are sampled alike.

Differences: those of `gs_surrogate`. The authors' script for isosurfaces begins with points of a reconstruction; here it begins
with the canonical Gaussians that fit all isosurfaces, as the joint network does. That for functions begins with Gaussians
that fit the images of the base. Members are drawn among those that a function was rendered for. The frozen volume is computed
once for each member, not in each step. Black images, which theirs skip, don't occur over white.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from research.studies.baselines import canonical
from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.gs_surrogate import (
    OFFICIAL_STEPS,
    GSSurrogate,
    GSSurrogateArchitecture,
    Recipe,
    cosine_decay,
    moved,
    narrow,
    offsets,
)
from research.studies.baselines.method import Method, Plan, Prepared, Renderer, TrainingImages
from research.studies.baselines.state import State, inner, of_optimizer, outer, restore_optimizer
from surrogate.randomness import generator
from surrogate.training.sampling import ShuffledEpochs

ISOSURFACE_STEPS, FUNCTION_STEPS = 150_000, 100_000
SHARE = 5  # a function that is not the base is learnt from a fifth of the members
GROWTH = 1_000  # official steps for each degree of the colours
SOURCE = "newer code of Li et al. 2026 (github.com/RumaliPerera/GS-Surrogate)"
ISOSURFACES = Recipe(mining_together=True, cosine=True, official_steps=ISOSURFACE_STEPS)


def of_isosurfaces(
    pictures: TrainingImages, plan: Plan, prepared: Prepared, architecture: GSSurrogateArchitecture | None = None
) -> GSSurrogate:
    """The training for isosurfaces; raises ValueError for images without a parameter of the visualization."""
    own = _visualization(pictures)
    default = GSSurrogateArchitecture(pictures.parameters.shape[1] - own, visualization=own)
    return GSSurrogate(pictures, plan, prepared, architecture or default, ISOSURFACES)


def of_functions(parameters: int, visualization: int) -> GSSurrogateArchitecture:
    """The network for transfer functions."""
    return GSSurrogateArchitecture(
        parameters,
        feature_width=64,
        hidden_width=256,
        visualization=visualization,
        visualization_frequencies=4,
        visualization_low=-1.0,
        backbone_layers=2,
        heads=("opacity_logits", "harmonics"),
    )


class FunctionsOnVolume:
    """Training for transfer functions: of a volume from the base's images, then of the functions on it, frozen.

    The two take their shares of the plan's steps, as published.
    """

    def __init__(
        self,
        pictures: TrainingImages,
        plan: Plan,
        prepared: Prepared,
        of_volume: GSSurrogateArchitecture | None = None,
        architecture: GSSurrogateArchitecture | None = None,
    ) -> None:
        """Start from the tensors of `prepare_base`; raises ValueError without images of the base or of other functions."""
        own = _visualization(pictures)
        self._pictures, self._plan, self._simulation = pictures, plan, pictures.parameters.shape[1] - own
        first = max(1, round(plan.steps * OFFICIAL_STEPS / (OFFICIAL_STEPS + FUNCTION_STEPS)))
        self._of_volume, self._of_functions = first, max(1, plan.steps - first)  # steps
        self._volume = GSSurrogate(base_of(pictures), replace(plan, steps=first), prepared, of_volume)
        self._architecture = architecture or of_functions(self._simulation, own)
        device = self._volume.tensors()["means"].device
        initial = self._architecture.initial(generator(plan.seed, "latents", 1))
        self._networks = {name: tensor.to(device).requires_grad_() for name, tensor in initial.items()}
        self._adam = torch.optim.Adam(list(self._networks.values()))
        self._images = images_of_functions(pictures, plan.seed)
        self._order = ShuffledEpochs(len(self._images), plan.seed)
        self._frozen: dict[tuple[float, ...], HarmonicGaussians] = {}  # by the simulation's parameters
        self._step = 0

    def advance(self) -> float:
        """One training step; returns its loss."""
        step = self._step - self._of_volume
        loss = self._volume.advance() if step < 0 else self._advance(step)
        self._step += 1
        return loss

    def _advance(self, step: int) -> float:
        """A step of the functions' network."""
        picture, fraction = int(self._images[self._order[step]]), step / self._of_functions
        parameters = self._pictures.parameters[picture]
        key = tuple(parameters[: self._simulation].tolist())
        if key not in self._frozen:
            self._frozen[key] = self._volume_at(parameters)
        degree = min(canonical.DEGREE, int(fraction * FUNCTION_STEPS / GROWTH))
        gaussians = self._changed(self._frozen[key], parameters)
        drawn = gaussians.draw_over(self._pictures.camera(picture), self._pictures.behind, degree=degree)  # [H, W, 4]
        loss = Recipe().loss(drawn, canonical.compared(self._pictures, picture).to(drawn.device))
        self._adam.zero_grad()
        loss.backward()
        self._adam.param_groups[0]["lr"] = self._plan.rate * Recipe().rate * cosine_decay(fraction)
        self._adam.step()
        return loss.item()

    @torch.no_grad()
    def at(self, parameters: Tensor) -> Renderer:
        """See `Fit`; both networks are evaluated here, once for all cameras."""
        gaussians = self._changed(self._volume_at(parameters), parameters)
        return partial(gaussians.picture, background=self._pictures.background)

    def tensors(self) -> dict[str, Tensor]:
        """The tensors of the volume's training, and those of the functions' network, such as `functions.backbone.0.weights`."""
        return {**self._volume.tensors(), **{f"functions.{name}": tensor for name, tensor in self._networks.items()}}

    def state(self) -> State:
        """See `Fit`."""
        return outer(volume=self._volume.state(), functions=of_optimizer(self._adam))

    def restore(self, step: int, state: State) -> None:
        """See `Fit`."""
        self._volume.restore(min(step, self._of_volume), inner(state, "volume"))
        restore_optimizer(self._adam, inner(state, "functions"))
        self._frozen.clear()
        self._step = step

    @torch.no_grad()
    def _volume_at(self, parameters: Tensor) -> HarmonicGaussians:
        """The volume's Gaussians at normalized parameters (P + V,), of which it sees the simulation's."""
        return self._volume.deformed(parameters[: self._simulation])

    def _changed(self, volume: HarmonicGaussians, parameters: Tensor) -> HarmonicGaussians:
        places = self._volume.places(volume.means)  # [N, 3]
        with narrow(self._plan, places):
            moves = offsets(self._networks, self._architecture, places, parameters.to(places))
        return moved(volume, moves, 1.0)


def base_of(pictures: TrainingImages) -> TrainingImages:
    """The images of the base, whose functions' parameters are 0, with the simulation's parameters alone.

    Raises ValueError where there are none.
    """
    simulation = pictures.parameters.shape[1] - pictures.visualization
    chosen = np.flatnonzero(_shows_base(pictures))
    if not len(chosen):
        raise ValueError(
            f"the network for functions needs images of the base: all {len(pictures)} show other functions"
        )
    return replace(
        pictures,
        pixels=pictures.pixels[chosen],
        views=pictures.views[chosen],
        parameters=pictures.parameters[chosen, :simulation],
        visualization=0,
    )


def images_of_functions(pictures: TrainingImages, seed: int) -> NDArray[np.int64]:
    """The images (K,) that the functions' network learns from: all of the base, and of other functions those of some members.

    They are a fifth of all members, at least one, drawn among those that the function was rendered for.
    """
    simulation = pictures.parameters.shape[1] - pictures.visualization
    rows = pictures.parameters.cpu().numpy()
    members, member_of = np.unique(rows[:, :simulation], axis=0, return_inverse=True)
    functions, function_of = np.unique(rows[:, simulation:], axis=0, return_inverse=True)
    member_of, function_of = member_of.reshape(-1), function_of.reshape(-1)  # [M]
    learnt = _shows_base(pictures)
    for function in range(len(functions)):
        available = np.unique(member_of[function_of == function])
        count = min(len(available), max(1, len(members) // SHARE))
        some = generator(seed, "members", function).choice(available, count, replace=False)
        learnt |= (function_of == function) & np.isin(member_of, some)
    return np.flatnonzero(learnt)


def prepare_base(
    pictures: TrainingImages, seed: int, *, count: int = canonical.COUNT, steps: int = canonical.STEPS
) -> Mapping[str, Tensor]:
    """The canonical Gaussians of the base's images; see `canonical.prepare`."""
    return canonical.prepare(base_of(pictures), seed, count=count, steps=steps)


def _shows_base(pictures: TrainingImages) -> NDArray[np.bool_]:
    """True (M,) for images of the base."""
    own = pictures.parameters[:, pictures.parameters.shape[1] - _visualization(pictures) :]  # [M, V]
    return (own == 0.0).all(dim=1).cpu().numpy()


def _visualization(pictures: TrainingImages) -> int:
    if not pictures.visualization:
        raise ValueError("a network of its own for isosurfaces or functions needs images in which these vary")
    return pictures.visualization


FOR_FUNCTIONS = Method(
    name="gs-surrogate-functions",
    title="GS-Surrogate, its network for transfer functions",
    source=f"{SOURCE}: 80,000 steps for the volume, then 100,000",
    official_steps=OFFICIAL_STEPS + FUNCTION_STEPS,
    begin=FunctionsOnVolume,
    prepare=prepare_base,
)
FOR_ISOSURFACES = Method(
    name="gs-surrogate-isosurfaces",
    title="GS-Surrogate, its network for isosurfaces",
    source=SOURCE,
    official_steps=ISOSURFACE_STEPS,
    begin=of_isosurfaces,
    prepare=canonical.prepare,
)
