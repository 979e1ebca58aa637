"""A small D-NeRF data set on disk, and its records to spoil."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from catalogs.exchange import import_nerf
from catalogs.store.catalog import Catalog

WIDTH, HEIGHT = 8, 6
ANGLE = math.radians(50.0)
BOUNDS = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
TRAIN = [(a, b) for a in (0.0, 1.0, 2.0, 3.0) for b in (10.0, 20.0, 30.0)]  # (1, 20) and (2, 20) lie inside
TEST = [(0.5, 15.0), (1.5, 25.0)]


def picture(seed: int, channels: int = 3) -> np.ndarray:
    """Noise, so that no two pictures are alike."""
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, channels), dtype=np.uint8)


def opengl_pose(azimuth: float, elevation: float = 20.0, distance: float = 4.0) -> np.ndarray:
    """Camera to world (4, 4) of a camera that looks at the origin, built from its axes by hand."""
    a, e = math.radians(azimuth), math.radians(elevation)
    back = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    right = np.array([-math.sin(a), math.cos(a), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    pose[:3, 3] = distance * back
    return pose


class DataSet:
    """Twelve training members by two views, two test members by two, and a test view of a training member."""

    def __init__(self, folder: Path, channels: int = 3) -> None:
        self.folder = folder
        self.channels = channels
        self.records: dict[str, dict[str, Any]] = {}
        self.count = 0
        train = [self.frame("train", params, azimuth) for params in TRAIN for azimuth in (0.0, 90.0)]
        test = [self.frame("test", params, azimuth) for params in TEST for azimuth in (45.0, 90.0)]
        test.append(self.frame("test", TRAIN[0], 135.0))
        self.records = {
            "train": {"camera_angle_x": ANGLE, "frames": train},
            "test": {"camera_angle_x": ANGLE, "frames": test},
        }
        self.save()

    def frame(self, split: str, params: tuple[float, ...], azimuth: float) -> dict[str, Any]:
        path = self.folder / split / f"r_{self.count}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(picture(self.count, self.channels)).save(path)
        self.count += 1
        return {
            "file_path": f"./{split}/{path.stem}",
            "transform_matrix": opengl_pose(azimuth).tolist(),
            "params": list(params),
        }

    def save(self) -> None:
        for split, record in self.records.items():
            (self.folder / f"transforms_{split}.json").write_text(json.dumps(record))


def bring(data: DataSet, tmp_path: Path, **options: Any) -> Catalog:
    return import_nerf(data.folder, tmp_path / "out.cdb", **{"bounds": BOUNDS, "names": ["a", "b"], **options})
