"""What is taken from Gaussians and F_sim after stage 2, one choice after the other."""

from __future__ import annotations

from collections.abc import Callable

import torch

from surrogate.gaussians import NAMES
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.compression.importance import importance
from surrogate.training.fitted import Fitted

HOPELESS = 1.0  # dB: an attribute that costs more at once is not tried with fine-tuning
MODES_TRIES, MODES_SHRINK = 2, 0.7  # fine-tunings, and which part of the modes each is tried with
WEIGHED = 256  # training images that importance is taken from
ALLOWANCES = (4.0, 1.0)  # what may be lost before fine-tuning, in tolerances: the second where the first was too much
ROUNDS = 3  # at most, of each
WORTHWHILE = 0.01  # of the Gaussians: no round removes fewer
SAID = {"log_scales": "scales", "quats": "rotations", "opacity_logits": "opacities", "colors": "colours"}

Choose = Callable[[Fitted, Evaluator], tuple[Fitted, Choice]]


def choices(varied: bool) -> tuple[Choose, ...]:
    """All choices in their order.

    Where visualization parameters follow, no Gaussian is removed: one that the base does not show may be what others need.
    """
    always = (choose_fine_tuning, choose_attributes, choose_modes)
    return always if varied else (*always, choose_gaussians)


def choose_fine_tuning(fitted: Fitted, evaluator: Evaluator) -> tuple[Fitted, Choice]:
    """Whether the model as stage 2 left it is fine-tuned, as all that loses something will be."""
    before = evaluator.measure(fitted)
    trial = evaluator.fine_tuned(fitted, -1)
    psnr = evaluator.psnr(trial)
    kept = psnr > before.psnr
    current = trial if kept else fitted
    options = [Option("as stage 2 left it", before.psnr), Option("after a recovery", psnr)]
    after = evaluator.measure(current, max(psnr, before.psnr))
    return current, Choice("steps at low rates", options[kept].name, options, before, after)


def choose_attributes(fitted: Fitted, evaluator: Evaluator) -> tuple[Fitted, Choice]:
    """Hold still whatever is not worth moving: one attribute after the other, the least missed first.

    One is held still where the model, fine-tuned if need be, is worse by no more than the tolerance than with all.
    """
    before = evaluator.measure(fitted)
    options, current, enough = [Option("all", before.psnr)], fitted, before.psnr - evaluator.tolerance
    alone = {name: evaluator.psnr(fitted.without(name)) for name in NAMES if fitted.deformation.moves(name)}
    for turn, name in enumerate(sorted(alone, key=lambda n: -alone[n])):
        said = f"without {SAID.get(name, name)}"
        if before.psnr - alone[name] > max(HOPELESS, evaluator.tolerance):
            options.append(Option(said, alone[name]))
            continue
        trial, psnr, how = evaluator.good_enough(current.without(name), enough, turn)
        options.append(Option(f"{said}{how}", psnr))
        if psnr < enough:
            break
        current = trial
    moving = ", ".join(SAID.get(name, name) for name in NAMES if current.deformation.moves(name))
    return current, Choice("attributes that deform", moving or "none", options, before, evaluator.measure(current))


def choose_modes(fitted: Fitted, evaluator: Evaluator) -> tuple[Fitted, Choice]:
    """As few modes of deformation as will do, the most effective ones first; fewer still where fine-tuning makes up for them."""
    before, full = evaluator.measure(fitted), fitted.deformation.latent_size
    options, enough = [Option(str(full), before.psnr)], before.psnr - evaluator.tolerance
    places = list({tuple(e.parameters.tolist()): e.parameters for e in evaluator.data.examples}.values())  # [P] each

    def cut(size: int) -> Fitted:
        return Fitted(fitted.gaussians, fitted.deformation.reduced(size, places))

    count = least(1, full, lambda size: evaluator.psnr(cut(size)) >= enough)
    current = cut(count) if count < full else fitted
    if count < full:
        options.append(Option(str(count), evaluator.psnr(current)))
    for turn in range(MODES_TRIES):
        fewer = min(count - 1, round(MODES_SHRINK * count))
        if fewer < 1:
            break
        trial, psnr, how = evaluator.good_enough(cut(fewer), enough, turn)
        options.append(Option(f"{fewer}{how}", psnr))
        if psnr < enough:
            break
        current, count = trial, fewer
    return current, Choice("modes of deformation", str(count), options, before, evaluator.measure(current))


def choose_gaussians(fitted: Fitted, evaluator: Evaluator) -> tuple[Fitted, Choice]:
    """Remove the least important Gaussians, in rounds, as long as fine-tuning makes up for them.

    A round is kept where the model, fine-tuned if need be, is worse than the first by no more than the tolerance.
    """
    before = evaluator.measure(fitted)
    options, current = [Option(f"{len(fitted.gaussians):,}", before.psnr)], fitted
    enough = before.psnr - evaluator.tolerance
    for allowance in ALLOWANCES:
        for _ in range(ROUNDS):
            trial = _pruned(current, evaluator, before.psnr - allowance * evaluator.tolerance)
            removed = len(current.gaussians) - len(trial.gaussians)
            if removed < max(1.0, WORTHWHILE * len(current.gaussians)):
                break
            trial, psnr, how = evaluator.good_enough(trial, enough, len(options))
            options.append(Option(f"{len(trial.gaussians):,}{how}", psnr))
            if psnr < enough:
                break
            current = trial
    return current, Choice("Gaussians", f"{len(current.gaussians):,}", options, before, evaluator.measure(current))


def _pruned(fitted: Fitted, evaluator: Evaluator, enough: float) -> Fitted:
    """The most important Gaussians, as few as reach `enough` dB at once."""
    examples = evaluator.data.examples
    weights = importance(fitted.at, examples[:: max(1, len(examples) // WEIGHED)], evaluator.rasterizer)
    order = torch.argsort(weights, descending=True, stable=True)  # [N]

    def kept(count: int) -> Fitted:
        return fitted.of(order[:count].sort().values)

    return kept(least(1, len(order), lambda count: evaluator.psnr(kept(count)) >= enough))


def least(low: int, high: int, will_do: Callable[[int], bool]) -> int:
    """The smallest number in low..high that will do, by halving; `high` is known to.

    Where a larger number may fail though a smaller one does not, some number that will do.
    """
    while low < high:
        middle = (low + high) // 2
        if will_do(middle):
            high = middle
        else:
            low = middle + 1
    return high
