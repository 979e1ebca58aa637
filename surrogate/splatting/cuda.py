"""Splatting on a GPU by gsplat (Ye et al. 2024, "gsplat: An Open-Source Library for Gaussian Splatting"), the extra `[cuda]`.

Differences from the other backends, which are compiled into gsplat's kernels:

- The alpha floor is 1/255 and the alpha cap 0.999: other values are refused.
- A Gaussian after which less than 1e-4 of the light would be left is not drawn at all, where the others draw it and
then\n  stop. The difference is at most a tenth of a pixel's light, and only behind a Gaussian that is itself almost
opaque.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from surrogate.splatting.rendering import Constants, Primitives, Rendering

COMPILED = {"alpha_floor": 1.0 / 255.0, "alpha_cap": 0.999}
NEEDED = "1.5.3"


def unusable() -> str:
    """The reason why this backend can't be used here; empty where it can."""
    if importlib.util.find_spec("gsplat") is None:
        return f"gsplat >= {NEEDED} is not installed: pip install 'gs-surrogate[cuda]'"
    if not torch.cuda.is_available():
        return f"torch {torch.__version__} sees no CUDA device"
    return ""


def chosen_device(setting: str) -> torch.device:
    """The device that a setting means: "auto" is a GPU where torch and gsplat can use one, else main memory.

    Raises RuntimeError saying what is missing where "cuda" is asked for in vain.
    """
    reason = unusable()
    if setting == "cuda" and reason:
        raise RuntimeError(f'training.device is "cuda", but {reason}')
    return torch.device("cpu" if setting == "cpu" or reason else "cuda")


def usable_device(device: str | torch.device) -> torch.device:
    """A device that can draw: "cpu", or "cuda", which may have a number.

    Raises ValueError for what is neither, RuntimeError saying what is missing where there is no such GPU here.
    """
    try:
        chosen = torch.device(device)
    except (RuntimeError, TypeError):
        chosen = torch.device("meta")
    if chosen.type not in ("cpu", "cuda"):
        raise ValueError(f'device must be "cpu" or "cuda", which draw Gaussians, got {str(device)!r}')
    if chosen.type == "cuda":
        count = torch.cuda.device_count()
        reason = unusable() or (f"there are {count}, counted from 0" if (chosen.index or 0) >= count else "")
        if reason:
            raise RuntimeError(f'the device "{chosen}" can\'t be used: {reason}')
    return chosen


def render(primitives: Primitives, camera: Camera, constants: Constants) -> Rendering:
    """Render Gaussians in float32 on the GPU that holds them.

    Raises ValueError for tensors that are not on a GPU, for an `alpha_floor` or `alpha_cap` that gsplat lacks, and for
    non-finite numbers, naming the Gaussian and the attribute. Raises ModuleNotFoundError where gsplat is missing.
    """
    _check_constants(constants)
    _check_tensors(primitives)
    means, scales, quats, opacities, colors = primitives
    rasterization = _gsplat().rasterization
    if not len(means):
        nothing = sum((tensor.sum() for tensor in primitives), means.new_zeros(()))
        return Rendering(
            nothing + means.new_zeros(camera.height, camera.width, 3),
            nothing + means.new_zeros(camera.height, camera.width),
        )
    color, alpha, _ = rasterization(
        means=means.float(),
        quats=_unit(quats.float()),
        scales=scales.float(),
        opacities=opacities.float(),
        colors=colors.float(),
        viewmats=torch.tensor(camera.world_to_camera, dtype=torch.float32, device=means.device)[None],  # [1, 4, 4]
        Ks=_intrinsics(camera).to(means.device)[None],  # [1, 3, 3]
        width=camera.width,
        height=camera.height,
        near_plane=constants.near,
        far_plane=torch.finfo(torch.float32).max,
        eps2d=constants.dilation,
        radius_clip=0.0,
        packed=False,
        render_mode="RGB",
        rasterize_mode="classic",
    )
    return Rendering(color[0], alpha[0, ..., 0])


def _gsplat() -> Any:
    try:
        return importlib.import_module("gsplat")
    except ImportError as error:
        raise ModuleNotFoundError(f"backend 'cuda': {unusable() or error}") from error


def _check_constants(constants: Constants) -> None:
    for name, compiled in COMPILED.items():
        value = getattr(constants, name)
        if abs(value - compiled) > 1e-6:
            raise ValueError(
                f"backend 'cuda' draws with {name} = {compiled:.6g}, which is compiled into gsplat, got {value:.6g}: choose "
                "that value or the backend 'cpu'"
            )


def _check_tensors(primitives: Primitives) -> None:
    count = len(primitives.means)
    columns = {"means": (3,), "scales": (3,), "quats": (4,), "opacities": (), "colors": (3,)}
    for name, tensor in primitives._asdict().items():
        if not _on_gpu(tensor):
            raise ValueError(
                f"backend 'cuda' needs {name} on a CUDA device, got {tensor.device}: move it or choose 'cpu'"
            )
        if tensor.shape != (count, *columns[name]):
            raise ValueError(f"{name} must be of shape {(count, *columns[name])}, got {tuple(tensor.shape)}")
    finite = torch.stack([torch.isfinite(tensor).all() for tensor in primitives]).tolist()
    for name, tensor, good in zip(primitives._fields, primitives, finite, strict=True):
        if not good:
            row = int((~torch.isfinite(tensor.reshape(count, -1))).any(dim=1).nonzero()[0])
            raise ValueError(f"{name} of Gaussian {row} is not finite: {tensor[row].tolist()}")


def _on_gpu(tensor: Tensor) -> bool:
    return tensor.is_cuda


def _unit(quats: Tensor) -> Tensor:
    """Quaternions (N, 4) of length 1; those shorter than 1e-12 give no rotation and no gradient."""
    largest = quats.abs().amax(dim=1, keepdim=True)  # [N, 1], so that no square over- or underflows
    long_enough = largest > Constants.shortest_quaternion
    scaled = quats / torch.where(long_enough, largest, 1.0)  # [N, 4]
    unit = scaled / torch.where(long_enough, scaled.norm(dim=1, keepdim=True), 1.0)
    return torch.where(long_enough, unit, quats.new_tensor([1.0, 0.0, 0.0, 0.0]))


def _intrinsics(camera: Camera) -> Tensor:
    return torch.tensor([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])  # [3, 3]
