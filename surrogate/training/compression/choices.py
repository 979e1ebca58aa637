"""Compression of the Gaussians and the simulation deformation after stage 2, one choice after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.data import Example
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.state import FittedGaussians

HOPELESS = 1.0  # dB: an attribute that costs more at once is not tried with fine-tuning
MODES_TRIES, MODES_SHRINK = 2, 0.7  # fine-tunings, and which part of the modes each is tried with
WEIGHED = 256  # training images that importance is taken from
ALLOWANCES = (4.0, 1.0)  # what may be lost before fine-tuning, in tolerances: the second where the first was too much
ROUNDS = 3  # at most, of each
WORTHWHILE = 0.01  # of the Gaussians: no round removes fewer
SAID = {"log_scales": "scales", "quats": "rotations", "opacity_logits": "opacities", "colors": "colours"}

Choose = Callable[[FittedGaussians, Evaluator], tuple[FittedGaussians, Choice]]


def choices(varied: bool) -> tuple[Choose, ...]:
    """All choices in their order.

    Where visualization parameters follow, no Gaussian is removed: one that the base does not show may be what others need.
    """
    always = (choose_fine_tuning, choose_attributes, choose_modes)
    return always if varied else (*always, choose_gaussians)


class Search:
    """A choice in progress: what was tried, and the `current` model, the smallest so far that costs no more than the tolerance."""

    def __init__(self, fitted: FittedGaussians, evaluator: Evaluator, name: str) -> None:
        """Begin with a model, which `name` describes among the options."""
        self.current, self.before = fitted, evaluator.measure(fitted)
        self.enough = self.before.psnr - evaluator.tolerance
        self.options = [Option(name, self.before.psnr)]
        self._evaluator = evaluator

    def accepts(self, trial: FittedGaussians, name: str, turn: int) -> bool:
        """True where a model is good enough, fine-tuned if need be; it then becomes the current one."""
        psnr = self._evaluator.psnr(trial)
        if psnr < self.enough:
            trial, name = self._evaluator.fine_tuned(trial, turn), f"{name}, after a recovery"
            psnr = self._evaluator.psnr(trial)
        self.options.append(Option(name, psnr))
        if psnr >= self.enough:
            self.current = trial
        return psnr >= self.enough

    def end(self, name: str, result: str) -> tuple[FittedGaussians, Choice]:
        """The end of the choice called `name`, with its result in words."""
        after = self._evaluator.measure(self.current)
        return self.current, Choice(name, result, self.options, self.before, after)


def choose_fine_tuning(fitted: FittedGaussians, evaluator: Evaluator) -> tuple[FittedGaussians, Choice]:
    """True where the model as stage 2 left it is fine-tuned, as all that loses something will be."""
    before = evaluator.measure(fitted)
    trial = evaluator.fine_tuned(fitted, -1)
    psnr = evaluator.psnr(trial)
    is_better = psnr > before.psnr
    current = trial if is_better else fitted
    options = [Option("as stage 2 left it", before.psnr), Option("after a recovery", psnr)]
    after = evaluator.measure(current, max(psnr, before.psnr))
    return current, Choice("steps at low rates", options[is_better].name, options, before, after)


def choose_attributes(fitted: FittedGaussians, evaluator: Evaluator) -> tuple[FittedGaussians, Choice]:
    """Hold still every attribute that is not worth moving, one after the other, the least missed first."""
    search = Search(fitted, evaluator, "all")
    alone = {
        name: evaluator.psnr(fitted.without(name))
        for name in fitted.gaussians.tensors()
        if fitted.deformation.moves(name)
    }
    for turn, name in enumerate(sorted(alone, key=lambda n: -alone[n])):
        said = f"without {SAID.get(name, name)}"
        if search.before.psnr - alone[name] > max(HOPELESS, evaluator.tolerance):
            search.options.append(Option(said, alone[name]))
        elif not search.accepts(search.current.without(name), said, turn):
            break
    moving = ", ".join(
        SAID.get(name, name) for name in fitted.gaussians.tensors() if search.current.deformation.moves(name)
    )
    return search.end("attributes that deform", moving or "none")


def choose_modes(fitted: FittedGaussians, evaluator: Evaluator) -> tuple[FittedGaussians, Choice]:
    """As few modes of deformation as will do, the most effective ones first; fewer still where fine-tuning makes up for them."""
    full = fitted.deformation.latent_size
    search = Search(fitted, evaluator, str(full))
    places = list({tuple(e.parameters.tolist()): e.parameters for e in evaluator.data.examples}.values())  # [P] each

    def cut(size: int) -> FittedGaussians:
        return FittedGaussians(fitted.gaussians, fitted.deformation.reduced(size, places))

    count = least(1, full, lambda size: evaluator.psnr(cut(size)) >= search.enough)
    if count < full:
        search.accepts(cut(count), str(count), 0)
    for turn in range(MODES_TRIES):
        fewer = min(count - 1, round(MODES_SHRINK * count))
        if fewer < 1 or not search.accepts(cut(fewer), str(fewer), turn):
            break
        count = fewer
    return search.end("modes of deformation", str(count))


def choose_gaussians(fitted: FittedGaussians, evaluator: Evaluator) -> tuple[FittedGaussians, Choice]:
    """Remove the least important Gaussians, in rounds, as long as fine-tuning makes up for them."""
    search = Search(fitted, evaluator, f"{len(fitted.gaussians):,}")
    for allowance in ALLOWANCES:
        for _ in range(ROUNDS):
            current = search.current
            trial = _pruned(current, evaluator, search.before.psnr - allowance * evaluator.tolerance)
            few = len(current.gaussians) - len(trial.gaussians) < max(1.0, WORTHWHILE * len(current.gaussians))
            if few or not search.accepts(trial, f"{len(trial.gaussians):,}", len(search.options)):
                break
    return search.end("Gaussians", f"{len(search.current.gaussians):,}")


def _pruned(fitted: FittedGaussians, evaluator: Evaluator, enough: float) -> FittedGaussians:
    """The most important Gaussians, as few as reach `enough` dB at once."""
    examples = evaluator.data.examples
    some, ranks = examples[:: max(1, len(examples) // WEIGHED)], evaluator.data.ranks
    weights = importance(fitted.at, some, evaluator.rasterizer, ranks)
    order = torch.argsort(weights, descending=True, stable=True)  # [N]

    def first(count: int) -> FittedGaussians:
        return fitted.of(order[:count].sort().values)

    return first(least(1, len(order), lambda count: evaluator.psnr(first(count)) >= enough))


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


def importance(
    gaussians_at: Callable[[Tensor], Gaussians],
    examples: Sequence[Example],
    rasterizer: Rasterizer,
    ranks: Ranks = ALONE,
) -> Tensor:
    """The sum of each Gaussian's weights T alpha over all pixels of the examples' views, (N,); their images are not read.

    A picture is linear in the colours with those weights, so they are the gradient of its sum by one channel.  Each of the
    processes `ranks` draws its share of the views.
    """
    with torch.no_grad():
        total = torch.zeros_like(gaussians_at(examples[0].parameters).opacity_logits)  # [N]
    for example in (examples[place] for place in ranks.share(len(examples))):
        with torch.no_grad():
            deformed = gaussians_at(example.parameters)
        colors = deformed.means.new_zeros(len(deformed), 3, requires_grad=True)
        rendering = rasterizer.draw(replace(deformed, colors=colors), example.camera)
        (by_colors,) = torch.autograd.grad(rendering.color[..., 0].sum(), colors)
        total += by_colors[:, 0]
    ranks.add(total)
    return total
