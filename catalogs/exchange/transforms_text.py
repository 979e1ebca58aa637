"""Contents of D-NeRF / Blender transforms files; `catalogs.exchange.transforms` reads them.

An image's split in the catalog's table decides its file.  So an import restores the splits of members and views; only validation
views of test members become test views.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from catalogs.exchange.records import ExchangeError
from catalogs.exchange.selection import SelectedImage, Selection
from catalogs.exchange.transforms import FILES, OPENGL_TO_OPENCV
from catalogs.vocabulary.cameras import Camera

FOLDERS = {"train": "train", "validation": "val", "test": "test"}
PIXELS = 1e-6  # of a lens that counts as centred and square


def check(selection: Selection) -> None:
    """Raise ExchangeError for cameras beyond a single `camera_angle_x`, and for a selection without training images."""
    first = selection.members[0].cameras[0]
    for picture in selection.pictures():
        camera = picture.camera
        lens = np.array([camera.fx, camera.fy, 2.0 * camera.cx, 2.0 * camera.cy, camera.width, camera.height])
        wanted = [first.fx, first.fx, first.width, first.height, first.width, first.height]
        if np.abs(lens - wanted).max() > PIXELS:
            raise ExchangeError(
                f"view {picture.view} of member {picture.member.name} has another lens than the first, or one that is not "
                "square and centred: a transforms file holds one angle for all; export to colmap"
            )
    if not any(picture.split == "train" for picture in selection.pictures()):
        raise ExchangeError("these members have no training images: name at least one training member")


def place(picture: SelectedImage) -> str:
    """The path of an image."""
    return f"{FOLDERS[picture.split]}/{picture.member.name}_{picture.view:03d}.png"


def texts(selection: Selection) -> Iterator[tuple[str, str]]:
    """The transforms files that have frames."""
    first = selection.members[0].cameras[0]
    frames: dict[str, list[dict[str, object]]] = {split: [] for split in FILES}
    for picture in selection.pictures():
        frames[picture.split].append(
            {
                "file_path": f"./{place(picture).removesuffix('.png')}",
                "transform_matrix": camera_to_world(picture.camera).tolist(),
                "params": list(picture.member.parameters.values()),
            }
        )
    header = {
        "camera_angle_x": 2.0 * math.atan(first.width / (2.0 * first.fx)),
        "parameter_names": list(selection.catalog.plan.space.names),
        "bounds": selection.catalog.plan.bounds,
    }
    for split, name in FILES.items():
        if frames[split]:
            yield name, json.dumps({**header, "frames": frames[split]}, indent=1)


def camera_to_world(camera: Camera) -> NDArray[np.float64]:
    """(4, 4) in OpenGL axes: x right, y up, z backward."""
    pose = np.eye(4)
    pose[:3, :3] = camera.rotation.T
    pose[:3, 3] = camera.position
    return pose @ OPENGL_TO_OPENCV
