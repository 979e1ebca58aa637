"""How many Gaussians the pictures need."""

from __future__ import annotations

import torch

from surrogate.needs.choice import Choice, Option
from surrogate.needs.fitted import Bench, Fitted
from surrogate.needs.importance import importance
from surrogate.needs.search import least

NAME = "Gaussians"
WEIGHED = 256  # training images that importance is taken from
ROUNDS = 3
WORTHWHILE = 0.02  # of the Gaussians: a round that would remove fewer ends the pruning


def choose_gaussians(fitted: Fitted, bench: Bench) -> tuple[Fitted, Choice]:
    """Remove the least important Gaussians as long as a short recovery makes up for them.

    Each round removes as many as cost no more than the tolerance at once, and is kept where the recovered model is worse
    than the first by no more than that.
    """
    before, enough = bench.measure(fitted), 0.0
    enough = before.psnr - bench.tolerance
    options, current, psnr = [Option(f"{len(fitted.gaussians):,}", before.psnr)], fitted, before.psnr
    for turn in range(ROUNDS):
        trial = _pruned(current, bench, min(psnr, before.psnr) - bench.tolerance)
        removed = len(current.gaussians) - len(trial.gaussians)
        if removed < max(1.0, WORTHWHILE * len(current.gaussians)):
            break
        trial = bench.recovered(trial, turn)
        psnr = bench.psnr(trial)
        options.append(Option(f"{len(trial.gaussians):,}", psnr))
        if psnr < enough:
            break
        current = trial
    return current, Choice(NAME, f"{len(current.gaussians):,}", options, before, bench.measure(current))


def _pruned(fitted: Fitted, bench: Bench, enough: float) -> Fitted:
    """The most important Gaussians, as few as reach `enough` dB at once."""
    examples = bench.data.examples
    weights = importance(fitted.at, examples[:: max(1, len(examples) // WEIGHED)], bench.rasterizer)
    order = torch.argsort(weights, descending=True, stable=True)  # [N]

    def kept(count: int) -> Fitted:
        return fitted.of(order[:count].sort().values)

    count = least(1, len(order), lambda number: bench.psnr(kept(number)) >= enough)
    return kept(count)
