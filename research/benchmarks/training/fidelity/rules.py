"""The same fitted Gaussians rendered by other rules in float64: the effect of each approximation of splatting.

The ray of a pixel, x(t) = origin + t direction, meets a Gaussian whose whitening matrix is A (A^T A is the inverse covariance).
With u = A (origin - mean) and v = A direction, the density along the ray is a Gaussian in t. It is centred at t* = -u.v
/ v.v and has standard deviation 1 / |v|; its largest value is exp(-|u x v|^2 / (2 |v|^2)).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import ndtr

from catalogs.vocabulary.cameras import Camera
from research.benchmarks.training.fidelity.fitting import MemberImages
from surrogate.evaluation.metrics import decibels
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer, primitives
from surrogate.settings import TrainingSettings
from surrogate.splatting import Constants, reference
from surrogate.training.data import Example

Array = NDArray[np.float64]
CELLS = 256  # of a ray for the integral
SMALLEST = 1e-6  # alphas below it don't count where there is no floor
NO_CAP = 1.0 - 1e-9
VIEWS = 4
PIXELS = 192  # of each view, in its foreground


def study(subject: MemberImages, gaussians: Gaussians, settings: TrainingSettings) -> dict[str, Any]:
    """Mean differences over some validation views, in dB, and the model's own error at the same pixels."""
    results = []
    for example in _spread(subject.examples["validation"], VIEWS):
        pixels = _shown(example, subject.background)
        drawn = pictures(gaussians, example.camera, Rasterizer.of(settings), pixels)
        truth = example.pixels[pixels[:, 1], pixels[:, 0]] / 255.0  # [P, 3 or 4]
        channels = truth.shape[1]
        error = decibels(float(np.mean((drawn["drawn"][:, :channels] - truth) ** 2)))
        results.append({"error": error, **differences(drawn)})
    return {name: float(np.mean([one[name] for one in results])) for name in results[0]}


class RayCrossings(NamedTuple):
    """M Gaussians (front to back by centres) along the rays of P pixels."""

    alphas: Array  # [P, M], exact along the ray: opacity times the largest density
    places: Array  # [P, M], t*
    widths: Array  # [P, M], standard deviation in t


def pictures(
    gaussians: Gaussians, camera: Camera, rasterizer: Rasterizer, pixels: NDArray[np.int64]
) -> dict[str, Array]:
    """Premultiplied RGBA (P, 4) of `pixels` (P, 2; column and row) by rule; "drawn" is the surrogate's own."""
    ordered = _front_to_back(gaussians, camera, rasterizer)
    colors = ordered.colors_from(torch.from_numpy(camera.position)).numpy()  # [M, 3]
    drawn = rasterizer.constants
    by_rule = {
        "drawn": _over(_splatted(ordered, camera, pixels, drawn), colors),
        "no alpha floor": _over(_splatted(ordered, camera, pixels, replace(drawn, alpha_floor=SMALLEST)), colors),
        "no alpha cap": _over(_splatted(ordered, camera, pixels, replace(drawn, alpha_cap=NO_CAP)), colors),
        "no dilation": _over(_splatted(ordered, camera, pixels, replace(drawn, dilation=0.0)), colors),
    }
    plain = _splatted(ordered, camera, pixels, replace(drawn, alpha_floor=SMALLEST, dilation=0.0))  # [P, M]
    rays = along_rays(ordered, camera, pixels)
    exact = np.where(rays.alphas >= SMALLEST, np.minimum(rays.alphas, drawn.alpha_cap), 0.0)  # [P, M]
    by_rule["no floor, no dilation"] = _over(plain, colors)
    by_rule["sorted along each ray"] = _over_by(rays.places, plain, colors)
    by_rule["exact projection"] = _over(exact, colors)
    by_rule["exact projection, sorted along each ray"] = _over_by(rays.places, exact, colors)
    by_rule["exact projection, overlaps integrated"] = integrated(rays._replace(alphas=exact), colors)
    return by_rule


def differences(by_rule: Mapping[str, Array]) -> dict[str, float]:
    """Difference, in dB of PSNR over colours and alpha, of each rule from the one that it departs from."""
    departures = {
        "no alpha floor": "drawn",
        "no alpha cap": "drawn",
        "no dilation": "drawn",
        "sorted along each ray": "no floor, no dilation",
        "exact projection": "no floor, no dilation",
        "exact projection, overlaps integrated": "exact projection, sorted along each ray",
    }
    return {rule: decibels(float(np.mean((by_rule[rule] - by_rule[base]) ** 2))) for rule, base in departures.items()}


def along_rays(gaussians: Gaussians, camera: Camera, pixels: NDArray[np.int64]) -> RayCrossings:
    """Position and density of each Gaussian along each ray."""
    directions = np.stack(
        [
            (pixels[:, 0] + 0.5 - camera.cx) / camera.fx,
            (pixels[:, 1] + 0.5 - camera.cy) / camera.fy,
            np.ones(len(pixels)),
        ],
        axis=1,
    )  # [P, 3], t is the depth along the camera's axis
    directions = directions @ camera.rotation  # [P, 3], to world axes
    rotations = reference.rotations(gaussians.quats).numpy()  # [M, 3, 3]
    whitening = rotations.transpose(0, 2, 1) / gaussians.scales().numpy()[:, :, None]  # [M, 3, 3]
    u = np.einsum("mij,mj->mi", whitening, camera.position - gaussians.means.numpy())  # [M, 3]
    v = np.einsum("mij,pj->pmi", whitening, directions)  # [P, M, 3]
    lengths = np.einsum("pmi,pmi->pm", v, v)  # [P, M]
    distances = np.square(np.cross(u[None], v)).sum(axis=2) / lengths  # [P, M]
    places = -np.einsum("mi,pmi->pm", u, v) / lengths  # [P, M]
    return RayCrossings(gaussians.opacities().numpy() * np.exp(-0.5 * distances), places, 1.0 / np.sqrt(lengths))


def integrated(rays: RayCrossings, colors: Array) -> Array:
    """Premultiplied RGBA (P, 4) of the Gaussians as one medium: emission and absorption along each ray.

    A Gaussian's optical depth -ln(1 - alpha) is spread along the ray by its own profile; where several overlap, light
    passes through all of them at once.
    """
    return np.array([_integral(*(part[i] for part in rays), colors) for i in range(len(rays.alphas))])


def _integral(alphas: Array, places: Array, widths: Array, colors: Array) -> Array:
    met = np.flatnonzero(alphas)  # [K]
    if not len(met):
        return np.zeros(4)
    depths, places, widths = -np.log1p(-alphas[met]), places[met], widths[met]
    ends = np.linspace((places - 5.0 * widths).min(), (places + 5.0 * widths).max(), CELLS + 1)
    passed = depths[:, None] * ndtr((ends - places[:, None]) / widths[:, None])  # [K, CELLS + 1]
    passed[:, 0], passed[:, -1] = 0.0, depths
    within = np.diff(passed, axis=1)  # [K, CELLS]
    total = within.sum(axis=0)  # [CELLS]
    before = np.exp(-passed[:, :-1].sum(axis=0))  # [CELLS], light that reaches each cell
    shares = within / np.where(total > 0.0, total, 1.0)  # [K, CELLS]
    weights = shares @ (before * -np.expm1(-total))  # [K]
    return np.append(weights @ colors[met], weights.sum())


def _spread(examples: Any, count: int) -> list[Example]:
    return [examples[i] for i in np.linspace(0, len(examples) - 1, count).astype(int)]


def _shown(example: Example, background: tuple[float, float, float] | None) -> NDArray[np.int64]:
    """(P, 2) columns and rows of pixels that show something, drawn by a fixed seed."""
    pixels = example.pixels / 255.0
    shown = pixels[..., 3] > 0 if background is None else np.abs(pixels - np.array(background)).max(axis=2) > 0.01
    rows, columns = np.nonzero(shown)
    drawn = np.random.default_rng(0).choice(len(rows), min(PIXELS, len(rows)), replace=False)
    return np.stack([columns[drawn], rows[drawn]], axis=1)


def _front_to_back(gaussians: Gaussians, camera: Camera, rasterizer: Rasterizer) -> Gaussians:
    exact = Gaussians(**{name: tensor.double() for name, tensor in gaussians.tensors().items()})
    depths = exact.means.numpy() @ camera.forward + camera.world_to_camera[2, 3]  # [N]
    order = np.argsort(depths.astype(np.float32), kind="stable")
    visible = order[depths[order] > rasterizer.constants.near]
    return Gaussians(**{name: tensor[torch.from_numpy(visible)] for name, tensor in exact.tensors().items()})


def _splatted(gaussians: Gaussians, camera: Camera, pixels: NDArray[np.int64], constants: Constants) -> Array:
    everything = replace(constants, near=-np.inf, alpha_floor=-1.0)
    splats = reference.project(primitives(gaussians, camera), camera, everything)
    return reference.alphas_at(torch.from_numpy(pixels + 0.5), splats, constants).numpy()  # [P, M]


def _over(alphas: Array, colors: Array) -> Array:
    through = np.cumprod(1.0 - alphas, axis=1)
    weights = alphas * np.concatenate([np.ones((len(alphas), 1)), through[:, :-1]], axis=1)  # [P, M]
    return np.concatenate([weights @ colors, weights.sum(axis=1, keepdims=True)], axis=1)


def _over_by(places: Array, alphas: Array, colors: Array) -> Array:
    """As `_over`, with an order per ray."""
    colors_of_pixels: Sequence[Array] = [
        _over(row[order][None], colors[order])[0] for row, order in zip(alphas, np.argsort(places, axis=1), strict=True)
    ]
    return np.array(colors_of_pixels)
