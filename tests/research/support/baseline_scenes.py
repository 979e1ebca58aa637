"""Soft coloured balls that parameters move, drawn exactly: tiny pictures for the compared methods to learn."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.cameras import Camera, icosphere
from research.studies.baselines.method import TrainingImages

CENTERS = np.array([[0.45, 0.0, 0.15], [-0.3, 0.4, -0.2], [-0.2, -0.4, 0.1]])
COLORS = np.array([[0.9, 0.2, 0.1], [0.15, 0.7, 0.25], [0.2, 0.3, 0.9]])
RADIUS = 0.35  # at which a ball has faded to exp(-1) of its middle
OPACITY = 0.95  # through a ball's middle
REACH = 0.35  # a parameter moves its ball so far to both sides
BOX = [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]


def centers_at(parameters: ArrayLike) -> NDArray[np.float64]:
    """Places of the balls (3, 3) at `parameters` (P,): parameter j moves ball j modulo 3, up and down first."""
    centers = CENTERS.copy()
    for number, value in enumerate(np.asarray(parameters, dtype=np.float64)):
        centers[number % 3, (2 - number // 3) % 3] += REACH * value
    return centers


def drawn(parameters: ArrayLike, camera: Camera) -> NDArray[np.float32]:
    """The true picture, premultiplied RGBA (H, W, 4): a ball's opacity falls with the ray's distance from its centre."""
    origin, directions = camera.rays()
    picture = np.zeros((camera.height, camera.width, 4))
    centers = centers_at(parameters)
    for ball in np.argsort(-np.linalg.norm(centers - origin, axis=1)):  # from back to front
        towards = centers[ball] - origin  # [3]
        closest = np.linalg.norm(np.cross(directions, towards), axis=-1)  # [H, W]
        opacity = OPACITY * np.exp(-((closest / RADIUS) ** 4))[..., None]  # [H, W, 1]
        picture = picture * (1.0 - opacity) + opacity * np.append(COLORS[ball], 1.0)
    return picture.astype(np.float32)


def cameras_around(views: int, size: int) -> list[Camera]:
    """Cameras, `views` of them, spread around the origin, that see the whole box."""
    order = np.linspace(0, 41, views).round().astype(int)
    return [
        Camera.look_at(4.5 * place, (0.0, 0.0, 0.0), vertical_fov_degrees=38.0, width=size, height=size)
        for place in icosphere(2)[order]
    ]


def ball_pictures(
    parameters: ArrayLike, views: int = 4, size: int = 16, background: tuple[float, float, float] | None = None
) -> TrainingImages:
    """Pictures of K members with `parameters` (K, P) from each of `views` cameras; opaque ones with a `background`.

    Points are a coarse sample of the balls of the first member.
    """
    members = np.atleast_2d(np.asarray(parameters, dtype=np.float32))  # [K, P]
    cameras = cameras_around(views, size)
    pictures = np.stack([drawn(member, camera) for member in members for camera in cameras])  # [K V, H, W, 4]
    if background is not None:
        pictures[..., :3] += (1.0 - pictures[..., 3:]) * np.array(background, dtype=np.float32)
        pictures[..., 3] = 1.0
    random = np.random.default_rng(0)
    points = centers_at(members[0])[:, None] + 0.6 * RADIUS * random.normal(size=(3, 100, 3))  # [3, 100, 3]
    return TrainingImages(
        pixels=(pictures * 255.0 + 0.5).astype(np.uint8),
        cameras=cameras,
        views=torch.arange(views).repeat(len(members)),
        parameters=torch.from_numpy(np.repeat(members, views, axis=0)),
        box=torch.tensor(BOX),
        background=background,
        points=torch.from_numpy(points.reshape(-1, 3)).to(torch.float32),
        point_colors=torch.from_numpy(np.repeat(COLORS, 100, axis=0)).to(torch.float32),
    )


def psnr_over(pictures: TrainingImages, number: int, found: NDArray[np.float32]) -> float:
    """PSNR in dB of a premultiplied picture (H, W, 4) beside one of `pictures`, both over what pictures are judged on."""
    shown = np.clip(found[..., :3] + (1.0 - found[..., 3:]) * np.array(pictures.behind), 0.0, 1.0)
    return float(-10.0 * np.log10(np.mean((shown - pictures.over([number])[0].numpy()) ** 2)))


def psnr_of_mean(pictures: TrainingImages) -> float:
    """PSNR in dB of the mean image beside all pictures."""
    true = pictures.over(range(len(pictures))).numpy()  # [M, H, W, 3]
    return float(-10.0 * np.log10(np.mean((true - true.mean(axis=0)) ** 2)))
