"""Small surrogates that pages draw, as they are stored, and cameras around them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate import Surrogate
from surrogate.appearance.field_gaussians import FieldGaussians, FieldValues
from surrogate.appearance.scale import ValueScale
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.emulated_values import EmulatedValues
from surrogate.emulation.processes import Processes
from surrogate.gaussians import Normalization
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.storage.encoding import encode
from tests.support.surrogates import some_surrogate

SIDE, COUNT = 64, 400
CENTER, EXTENT = np.array([1e3, -2e3, 5.0]), 40.0
BASE = TransferFunction(
    ((0.0, 0.1, 0.2, 0.8), (0.4, 0.9, 0.9, 0.4), (1.0, 0.8, 0.1, 0.1)),
    ((0.0, 0.0), (0.3, 0.2), (0.7, 0.05), (1.0, 0.9)),
    0.3,
)


def colored(columns: int = 3, samples: int = 1) -> Surrogate:
    made = replace(some_surrogate(columns, COUNT), rasterizer=Rasterizer(samples=samples))
    fainter = replace(
        made.gaussians, opacity_logits=made.gaussians.opacity_logits - 2.5
    )  # few pixels reach what is cut off
    return replace(made, gaussians=fainter, normalization=Normalization(CENTER, EXTENT))


def carrying(medium: bool = True, frequencies: int = 0, follow: bool = False, scale: str = "linear") -> Surrogate:
    """Gaussians that carry values, in few bits as they are stored."""
    random = torch.Generator().manual_seed(5)
    shapes = {"means": 3, "log_scales": 3, "quats": 4, "values": 2}
    table = {name: torch.randn(COUNT, width, generator=random) for name, width in shapes.items()}
    table["means"] *= 0.4
    table["log_scales"] = 0.4 * table["log_scales"] - 2.2
    table["values"] = torch.stack([0.5 + 0.3 * table["values"][:, 0], -3.0 + table["values"][:, 1]], dim=1)
    scaled = ValueScale.of_function(BASE)
    gaussians = FieldGaussians.of_tensors(
        table | {"opacity_logits": 2.0 * torch.randn(COUNT, generator=random)}, FieldValues(BASE, scaled, medium)
    )
    settings = TrainingSettings(latent_size=5, hidden_width=8, parameter_frequencies=frequencies)
    blank = BilinearDeformation.create(gaussians, 2, settings)
    moving = blank.with_tensors(
        {
            n: t + (0.2 if n == "weights_out" else 0.05) * torch.randn(t.shape, generator=random)
            for n, t in blank.tensors().items()
        }
    )
    if follow:
        points = np.random.default_rng(1).uniform(-1.0, 1.0, (9, 2))
        processes = Processes.fit(points, np.column_stack([np.sin(3.0 * points[:, 0]), points[:, 1] ** 2 - 0.3]))
        modes = 0.3 * torch.randn(COUNT, 2, generator=random)
        moving = replace(moving, emulated=EmulatedValues(0.5 + 0.2 * table["means"][:, 0], modes, processes, scaled))
    space = ParameterSpace((Parameter("Re", 100.0, 2500.0, scale=scale), Parameter("time", 0.0, 2.0, "s")))
    made = Surrogate(gaussians, moving, space, Normalization(CENTER, EXTENT), Rasterizer(), (1.0, 1.0, 1.0))
    encodings = {f"gaussians.{name}": encode(getattr(gaussians, name), "uint8") for name in ("quats", "opacity_logits")}
    encodings["deformation.latents"] = encode(moving.latents, "uint8")
    encodings["gaussians.means"] = encode(gaussians.means, "uint16")
    encodings["gaussians.log_scales"] = encode(gaussians.log_scales, "float16")
    decoded = {name.removeprefix("gaussians."): e.decoded() for name, e in encodings.items() if "gaussians" in name}
    order = ("means", "log_scales", "quats", "opacity_logits", "values")
    stored = gaussians.with_tensors([decoded.get(name, getattr(gaussians, name)) for name in order])
    latents = moving.with_tensors({**moving.tensors(), "latents": encodings["deformation.latents"].decoded()})
    return replace(made, gaussians=stored, deformation=latents, encodings=encodings)


def cameras(count: int) -> list[Camera]:
    """From around the volume, and the last from inside it."""
    random = np.random.default_rng(2)
    made = []
    for number in range(count):
        direction = random.standard_normal(3)
        distance = (0.3 if number == count - 1 else 3.0) * EXTENT
        place = CENTER + distance * direction / np.linalg.norm(direction)
        target = CENTER + 0.1 * EXTENT * random.standard_normal(3)
        made.append(Camera.look_at(place, target, vertical_fov_degrees=40.0, width=SIDE, height=SIDE - 8))
    return made
