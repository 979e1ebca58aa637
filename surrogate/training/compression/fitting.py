"""After stage 2: what the model does not need is taken from it, choice by choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from surrogate.storage.encoding import Encoding
from surrogate.training.compression.attributes import choose_attributes
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.fitted import Bench, Fitted
from surrogate.training.compression.modes import choose_modes
from surrogate.training.compression.precision import choose_precision
from surrogate.training.compression.pruning import choose_gaussians


@dataclass(frozen=True, eq=False)
class Needs:
    """A model between choices: the first `done` of `NEEDS` have been made."""

    fitted: Fitted
    done: int = 0
    encodings: Mapping[str, Encoding] = field(default_factory=dict)


def settle(needs: Needs, bench: Bench) -> tuple[Needs, Choice]:
    """A recovery of what has lost nothing, which every other is then compared with."""
    before = bench.measure(needs.fitted)
    trial = bench.recovered(needs.fitted, -1)
    psnr = bench.psnr(trial)
    kept = psnr > before.psnr
    fitted = trial if kept else needs.fitted
    options = [Option("as stage 2 left it", before.psnr), Option("after a recovery", psnr)]
    return Needs(fitted), Choice(
        "steps at low rates", options[kept].name, options, before, bench.measure(fitted, max(psnr, before.psnr))
    )


def attributes(needs: Needs, bench: Bench) -> tuple[Needs, Choice]:
    """Hold still what need not follow the parameters."""
    fitted, choice = choose_attributes(needs.fitted, bench)
    return Needs(fitted), choice


def modes(needs: Needs, bench: Bench) -> tuple[Needs, Choice]:
    """Fewer numbers per Gaussian."""
    fitted, choice = choose_modes(needs.fitted, bench)
    return Needs(fitted), choice


def gaussians(needs: Needs, bench: Bench) -> tuple[Needs, Choice]:
    """Fewer Gaussians."""
    fitted, choice = choose_gaussians(needs.fitted, bench)
    return Needs(fitted), choice


def precision(needs: Needs, bench: Bench) -> tuple[Needs, Choice]:
    """Fewer bits."""
    fitted, encodings, choice = choose_precision(needs.fitted, bench)
    return Needs(fitted, encodings=encodings), choice


Need = Callable[[Needs, Bench], tuple[Needs, Choice]]
NEEDS: tuple[Need, ...] = (settle, attributes, modes, gaussians, precision)  # in this order
# Where visualization parameters follow, no Gaussian is removed: one that the base does not show may be what others need.
VARIED_NEEDS: tuple[Need, ...] = (settle, attributes, modes)


def fit_to_need(needs: Needs, bench: Bench, choices: Sequence[Need] = NEEDS) -> tuple[Needs, Choice]:
    """Make the next of `choices`, on validation images; deterministic, so that it can be made again after an interruption."""
    after, choice = choices[needs.done](needs, bench)
    return Needs(after.fitted, needs.done + 1, after.encodings), choice
