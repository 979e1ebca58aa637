"""Effect of constants and rules that are compiled into gsplat, or usual elsewhere, on the image of the same Gaussians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from research.benchmarks.page import table
from research.benchmarks.splatting.setup import Setup
from research.benchmarks.splatting.trained import TrainedModels
from research.benchmarks.splatting.workloads import FIXED, OTHERS, View
from surrogate.evaluation.metrics import decibels
from surrogate.splatting import Constants, Primitives, reference

PIXELS = 1024
AT_ONCE = 64
OURS = "ours"


def constants(setup: Setup, trained: TrainedModels) -> str:
    """PSNR against the picture by our rules, and the largest difference, in float64, by scene and rule."""
    opaque = next(workload for workload in OTHERS if workload.shells)
    cases = {FIXED.title: FIXED.view(), opaque.title: opaque.view(), f"model of {trained.name}": trained.view()}
    rows = []
    for name, view in cases.items():
        setup.say(f"{name}: other constants")
        pictures = drawn_by_rule(view, PIXELS // (8 if setup.quick else 1))
        ours = pictures.pop(OURS)
        for rule, picture in pictures.items():
            difference = (picture - ours).numpy()
            largest = float(np.abs(difference).max())
            rows.append(
                [name, rule, f"{decibels(float(np.mean(difference**2))):.1f}", f"{largest:.1e}" if largest else "0"]
            )
    return table(["scene", "what is changed", "PSNR against ours, dB (at most 60)", "largest difference"], rows)


def drawn_by_rule(view: View, count: int) -> dict[str, Tensor]:
    """Premultiplied RGBA (P, 4) of some pixels, by rule."""
    own = view.constants
    pixels = reference.pixel_centers(view.camera).double()
    chosen = pixels[
        torch.from_numpy(np.random.default_rng(0).choice(len(pixels), min(count, len(pixels)), replace=False))
    ]
    rules = {
        OURS: (own, False),
        f"dilation 0.3 px² instead of {own.dilation:g}": (replace(own, dilation=0.3), False),
        "dilation 0.1 px²": (replace(own, dilation=0.1), False),
        "no alpha floor instead of 1/255": (replace(own, alpha_floor=1e-9), False),
        "alpha cap 0.99 instead of 0.999": (replace(own, alpha_cap=0.99), False),
        "what would leave less than 1e-4 of the light is not drawn (gsplat)": (own, True),
    }
    return {rule: _drawn(view, chosen, *how) for rule, how in rules.items()}


def _drawn(view: View, pixels: Tensor, rule: Constants, stops_before: bool) -> Tensor:
    splats = reference.project(Primitives(*(tensor.double() for tensor in view.scene)), view.camera, rule)
    parts = []
    for some in pixels.split(AT_ONCE):
        alphas = reference.alphas_at(some, splats, rule)  # [P, M]
        if stops_before:
            left = torch.cumprod(1.0 - alphas, dim=1)  # [P, M]
            alphas = torch.where((left <= rule.min_transmittance).cumsum(dim=1) > 0, 0.0, alphas)
        parts.append(reference.composite(alphas, splats.colors))
    return torch.cat(parts)
