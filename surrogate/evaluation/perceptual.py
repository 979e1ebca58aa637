"""Perceptual metrics MS-SSIM, LPIPS and FLIP, each where its package and its weights are installed.

Images are compared as in `evaluation.metrics`: composited on the background and clipped to [0, 1]. Nothing is
downloaded: LPIPS reads AlexNet's weights from the file named in `GS_SURROGATE_LPIPS_WEIGHTS`, or from torch's cache.
Without them LPIPS is missing, with the reason. The packages come with `pip install 'gs-surrogate[metrics]'`.

Limits: torchvision is avoided, because its CUDA wheel on PyPI does not load beside a CPU torch. AlexNet's five
convolutions are therefore written here. The heads of LPIPS come from torchmetrics; they are byte for byte the file
`weights/v0.1/alex.pth` of the package lpips 0.1.4. FLIP holds Python's lock while it runs and starts its own threads,
so two threads score no faster than one. OMP_NUM_THREADS limits them.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

WEIGHTS_VARIABLE = "GS_SURROGATE_LPIPS_WEIGHTS"
WEIGHTS_FILE = "alexnet-owt-7be5be79.pth"
WEIGHTS_ADDRESS = f"https://download.pytorch.org/models/{WEIGHTS_FILE}"
HEADS_PACKAGE, HEADS_FILE = "torchmetrics", "functional/image/lpips_models/alex.pth"
INSTALL = "pip install 'gs-surrogate[metrics]'"

MS_SSIM_SMALLEST = 161  # the window of 11 pixels must fit the picture after four halvings, as pytorch-msssim counts it
LPIPS_SMALLEST = 31  # below, AlexNet's second pooling has nothing left to pool

DEFINITIONS = {
    "ms_ssim": "Wang et al. 2003, by pytorch-msssim: product over five scales, each of half the size, of contrast and "
    "structure, and of luminance at the last, to the powers 0.0448, 0.2856, 0.3001, 0.2363, 0.1333; 11x11 Gaussian window "
    "of sigma 1.5 wholly inside the picture, K1 0.01, K2 0.03, negative terms as 0, odd sizes are halved with a border of "
    f"zeros, mean over channels; 1 is identical; none for a side under {MS_SSIM_SMALLEST} pixels; mean over images",
    "lpips": "Zhang et al. 2018, version 0.1: distance of the unit-length features of torchvision's AlexNet at its five "
    "rectified convolutions, weighed by the linear heads learnt from human judgements, mean over positions, sum over "
    f"layers; 0 is identical; none for a side under {LPIPS_SMALLEST} pixels; mean over images",
    "flip": "Andersson et al. 2020, LDR-FLIP by NVIDIA's flip-evaluator at its default of 67 pixels per degree: the error "
    "seen when flipping between the two pictures, mean over pixels; 0 is identical, 1 the most; mean over images",
}

# The convolutions of torchvision's `alexnet().features`: index, shape of the weights, stride, padding.  Each is
# rectified; the second and the third come after a maximum over 3x3 pixels, every second.
CONVOLUTIONS = (
    (0, (64, 3, 11, 11), 4, 2),
    (3, (192, 64, 5, 5), 1, 2),
    (6, (384, 192, 3, 3), 1, 1),
    (8, (256, 384, 3, 3), 1, 1),
    (10, (256, 256, 3, 3), 1, 1),
)
POOLED = (3, 6)
# ImageNet's mean and deviation for pixels in [-1, 1], as LPIPS rounds them.
SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)
LEAST_LENGTH = 1e-10

Picture = NDArray[np.float32]
Measure = Callable[[Picture, Picture], float]


class _Unavailable(Exception):
    """The reason why a metric is unavailable, in one line for reports."""


@dataclass(frozen=True)
class Perceptual:
    """The perceptual metrics of one image: None where the metric is unavailable, nan where the image is too small."""

    ms_ssim: float | None
    lpips: float | None
    flip: float | None


@dataclass(frozen=True, eq=False)
class PerceptualMetrics:
    """The metrics available on this machine, by name; any number of threads may score at once.

    Attributes
    ----------
    unavailable : for each missing metric one line about what is missing and where to get it.

    Examples
    --------
    >>> import numpy as np
    >>> from surrogate.evaluation.perceptual import PerceptualMetrics
    >>> black, white = np.zeros((8, 8, 3), np.float32), np.ones((8, 8, 3), np.float32)
    >>> PerceptualMetrics.load().score(black, white).flip
    0.967...
    """

    measures: Mapping[str, Measure]
    unavailable: Mapping[str, str]

    @classmethod
    def load(cls) -> PerceptualMetrics:
        """Find the available metrics, and read the weights of LPIPS; nothing is downloaded."""
        measures, unavailable = {}, {}
        for name, loader in (("ms_ssim", _load_ms_ssim), ("lpips", _load_lpips), ("flip", _load_flip)):
            try:
                measures[name] = loader()
            except _Unavailable as reason:
                unavailable[name] = str(reason)
        return cls(measures, unavailable)

    def score(self, truth: Picture, prediction: Picture) -> Perceptual:
        """Compare two images (H, W, 3) with values in [0, 1] by every available metric."""
        if truth.ndim != 3 or truth.shape[2] != 3 or truth.shape != prediction.shape:
            raise ValueError(f"pictures must both be (H, W, 3), got truth {truth.shape}, prediction {prediction.shape}")
        pair = [np.ascontiguousarray(image, dtype=np.float32) for image in (truth, prediction)]
        with torch.inference_mode():
            values = {name: measure(pair[0], pair[1]) for name, measure in self.measures.items()}
        return Perceptual(values.get("ms_ssim"), values.get("lpips"), values.get("flip"))

    def __repr__(self) -> str:
        missing = (f"no {name}: {reason}" for name, reason in self.unavailable.items())
        return f"PerceptualMetrics({'; '.join([', '.join(self.measures), *missing])})"


def _load_ms_ssim() -> Measure:
    ms_ssim = _installed("pytorch-msssim").ms_ssim

    def measure(truth: Picture, prediction: Picture) -> float:
        if min(truth.shape[:2]) < MS_SSIM_SMALLEST:
            return math.nan
        pair = _batch(truth, prediction)
        return float(ms_ssim(pair[1:], pair[:1], data_range=1.0))

    return measure


def _load_flip() -> Measure:
    flip = _installed("flip-evaluator").evaluate
    return lambda truth, prediction: float(flip(truth, prediction, "LDR", applyMagma=False, parameters={})[1])


def _load_lpips() -> Measure:
    heads, convolutions = _heads(), _alexnet(_weights_path())

    def measure(truth: Picture, prediction: Picture) -> float:
        if min(truth.shape[:2]) < LPIPS_SMALLEST:
            return math.nan
        distance = 0.0
        for features, head in zip(_features(_batch(truth, prediction), convolutions), heads, strict=True):
            length = features.square().sum(dim=1, keepdim=True).sqrt()  # [2, 1, h, w]
            directions = features / (length + LEAST_LENGTH)
            difference = (directions[:1] - directions[1:]).square()  # [1, C', h, w]
            distance += float(functional.conv2d(difference, head).mean())
        return distance

    return measure


def _features(images: Tensor, convolutions: Sequence[tuple[Tensor, Tensor]]) -> Iterator[Tensor]:
    """Rectified features [2, C', h, w] of each convolution, given by weights and biases, for images [2, 3, H, W] in [0, 1]."""
    shift, scale = (torch.tensor(values).view(1, 3, 1, 1) for values in (SHIFT, SCALE))
    features = (2.0 * images - 1.0 - shift) / scale
    for (index, _, stride, padding), (weights, biases) in zip(CONVOLUTIONS, convolutions, strict=True):
        if index in POOLED:
            features = functional.max_pool2d(features, kernel_size=3, stride=2)
        yield (features := functional.conv2d(features, weights, biases, stride, padding).relu())


def _weights_path() -> Path:
    """The file that the environment names, else torch's cached copy."""
    named = os.environ.get(WEIGHTS_VARIABLE)
    path = Path(named).expanduser() if named else Path(torch.hub.get_dir()) / "checkpoints" / WEIGHTS_FILE
    if path.is_file():
        return path
    if named:
        raise _Unavailable(f"{WEIGHTS_VARIABLE} names {path}, which is not a file")
    raise _Unavailable(
        f"no AlexNet weights: put {WEIGHTS_ADDRESS} at {path} or name a copy in {WEIGHTS_VARIABLE} "
        "(nothing is downloaded for you)"
    )


def _alexnet(path: Path) -> list[tuple[Tensor, Tensor]]:
    """Weights and biases of `CONVOLUTIONS` from a state dict of torchvision's AlexNet."""
    tensor = partial(_tensor, _read(path), path)
    return [
        (tensor(f"features.{index}.weight", shape), tensor(f"features.{index}.bias", shape[:1]))
        for index, shape, _, _ in CONVOLUTIONS
    ]


def _heads() -> list[Tensor]:
    """The linear heads of LPIPS 0.1 for AlexNet, each [1, C', 1, 1]; the package that carries them isn't imported."""
    package = importlib.util.find_spec(HEADS_PACKAGE)
    if package is None or not package.submodule_search_locations:
        raise _not_installed(HEADS_PACKAGE)
    path = Path(package.submodule_search_locations[0]) / HEADS_FILE
    if not path.is_file():
        raise _Unavailable(f"this release of {HEADS_PACKAGE} lacks the heads of LPIPS ({HEADS_FILE}): {INSTALL}")
    tensor = partial(_tensor, _read(path), path)
    shapes = [(1, shape[0], 1, 1) for _, shape, _, _ in CONVOLUTIONS]
    return [tensor(f"lin{layer}.model.1.weight", shape) for layer, shape in enumerate(shapes)]


def _read(path: Path) -> Mapping[str, Any]:
    """Tensors by name from a .safetensors file, of which only the convolutions are read, or one that torch saved."""
    try:
        if path.suffix == ".safetensors":
            with safetensors.safe_open(path, framework="pt") as file:
                return {name: file.get_tensor(name) for name in file.keys() if name.startswith("features.")}  # noqa: SIM118
        return dict(torch.load(path, map_location="cpu", weights_only=True))
    except Exception as error:  # a bad file must not take the other metrics with it
        raise _Unavailable(f"{path} can't be read as a state dict of tensors ({type(error).__name__})") from error


def _tensor(state: Mapping[str, Any], path: Path, name: str, shape: tuple[int, ...]) -> Tensor:
    tensor = state.get(name)
    if not isinstance(tensor, Tensor) or tuple(tensor.shape) != shape:
        raise _Unavailable(f"{path} holds other weights than LPIPS needs: it has no {name} of shape {shape}")
    return tensor.detach().float()


def _batch(truth: Picture, prediction: Picture) -> Tensor:
    """Both pictures (H, W, 3), the truth first, as one tensor [2, 3, H, W]."""
    return torch.from_numpy(np.stack([truth, prediction])).permute(0, 3, 1, 2).contiguous()


def _installed(package: str) -> Any:
    try:
        return importlib.import_module(package.replace("-", "_"))
    except ImportError:
        raise _not_installed(package) from None


def _not_installed(package: str) -> _Unavailable:
    return _Unavailable(f"the package {package} is not installed: {INSTALL}")
