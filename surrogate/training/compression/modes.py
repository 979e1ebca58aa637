"""How many numbers per Gaussian the deformation needs."""

from __future__ import annotations

from torch import Tensor

from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.fitted import Bench, Fitted
from surrogate.training.compression.search import least

NAME = "modes of deformation"
TRIES = 2  # recoveries
SHRINK = 0.7  # what a recovery is hoped to make up for


def choose_modes(fitted: Fitted, bench: Bench) -> tuple[Fitted, Choice]:
    """As few modes as will do, the most effective ones first; fewer still where a short recovery makes up for them."""
    before, full = bench.measure(fitted), fitted.deformation.latent_size
    options, enough = [Option(str(full), before.psnr)], before.psnr - bench.tolerance
    places = _parameters(bench)

    def cut(size: int) -> Fitted:
        return Fitted(fitted.gaussians, fitted.deformation.reduced(size, places))

    count = least(1, full, lambda size: bench.psnr(cut(size)) >= enough)
    current = cut(count) if count < full else fitted
    if count < full:
        options.append(Option(str(count), bench.psnr(current)))
    for turn in range(TRIES):
        fewer = min(count - 1, round(SHRINK * count))
        if fewer < 1:
            break
        trial, psnr, how = bench.good_enough(cut(fewer), enough, turn)
        options.append(Option(f"{fewer}{how}", psnr))
        if psnr < enough:
            break
        current, count = trial, fewer
    return current, Choice(NAME, str(count), options, before, bench.measure(current))


def _parameters(bench: Bench) -> list[Tensor]:
    """The parameters (P,) of every member that is learnt from, once each."""
    return list({tuple(example.parameters.tolist()): example.parameters for example in bench.data.examples}.values())
