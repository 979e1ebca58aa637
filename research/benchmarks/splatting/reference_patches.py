"""Patches of an image by the float64 reference implementation, and errors of another rendering against them.

The reference compares every pixel with every Gaussian. Here it renders patch by patch, each time only the Gaussians
whose ellipse can reach the patch. That changes nothing and makes thousands of pixels affordable.

Where a contribution lies within 1e-5 (relative) of the alpha floor, float32 may leave it out and float64 not. Such
pixels are `undecided`: they are counted and not compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from research.benchmarks.splatting.workloads import View
from surrogate.splatting import Constants, Primitives, Rendering, reference
from surrogate.splatting.reference import Splats

PATCH = 8  # pixels, across and down
BLOCK = 4  # the AVX-512 kernel takes blocks of 4 x 4 pixels
DOUBTFUL = 1e-5  # relative distance to the alpha floor
SAME = 2e-6  # change of a pixel's value that does not count


class InteractionCounts(NamedTuple):
    """Work in the patches: pixels, covered pixels, (pixel, Gaussian) pairs, and blocks of pixels that a Gaussian draws in."""

    pixels: int
    covered: int
    interactions: int
    blocks: int

    @property
    def depth(self) -> float:
        """Gaussians drawn per covered pixel."""
        return self.interactions / max(self.covered, 1)

    @property
    def lanes_used(self) -> float:
        """Fraction of the pixels in those blocks that is drawn in."""
        return self.interactions / max(self.blocks * BLOCK**2, 1)


@dataclass(frozen=True, eq=False)
class ReferenceDrawing:
    """The reference image in some patches.

    Attributes
    ----------
    pixels : (P,) indices of the flattened frame.
    picture : (P, 4) float64, premultiplied colour and alpha.
    undecided : (P,) bool.
    weights : (P, 4) of a random linear functional of the image, zero at undecided pixels.
    gradients : gradients of that functional by means, scales, quats, opacities, colors; empty unless requested.
    """

    pixels: Tensor
    picture: Tensor
    undecided: Tensor
    weights: Tensor
    gradients: tuple[Tensor, ...]
    counted: InteractionCounts


class Errors(NamedTuple):
    """Of a picture with values in [0, 1]: PSNR in dB over colours and alpha, not capped, and the largest difference."""

    decibels: float
    largest: float


def patches(width: int, height: int, count: int | None = None) -> list[NDArray[np.int64]]:
    """Indices (P,) of the flattened frame's pixels, patch by patch: all patches, or `count` drawn by a fixed seed.

    P is at most `PATCH`²; each patch is listed row by row.
    """
    corners = [(left, top) for top in range(0, height, PATCH) for left in range(0, width, PATCH)]
    if count is not None and count < len(corners):
        drawn = np.random.default_rng(1).choice(len(corners), count, replace=False)
        corners = [corners[k] for k in np.sort(drawn)]
    patch_indices = []
    for left, top in corners:
        columns = np.arange(left, min(left + PATCH, width))
        rows = np.arange(top, min(top + PATCH, height))
        patch_indices.append((rows[:, None] * width + columns).ravel())
    return patch_indices


def draw_patches(view: View, count: int | None = None, *, gradients: bool = True) -> ReferenceDrawing:
    """Draw all patches of pixels in float64, or `count` of them."""
    scene, camera, constants = view
    wanted = patches(camera.width, camera.height, count)
    leaves = Primitives(*(tensor.double().requires_grad_(gradients) for tensor in scene))
    splats = reference.project(leaves, camera, constants)
    # Pixels see a detached copy of the splats, so that the projection is differentiated once and not for every patch.
    seen = [tensor.detach().requires_grad_(gradients) for tensor in splats[:4]]
    centers = reference.pixel_centers(camera).double()  # [H * W, 2]
    lowest, highest = _corners(splats, constants.alpha_floor)
    random = np.random.default_rng(2)
    pictures, weights, doubts, counts = [], [], [], np.zeros(4, dtype=np.int64)
    for indices in wanted:
        pixels = centers[torch.from_numpy(indices)]  # [P, 2]
        near = ((highest >= pixels.amin(0)) & (lowest <= pixels.amax(0))).all(1).nonzero()[:, 0]  # [M]
        some = Splats(*(tensor[near] for tensor in seen), constants.dilation)
        alphas = reference.alphas_at(pixels, some, constants)  # [P, M]
        picture = reference.composite(alphas, some.colors)  # [P, 4]
        with torch.no_grad():
            doubt = _undecided(pixels, some, constants)  # [P]
            counts += _count(alphas.detach() > 0, indices, camera.width)
        weight = torch.from_numpy(random.normal(size=(len(indices), 4))) * ~doubt[:, None]  # [P, 4]
        if gradients:
            (picture * weight).sum().backward()
        pictures.append(picture.detach())
        weights.append(weight)
        doubts.append(doubt)
    gradients_of_scene: tuple[Tensor, ...] = ()
    if gradients:
        by_splats = [tensor.grad if tensor.grad is not None else torch.zeros_like(tensor) for tensor in seen]
        gradients_of_scene = torch.autograd.grad(splats[:4], leaves, by_splats)
    flat = torch.from_numpy(np.concatenate(wanted))
    return ReferenceDrawing(
        flat,
        torch.cat(pictures),
        torch.cat(doubts),
        torch.cat(weights),
        gradients_of_scene,
        InteractionCounts(*map(int, counts)),
    )


def picture_at(rendering: Rendering, pixels: Tensor) -> Tensor:
    """Premultiplied colour and alpha (P, 4) of a drawing at `pixels` (P,)."""
    return torch.cat([rendering.color, rendering.alpha.unsqueeze(-1)], dim=2).flatten(0, 1)[pixels]


def image_errors(picture: Tensor, exact: ReferenceDrawing) -> Errors:
    """Errors of `picture` (P, 4) against the reference, at decided pixels."""
    difference = (picture.detach().double() - exact.picture)[~exact.undecided]  # [P, 4]
    return Errors(decibels(float(difference.square().mean())), float(difference.abs().max()))


def decibels(squared_error: float) -> float:
    """PSNR of values in [0, 1]; inf where nothing differs."""
    return -10.0 * math.log10(squared_error) if squared_error > 0 else math.inf


def gradient_error(gradients: Sequence[Tensor], exact: ReferenceDrawing) -> float:
    """The largest error of any gradient, relative to the largest gradient of its kind."""
    pairs = zip(gradients, exact.gradients, strict=True)
    return max(float((got.double() - wanted).abs().max() / wanted.abs().max()) for got, wanted in pairs)


def _corners(splats: Splats, floor: float) -> tuple[Tensor, Tensor]:
    """The lowest and the highest place (M, 2) that each splat can reach, px."""
    with torch.no_grad():
        variances = splats.axes.square().sum(2) + splats.dilation  # [M, 2], of the ellipse's shadow on either axis
        squared = 2.0 * torch.log(splats.opacities / floor).clamp(min=0.0)  # [M]
        half = (squared[:, None] * variances).sqrt() + 0.01  # [M, 2]
        return splats.centers - half, splats.centers + half


def _undecided(pixels: Tensor, splats: Splats, constants: Constants) -> Tensor:
    """Pixels (P,) that change when the floor moves a little."""
    floors = (constants.alpha_floor * (1.0 - DOUBTFUL), constants.alpha_floor * (1.0 + DOUBTFUL))
    low, high = (
        reference.composite(reference.alphas_at(pixels, splats, replace(constants, alpha_floor=floor)), splats.colors)
        for floor in floors
    )
    return ((low - high).abs() > SAME).any(1)


def _count(drawn: Tensor, indices: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """`InteractionCounts` of one patch, where `drawn` (P, M) says which Gaussian draws in which pixel."""
    rows, columns = np.divmod(indices, width)
    block = torch.from_numpy(rows // BLOCK * width + columns // BLOCK)  # [P]
    _, position = block.unique(return_inverse=True)
    touched = torch.zeros(int(position.max()) + 1, drawn.shape[1], dtype=torch.int32)
    touched.index_add_(0, position, drawn.int())
    return np.array([len(indices), int(drawn.any(1).sum()), int(drawn.sum()), int((touched > 0).sum())])
