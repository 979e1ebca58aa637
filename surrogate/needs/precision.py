"""In how few bits a model may be stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from surrogate.encoding import FORMATS, Encoding, encode
from surrogate.needs.choice import Choice, Option
from surrogate.needs.fitted import Bench, Fitted
from surrogate.visualization import Visualization

NAME = "precision"


def choose_precision(fitted: Fitted, bench: Bench) -> tuple[Fitted, dict[str, Encoding], Choice]:
    """Store each tensor, the largest first, in the fewest bits with which all so far cost no more than the tolerance.

    Returns the model as it will be read again, the encodings by tensor, and the choice.
    """
    fitted = fitted.to(torch.device("cpu"))  # where models are stored and read
    before = bench.measure(fitted)
    options, chosen, current = [Option("all in float32", before.psnr)], dict[str, Encoding](), fitted
    by_size = sorted(fitted.tensors(), key=lambda name: (-fitted.tensors()[name].numel(), name))
    for name in by_size:
        for form in FORMATS:
            encoding = encode(fitted.tensors()[name], form)
            trial = with_tensor(current, name, encoding.decoded())
            psnr = bench.psnr(trial)
            if psnr >= before.psnr - bench.tolerance:
                current, chosen[name] = trial, encoding
                break
            options.append(Option(f"{name} in {form}", psnr))
    megabytes = current.megabytes - 1e-6 * sum(e.saved_bytes for e in chosen.values())
    after = bench.measure(current, megabytes=megabytes)
    options.append(Option("as kept", after.psnr))
    return current, chosen, Choice(NAME, _said(by_size, chosen), options, before, after)


def precision_of_visualization(
    visualization: Visualization, fitted: Fitted, bench: Bench
) -> tuple[Visualization, dict[str, Encoding], Choice]:
    """The same for F_vis and its copy of F_sim, on validation images of the variation; `fitted` is stored already."""

    def psnr(trial: Visualization) -> float:
        return bench.psnr_of(lambda parameters: trial.gaussians_at(*fitted, parameters))

    before = psnr(visualization)
    options, chosen, current = [Option("all in float32", before)], dict[str, Encoding](), visualization
    by_size = sorted(visualization.stored(), key=lambda name: (-visualization.stored()[name].numel(), name))
    for name in by_size:
        for form in FORMATS:
            encoding = encode(visualization.stored()[name], form)
            trial = Visualization.load(current.stored() | {name: encoding.decoded()}, current.record())
            found = psnr(trial)
            if found >= before - bench.tolerance:
                current, chosen[name] = trial, encoding
                break
            options.append(Option(f"{name} in {form}", found))
    options.append(Option("as kept", psnr(current)))
    kind = visualization.variation.kind.replace("_", " ")
    return current, chosen, Choice(f"{NAME}, {kind}", _said(by_size, chosen), options)


def _said(names: Sequence[str], chosen: Mapping[str, Encoding]) -> str:
    """The formats, the most frequent first, each with its tensors; the first without them."""
    forms: dict[str, list[str]] = {}
    for name in names:
        forms.setdefault(chosen[name].form if name in chosen else "float32", []).append(name)
    (usual, _), *others = sorted(forms.items(), key=lambda item: -len(item[1]))
    return "; ".join([usual, *(f"{form} for {', '.join(kept)}" for form, kept in others)])


def with_tensor(fitted: Fitted, name: str, tensor: Tensor) -> Fitted:
    """The model with one of its stored tensors replaced."""
    return fitted_of(fitted, fitted.tensors() | {name: tensor})


def fitted_of(fitted: Fitted, tensors: Mapping[str, Tensor]) -> Fitted:
    """A model like `fitted` with the stored `tensors`."""
    gaussians = {name: tensors[f"gaussians.{name}"] for name in fitted.gaussians.tensors()}
    stored = {name: tensors[f"deformation.{name}"] for name in fitted.deformation.stored()}
    deformation = type(fitted.deformation).load(stored, fitted.deformation.record())
    return Fitted(type(fitted.gaussians)(**gaussians), deformation)
