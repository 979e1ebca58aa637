"""In how few bits a model may be stored."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import torch
from torch import Tensor

from surrogate.deformation.emulated_values import EXACT
from surrogate.deformation.visualization import Visualization
from surrogate.storage.encoding import FORMATS, Encoding, encode
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.state import FittedGaussians

Model = TypeVar("Model")

NAME = "precision"
FEWEST_ROWS = 8  # with which 8 bits, and two float32 numbers per column, take no more bytes than half precision


def choose_precision(
    fitted: FittedGaussians, evaluator: Evaluator
) -> tuple[FittedGaussians, dict[str, Encoding], Choice]:
    """Store every tensor in the fewest bits that keep the whole loss within the tolerance; the largest tensors come first.

    Returns the model as it will be read again, the encodings by tensor, and the choice.
    """
    fitted = fitted.to(torch.device("cpu"))  # where models are stored and read
    before = evaluator.measure(fitted)

    def load(tensors: Mapping[str, Tensor]) -> FittedGaussians:
        return FittedGaussians.load(tensors, fitted.record())

    current, chosen, choice = _in_fewest_bits(
        NAME, fitted.tensors(), load, evaluator.psnr, before.psnr, evaluator.tolerance
    )
    megabytes = current.megabytes - 1e-6 * sum(e.saved_bytes for e in chosen.values())
    after = evaluator.measure(current, choice.options[-1].psnr, megabytes)
    return current, chosen, replace(choice, before=before, after=after)


def precision_of_visualization(
    visualization: Visualization, fitted: FittedGaussians, evaluator: Evaluator
) -> tuple[Visualization, dict[str, Encoding], Choice]:
    """The same for the deformations of a visualization, on validation images of the variation; `fitted` is stored already."""

    def psnr(trial: Visualization) -> float:
        return evaluator.psnr_of(lambda parameters: trial.gaussians_at(*fitted, parameters))

    def load(tensors: Mapping[str, Tensor]) -> Visualization:
        return Visualization.load(tensors, visualization.record())

    name = f"{NAME}, {visualization.variation.name}"
    return _in_fewest_bits(name, visualization.stored(), load, psnr, psnr(visualization), evaluator.tolerance)


def _in_fewest_bits(
    name: str,
    tensors: Mapping[str, Tensor],
    load: Callable[[Mapping[str, Tensor]], Model],
    psnr_of: Callable[[Model], float],
    before: float,
    tolerance: float,
) -> tuple[Model, dict[str, Encoding], Choice]:
    current, chosen, options = dict(tensors), dict[str, Encoding](), [Option("all in float32", before)]
    rounded = [name for name in tensors if name.rpartition(".")[2] not in EXACT]
    largest_first = sorted(rounded, key=lambda name: (-tensors[name].numel(), name))
    for tensor in largest_first:
        for encoding in _encodings(tensors[tensor]):
            trial = current | {tensor: encoding.decoded()}
            psnr = psnr_of(load(trial))
            if psnr >= before - tolerance:
                current, chosen[tensor] = trial, encoding
                break
            options.append(Option(f"{tensor} in {encoding.form}", psnr))
    model = load(current)
    options.append(Option("as kept", psnr_of(model)))
    return model, chosen, Choice(name, _said(largest_first, chosen), options)


def _encodings(tensor: Tensor) -> list[Encoding]:
    """A tensor in each of `FORMATS` that can hold it and saves anything, the shortest first.

    That is their own order, but for so few rows that the two numbers which levels need for each column weigh more.
    """
    encodings = [encode(tensor, form) for form in FORMATS]
    useful = [e for e in encodings if e.saved_bytes > 0 and torch.isfinite(e.decoded()).all()]
    return sorted(useful, key=lambda e: -e.saved_bytes) if len(tensor) < FEWEST_ROWS else useful


def _said(names: Sequence[str], chosen: Mapping[str, Encoding]) -> str:
    """The formats, the most frequent first, each with its tensors; the first without them."""
    forms: dict[str, list[str]] = {}
    for name in names:
        forms.setdefault(chosen[name].form if name in chosen else "float32", []).append(name)
    (usual, _), *others = sorted(forms.items(), key=lambda item: -len(item[1]))
    return "; ".join([usual, *(f"{form} for {', '.join(group)}" for form, group in others)])
