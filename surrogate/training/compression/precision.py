"""In how few bits a model may be stored."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import torch
from torch import Tensor

from surrogate.deformation.visualization import Visualization
from surrogate.storage.encoding import FORMATS, Encoding, encode
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.fitted import Fitted

NAME = "precision"
FEWEST_ROWS = 8  # with which 8 bits, and two float32 numbers per column, take no more bytes than half precision


def choose_precision(fitted: Fitted, evaluator: Evaluator) -> tuple[Fitted, dict[str, Encoding], Choice]:
    """Store each tensor, the largest first, in the fewest bits with which all so far cost no more than the tolerance.

    Returns the model as it will be read again, the encodings by tensor, and the choice.
    """
    fitted = fitted.to(torch.device("cpu"))  # where models are stored and read
    before = evaluator.measure(fitted)
    stored, chosen, tried = _in_fewest_bits(
        fitted.tensors(),
        lambda tensors: evaluator.psnr(Fitted.load(tensors, fitted.record())),
        before.psnr - evaluator.tolerance,
    )
    current = Fitted.load(stored, fitted.record())
    megabytes = current.megabytes - 1e-6 * sum(e.saved_bytes for e in chosen.values())
    after = evaluator.measure(current, megabytes=megabytes)
    options = [Option("all in float32", before.psnr), *tried, Option("as kept", after.psnr)]
    return current, chosen, Choice(NAME, _said(_by_size(stored), chosen), options, before, after)


def precision_of_visualization(
    visualization: Visualization, fitted: Fitted, evaluator: Evaluator
) -> tuple[Visualization, dict[str, Encoding], Choice]:
    """The same for F_vis and its copy of F_sim, on validation images of the variation; `fitted` is stored already."""

    def psnr(trial: Visualization) -> float:
        return evaluator.psnr_of(lambda parameters: trial.gaussians_at(*fitted, parameters))

    def loaded(tensors: Mapping[str, Tensor]) -> Visualization:
        return Visualization.load(tensors, visualization.record())

    before = psnr(visualization)
    stored, chosen, tried = _in_fewest_bits(
        visualization.stored(), lambda tensors: psnr(loaded(tensors)), before - evaluator.tolerance
    )
    current = loaded(stored)
    options = [Option("all in float32", before), *tried, Option("as kept", psnr(current))]
    return current, chosen, Choice(f"{NAME}, {visualization.variation.name}", _said(_by_size(stored), chosen), options)


def _in_fewest_bits(
    tensors: Mapping[str, Tensor], psnr_of: Callable[[Mapping[str, Tensor]], float], enough: float
) -> tuple[dict[str, Tensor], dict[str, Encoding], list[Option]]:
    """The tensors as they will be read again, their encodings, and what failed: the largest first, all so far reach `enough` dB."""
    kept, chosen, failed = dict(tensors), dict[str, Encoding](), []
    for name in _by_size(tensors):
        for encoding in _encodings(tensors[name]):
            trial = kept | {name: encoding.decoded()}
            psnr = psnr_of(trial)
            if psnr >= enough:
                kept, chosen[name] = trial, encoding
                break
            failed.append(Option(f"{name} in {encoding.form}", psnr))
    return kept, chosen, failed


def _encodings(tensor: Tensor) -> list[Encoding]:
    """A tensor in each of `FORMATS` that can hold it and saves anything, the shortest first.

    That is their own order, but for so few rows that the two numbers which levels need for each column weigh more.
    """
    found = [encode(tensor, form) for form in FORMATS]
    kept = [e for e in found if e.saved_bytes > 0 and torch.isfinite(e.decoded()).all()]
    return sorted(kept, key=lambda e: -e.saved_bytes) if len(tensor) < FEWEST_ROWS else kept


def _by_size(tensors: Mapping[str, Tensor]) -> list[str]:
    return sorted(tensors, key=lambda name: (-tensors[name].numel(), name))


def _said(names: Sequence[str], chosen: Mapping[str, Encoding]) -> str:
    """The formats, the most frequent first, each with its tensors; the first without them."""
    forms: dict[str, list[str]] = {}
    for name in names:
        forms.setdefault(chosen[name].form if name in chosen else "float32", []).append(name)
    (usual, _), *others = sorted(forms.items(), key=lambda item: -len(item[1]))
    return "; ".join([usual, *(f"{form} for {', '.join(kept)}" for form, kept in others)])
