"""Which attributes of the Gaussians must follow the parameters."""

from __future__ import annotations

from surrogate.gaussians import NAMES
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.fitted import Bench, Fitted

NAME = "attributes that deform"
HOPELESS = 1.0  # dB: what costs more at once is not tried with a recovery


def choose_attributes(fitted: Fitted, bench: Bench) -> tuple[Fitted, Choice]:
    """Hold still whatever is not worth moving: one attribute after the other, the least missed first.

    One is held still where the model, if need be after a short recovery, is worse by no more than the tolerance than with all.
    """
    before = bench.measure(fitted)
    options, current, enough = [Option("all", before.psnr)], fitted, before.psnr - bench.tolerance
    alone = {name: bench.psnr(fitted.without(name)) for name in NAMES if fitted.deformation.moves(name)}
    for turn, name in enumerate(sorted(alone, key=lambda n: -alone[n])):
        if before.psnr - alone[name] > max(HOPELESS, bench.tolerance):
            options.append(Option(f"without {_said(name)}", alone[name]))
            continue
        trial, psnr, how = bench.good_enough(current.without(name), enough, turn)
        options.append(Option(f"without {_said(name)}{how}", psnr))
        if psnr < enough:
            break
        current = trial
    moving = [_said(name) for name in NAMES if current.deformation.moves(name)]
    return current, Choice(NAME, ", ".join(moving) or "none", options, before, bench.measure(current))


def _said(name: str) -> str:
    return {"log_scales": "scales", "quats": "rotations", "opacity_logits": "opacities", "colors": "colours"}.get(
        name, name
    )
