"""4DGS-HD: Gaussians that a grid of planes over space and the parameters deforms; 4D Gaussian Splatting in higher dimensions.

Wu et al. 2024, "4D Gaussian Splatting for Real-Time Dynamic Scene Rendering" (settings of its synthetic scenes), with the
parameters of an ensemble in the place of time, as Li et al. 2026 (arXiv:2604.06358) describe what they compare with.  They publish
no code of it: this is a reconstruction.  The planes are in `hexplane_field`.

The number of Gaussians stays what it is at the start, where theirs are split and pruned.  The loss compares alpha too, where
pictures have any, as that of the canonical Gaussians does.  Both sizes of a plan are the published one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from research.studies.baselines import canonical
from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.hexplane_field import GEOMETRY, OUTPUTS, HexPlaneDeformation, box_of, penalty
from research.studies.baselines.method import Method, Plan, Prepared, Renderer, TrainingImages
from research.studies.baselines.state import State, of_optimizer, restore_optimizer
from surrogate.randomness import generator
from surrogate.training.optimizer import EPSILON, without_subnormals
from surrogate.training.sampling import ShuffledEpochs

GRID_RATE, NETWORK_RATE = 1.6e-3, 1.6e-4  # of the extent of the cameras


class HexPlaneFit:
    """Gaussians and their deformation in training, one picture a step."""

    def __init__(
        self,
        pictures: TrainingImages,
        plan: Plan,
        prepared: Prepared,
        *,
        moved: Sequence[str] = GEOMETRY,
        naive: bool = False,
    ) -> None:
        """Start from the Gaussians of `canonical.prepare`; `moved` and `naive` as in `HexPlaneDeformation`."""
        self._pictures, self._plan, self._step = pictures, plan, 0
        self._order = ShuffledEpochs(len(pictures), plan.seed)
        start = HarmonicGaussians.of_tensors(prepared)
        created = HexPlaneDeformation.create(
            pictures.parameters.shape[1],
            box_of(start.means, pictures.box.to(start.means)),
            generator(plan.seed, "latents"),
            moved=moved,
            naive=naive,
        )
        self._deformation = replace(created, precision=plan.precision)
        self._leaves = canonical.leaves_of(start)
        self._adam = _optimizer(self._leaves, created, canonical.extent_of(pictures.cameras), plan.rate)

    def advance(self) -> float:
        """One step; returns its loss, the mean absolute difference (alpha too, where there is any) and the planes' penalty."""
        picture = self._order[self._step]
        gaussians = self._deformed(self._pictures.parameters[picture])
        drawn = gaussians.draw_over(self._pictures.camera(picture), self._pictures.behind)  # [H, W, 4]
        target = canonical.compared(self._pictures, picture).to(drawn) / 255.0  # [H, W, 3 or 4]
        loss = (drawn[..., : target.shape[2]] - target).abs().mean() + penalty(self._deformation.levels)
        self._adam.zero_grad()
        loss.backward()
        self._move(canonical.decay(self._step / self._plan.steps))
        self._step += 1
        return float(loss.detach())

    @torch.no_grad()
    def at(self, parameters: Tensor) -> Renderer:
        """See `Fit`; the Gaussians are deformed here, once for all cameras."""
        return partial(self._deformed(parameters).picture, background=self._pictures.background)

    def tensors(self) -> dict[str, Tensor]:
        """The Gaussians, the planes, the networks and the planes' box."""
        deformation = self._deformation
        trained = canonical.of_leaves(self._leaves).tensors() | deformation.planes() | dict(deformation.networks)
        return {name: tensor.detach() for name, tensor in trained.items()} | {"box": deformation.box}

    def state(self) -> State:
        """See `Fit`."""
        return of_optimizer(self._adam)

    def restore(self, step: int, state: State) -> None:
        """See `Fit`."""
        restore_optimizer(self._adam, state)
        self._step = step

    def _deformed(self, parameters: Tensor) -> HarmonicGaussians:
        gaussians = canonical.of_leaves(self._leaves)
        return self._deformation.deformed(gaussians, parameters.to(gaussians.means))

    @without_subnormals()
    def _move(self, decay: float) -> None:
        for group in self._adam.param_groups:
            group["lr"] = group["first_rate"] * (decay if group["falls"] else 1.0)
        self._adam.step()


def _optimizer(
    leaves: canonical.Leaves, deformation: HexPlaneDeformation, extent: float, rate: float
) -> torch.optim.Adam:
    """Adam with a group for each tensor of the Gaussians, one for the planes and one for the networks (official code).

    Each has its `first_rate`, and `falls` where the rate follows `canonical.decay`.
    """
    rates = {"means": canonical.MEAN_RATE * extent, **canonical.RATES}
    trained = [([leaf], rates[name], name == "means") for name, leaf in leaves.items()]
    trained.append((list(deformation.planes().values()), GRID_RATE * extent, True))
    trained.append((list(deformation.networks.values()), NETWORK_RATE * extent, True))
    groups = [
        {"params": [t.requires_grad_() for t in tensors], "first_rate": rate * own, "falls": falls}
        for tensors, own, falls in trained
    ]
    return torch.optim.Adam(groups, lr=0.0, eps=EPSILON, fused=True)


METHOD = Method(
    name="4dgs-hd",
    title="4DGS-HD",
    source="Wu et al. 2024 (arXiv:2310.08528), in higher dimensions as in arXiv:2604.06358",
    official_steps=20_000,
    begin=HexPlaneFit,
    prepare=canonical.prepare,
)
MOVING_ALL = replace(
    METHOD,
    name="4dgs-hd-all",
    title="4DGS-HD, opacities and colours move too",
    begin=partial(HexPlaneFit, moved=tuple(OUTPUTS)),
)
NAIVE = replace(
    METHOD, name="4dgs-hd-naive", title="4DGS-HD, planes started alike", begin=partial(HexPlaneFit, naive=True)
)
