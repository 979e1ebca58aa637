"""COLMAP's text model of a member's views with initial points, as 3D Gaussian splatting's official code reads it.

    <member>/images/000.png
             sparse/0/cameras.txt, images.txt, points3D.txt
                      test.txt        names of images that are not for training, one per line

Sources: COLMAP, "Output Format" (text); Kerbl et al. 2023, official code, `scene/dataset_readers.py`.  Axes and pixels are those of
catalogs: x right, y down, z forward, and the centre of the first pixel at (0.5, 0.5).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from catalogs.exchange.selection import SelectedImage, Selection
from catalogs.store.members import Member
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera

SPREAD_POINTS = 4000  # in the box of a member without field summary
GRAY = 128


def check(selection: Selection) -> None:
    """Accept every selection."""


def place(picture: SelectedImage) -> str:
    """The path of an image."""
    return f"{picture.member.name}/images/{_name(picture)}"


def texts(selection: Selection) -> Iterator[tuple[str, str]]:
    """All files except the images."""
    for member in selection.members:
        pictures, folder = selection.of(member), f"{member.name}/sparse/0"
        lenses = list(dict.fromkeys(_lens(picture.camera) for picture in pictures))
        yield f"{folder}/cameras.txt", _lines(f"{i} {lens}" for i, lens in enumerate(lenses, 1))
        yield f"{folder}/images.txt", _lines(_posed(picture, lenses) for picture in pictures)
        yield f"{folder}/points3D.txt", _lines(_points(selection, member))
        yield f"{folder}/test.txt", _lines(_name(picture) for picture in pictures if picture.split != "train")


def _lines(lines: Iterator[str]) -> str:
    return "".join(f"{line}\n" for line in lines)


def _name(picture: SelectedImage) -> str:
    return f"{picture.view:03d}.png"


def _lens(camera: Camera) -> str:
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    return f"PINHOLE {camera.width} {camera.height} {' '.join(map(repr, numbers))}"


def _posed(picture: SelectedImage, lenses: list[str]) -> str:
    """Two lines: number, quaternion w x y z, translation, lens and name; and an empty list of matched points."""
    from scipy.spatial.transform import Rotation  # slow to load

    x, y, z, w = Rotation.from_matrix(picture.camera.rotation).as_quat().tolist()
    pose = (w, x, y, z, *picture.camera.world_to_camera[:3, 3].tolist())
    lens = lenses.index(_lens(picture.camera)) + 1
    return f"{picture.view + 1} {' '.join(map(repr, pose))} {lens} {_name(picture)}\n"


def _points(selection: Selection, member: Member) -> Iterator[str]:
    """Number, position, colour and error of each point, with an empty track."""
    for number, (point, color) in enumerate(zip(*colored_points(selection, member), strict=True), 1):
        yield f"{number} {' '.join(map(repr, point.tolist()))} {' '.join(map(str, color.tolist()))} 0"


def colored_points(selection: Selection, member: Member) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """World points (N, 3) and RGB (N, 3) from the field's summary, in the transfer function's colours, gray for isosurfaces.

    Without a summary, gray random points fill the box, the same for every member.
    """
    [appearance] = [a for a in selection.catalog.plan.appearances if a.name == selection.appearance]
    summary = member.summary(getattr(appearance, "field", ""))
    if summary is None or not len(summary.points):
        low, high = np.array(selection.catalog.plan.bounds)
        points = np.random.default_rng(0).uniform(low, high, (SPREAD_POINTS, 3))
        return points, np.full((SPREAD_POINTS, 3), GRAY, dtype=np.uint8)
    points = np.asarray(summary.points, dtype=np.float64)
    if not isinstance(appearance, VolumeRendering):
        return points, np.full(points.shape, GRAY, dtype=np.uint8)
    colors = appearance.transfer_function.colors(summary.point_values)  # [N, 3]
    return points, np.rint(255.0 * np.clip(colors, 0.0, 1.0)).astype(np.uint8)
