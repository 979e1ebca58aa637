"""Whether colours depend on the direction that they are seen from, asked of the images themselves."""

from __future__ import annotations

import torch
from torch import Tensor

from surrogate.gaussians import Gaussians
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.fitted import Bench, Fitted
from surrogate.training.loop import StageRun
from surrogate.training.stages import Stage, canonical_rates

NAME = "colour degree"
ASKED_AFTER = 0.2  # of stage 2: places and shapes are good enough then to tell, and most time is still to be saved
SETTLING = 0.03  # of all steps, before the question: in a model that still moves, degree 1 makes up for other errors
PROBE = 0.02  # of all steps, for each degree
WORTHWHILE = 0.05  # dB in so short a probe, more in the end: lit pictures (Nyx) gained 0.09, unlit volumes 0.01 at most


def choose_color_degree(fitted: Fitted, bench: Bench) -> tuple[int, Choice]:
    """0 unless a linear dependence on the direction, with all else but colours held still, is seen in validation images.

    Both degrees are given the same short training of their colours, from `fitted` once that has settled; it has degree 0 and is
    not changed.
    """
    settled = bench.settled(fitted, bench.steps(SETTLING))
    scores = [_judged(settled, degree, bench) for degree in (0, 1)]
    chosen = int(scores[1] > scores[0] + WORTHWHILE)
    return chosen, Choice(NAME, str(chosen), [Option(f"degree {d}", score) for d, score in enumerate(scores)])


def _judged(fitted: Fitted, degree: int, bench: Bench) -> float:
    """Mean PSNR over the validation images once the colours, of this degree, have been trained."""
    gaussians = fitted.gaussians.copy().with_color_degree(degree)
    settings, steps = bench.settings.changed(relocation_interval=0), bench.steps(PROBE)

    def gaussians_at(parameters: Tensor) -> Gaussians:
        return fitted.deformation.deformed(gaussians, parameters)

    stage = Stage(
        name=NAME,
        steps=steps,
        tensors={"means": gaussians.means, "colors": gaussians.colors.requires_grad_()},
        rates={"means": 0.0, "colors": canonical_rates(settings)["colors"]},
        per_gaussian=frozenset(),
        gaussians_at=gaussians_at,
    )
    run = StageRun(stage, settings, bench.data)
    while run.step < steps:
        run.advance()
    with torch.no_grad():
        return bench.psnr_of(gaussians_at)
