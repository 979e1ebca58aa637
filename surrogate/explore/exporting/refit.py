"""Gaussians fitted to pictures by the rule of other viewers.

Our opacities depend on where a Gaussian is seen from, our colours may be negative, and our edges end at an alpha.  Other viewers
have none of it.  So the Gaussians are moved until these see the same, by gradients of a few thousand pictures.

The rule is that of KHR_gaussian_splatting, "Ellipse Kernel Rendering": alphas are an opacity times the projected Gaussian,
without dilation, and colours are cut at zero.  Sorting by depth stands for sorting by distance, and a very low floor of alpha for
a cut at three standard deviations: the renderer has no other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from surrogate.evaluation.scoring import spread
from surrogate.explore.exporting.kinds import REFIT_STEPS
from surrogate.explore.exporting.splats import Splats, harmonics_of
from surrogate.gaussians import Normalization
from surrogate.randomness import generator
from surrogate.splatting import Constants, Primitives, draw_over
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.optimizer import Adam
from surrogate.training.sampling import ShuffledEpochs

VIEWS, SIDE = 128, 256  # of the pictures at most, and their pixels along the longer side
CONSTANTS = Constants(dilation=0.0, alpha_floor=2e-4, alpha_cap=0.99)
RATES = {"means": 6e-3, "log_scales": 1.2e-2, "quats": 6e-3, "logits": 0.12, "colors": 1e-2}
RISE, LAST = 30, 0.02  # steps until the rates are whole, and their share at the end
LEAST = 1e-4  # opacities begin between this and one less

Draw = Callable[[Camera], NDArray[np.float32]]  # pictures (H, W, 4), premultiplied


@one_torch_thread()
def refitted(
    splats: Splats,
    draw: Draw,
    cameras: Sequence[Camera],
    placed: Normalization,
    steps: int = REFIT_STEPS,
    progress: Callable[[int, int], object] = lambda *_: None,
) -> Splats:
    """The Gaussians whose pictures by the viewers' rule are nearest to those that `draw` gives, from `cameras` in the world.

    `placed` are coordinates in which they are of order one.  The same steps give the same Gaussians.
    """
    views = [_smaller(cameras[i]) for i in spread(len(cameras), VIEWS)]
    pictures: dict[int, Tensor] = {}
    tensors = _tensors(splats, placed)
    optimizer, order = Adam(tensors, RATES), ShuffledEpochs(len(views), 0)
    for step in range(steps):
        number = order[step]
        if number not in pictures:
            pictures[number] = torch.from_numpy(np.array(draw(views[number])))  # [H, W, 4]
        behind = generator(0, "values", step).random(3, dtype=np.float32)
        camera = placed.camera(views[number])
        picture = draw_over(_primitives(tensors, camera), camera, behind.tolist(), CONSTANTS)  # [H, W, 4]
        color, alpha = pictures[number][..., :3], pictures[number][..., 3:]
        wanted = torch.cat([color + (1.0 - alpha) * torch.from_numpy(behind), alpha], dim=-1)
        (picture - wanted).square().mean().backward()
        optimizer.step(min(1.0, (step + 1) / RISE) * LAST ** (step / steps))
        progress(step + 1, steps)
    return _splats(tensors, placed, splats)


def _smaller(camera: Camera) -> Camera:
    scale = min(1.0, SIDE / max(camera.width, camera.height))
    return camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))


def _tensors(splats: Splats, placed: Normalization) -> dict[str, Tensor]:
    opacities = splats.opacities.clip(LEAST, 1.0 - LEAST)
    arrays = {
        "means": placed.points(splats.means),
        "log_scales": np.log(splats.scales) - math.log(placed.extent),
        "quats": splats.quats,
        "logits": np.log(opacities) - np.log1p(-opacities),
        "colors": splats.coefficients.reshape(len(splats), -1),
    }
    return {name: torch.from_numpy(array.astype(np.float32)).requires_grad_() for name, array in arrays.items()}


def _primitives(tensors: dict[str, Tensor], camera: Camera) -> Primitives:
    """The Gaussians as `camera` sees them, in their own coordinates."""
    means, colors = tensors["means"], tensors["colors"]
    count = colors.shape[1] // 3
    if count > 1:
        away = means.detach() - torch.from_numpy(camera.position).to(means)  # [N, 3]
        basis = harmonics_of(torch.nn.functional.normalize(away, dim=1), count)  # [N, K]
        colors = torch.einsum("nk,nkc->nc", basis, colors.reshape(-1, count, 3))
    opacities = tensors["logits"].sigmoid()
    return Primitives(means, tensors["log_scales"].exp(), tensors["quats"], opacities, colors.clamp(min=0.0))


def _splats(tensors: dict[str, Tensor], placed: Normalization, before: Splats) -> Splats:
    arrays = {name: tensor.detach().double().numpy() for name, tensor in tensors.items()}
    quats = arrays["quats"]
    return replace(
        before,
        means=placed.world(arrays["means"]),
        scales=np.exp(arrays["log_scales"]) * placed.extent,
        quats=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        opacities=1.0 / (1.0 + np.exp(-arrays["logits"])),
        coefficients=arrays["colors"].reshape(before.coefficients.shape),
    )
