"""How many Gaussians the pictures need."""

from __future__ import annotations

import torch

from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.fitted import Bench, Fitted
from surrogate.training.compression.importance import importance
from surrogate.training.compression.search import least

NAME = "Gaussians"
WEIGHED = 256  # training images that importance is taken from
ALLOWANCES = (4.0, 1.0)  # what may be lost before the recovery, in tolerances: the second where the first was too much
ROUNDS = 3  # at most, of each
WORTHWHILE = 0.01  # of the Gaussians: no round removes fewer


def choose_gaussians(fitted: Fitted, bench: Bench) -> tuple[Fitted, Choice]:
    """Remove the least important Gaussians, in rounds, as long as short recoveries make up for them.

    A round is kept where the model, if need be recovered, is worse than the first by no more than the tolerance.
    """
    before = bench.measure(fitted)
    options, current = [Option(f"{len(fitted.gaussians):,}", before.psnr)], fitted
    enough = before.psnr - bench.tolerance
    for allowance in ALLOWANCES:
        for _ in range(ROUNDS):
            trial = _pruned(current, bench, before.psnr - allowance * bench.tolerance)
            removed = len(current.gaussians) - len(trial.gaussians)
            if removed < max(1.0, WORTHWHILE * len(current.gaussians)):
                break
            trial, psnr, how = bench.good_enough(trial, enough, len(options))
            options.append(Option(f"{len(trial.gaussians):,}{how}", psnr))
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

    return kept(least(1, len(order), lambda count: bench.psnr(kept(count)) >= enough))
