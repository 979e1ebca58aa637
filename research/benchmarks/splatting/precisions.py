"""Loss of image quality when the model is stored in fewer bits; rendering is always in float32."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from torch import Tensor

from research.benchmarks.page import table
from research.benchmarks.splatting.reference_patches import decibels
from research.benchmarks.splatting.setup import Setup
from research.benchmarks.splatting.trained import TrainedModels, mean_decibels, pictures
from surrogate.deformation import load_deformation
from surrogate.evaluation.metrics import composite
from surrogate.gaussians import Gaussians
from surrogate.model import Surrogate
from surrogate.storage.encoding import encode

JUDGED = 60


PRECISIONS: dict[str, tuple[int, Callable[[Tensor], Tensor]]] = {
    "float32": (32, lambda tensor: tensor),
    "float16": (16, lambda tensor: encode(tensor, "float16").decoded()),
    "bfloat16": (16, lambda tensor: tensor.bfloat16().float()),
    "16 bits, evenly spaced": (16, lambda tensor: encode(tensor, "uint16").decoded()),
    "8 bits, evenly spaced": (8, lambda tensor: encode(tensor, "uint8").decoded()),
}


def stored(surrogate: Surrogate, keep: Callable[[Tensor], Tensor]) -> Surrogate:
    """The model as read from a file that stores its tensors with less precision."""
    deformation = surrogate.deformation
    tensors = {name: keep(tensor) for name, tensor in deformation.stored().items()}
    return replace(
        surrogate,
        gaussians=Gaussians(*(keep(tensor) for tensor in surrogate.gaussians.tensors().values())),
        deformation=load_deformation(tensors, deformation.record()),
    )


def precisions(setup: Setup, trained: TrainedModels) -> str:
    """Size and error by precision: of all tensors, Gaussians and deformation."""
    whole, rows = trained.model, trained.validation(JUDGED // (20 if setup.quick else 1))
    cells = []
    for name, (bits, keep) in PRECISIONS.items():
        setup.say(f"{trained.name}: stored as {name}")
        model = stored(whole, keep)
        pairs = zip(pictures(model, rows), pictures(whole, rows), strict=True)
        differences = [
            composite(a.render(camera), trained.background).astype(np.float64)
            - composite(b.render(camera), trained.background)
            for (_, a, camera), (_, b, _) in pairs
        ]
        error, largest = float(np.mean(np.square(differences))), float(np.max(np.abs(differences)))
        loss = f"{decibels(error):.1f}" if error else "the same"
        judged = f"{mean_decibels(model, trained, rows):.3f}"
        cells.append([name, f"{whole.megabytes * bits / 32:.2f}", loss, f"{largest:.0e}" if largest else "0", judged])
    header = ["stored as", "MB", "PSNR against float32, dB", "largest difference", "PSNR against the stored images, dB"]
    return f"{trained.name}, {len(rows)} validation images.\n\n" + table(header, cells)
