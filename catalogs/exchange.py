"""Images rendered by others, brought into a catalog: D-NeRF / Blender JSON with `params` per frame.

The format: `transforms_{train,val,test}.json` with `camera_angle_x` (full horizontal field of view, radians) and frames of
`file_path` (relative, without extension), `transform_matrix` (camera to world, OpenGL axes: x right, y up, z backward; Mildenhall
et al. 2020, Blender scenes) and `params` (one number per simulation parameter).

Which images are for what.  Frames with equal `params` are one member.  Members of the training file are training members, of which
some are set aside for validation; their frames in the test file are test views.  Members that only the test file has are
test members, with all their views.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import ImportedImages
from catalogs.cameras import Camera
from catalogs.catalog import Catalog, CatalogPlan
from catalogs.images import ImageError, read_image
from catalogs.parameters import SPLITS, Parameter, ParameterSpace

FILES = {"train": "transforms_train.json", "validation": "transforms_val.json", "test": "transforms_test.json"}
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
RIGID_TOLERANCE = 1e-2
APPEARANCE = "imported"

Progress = Callable[[int, int], None]


class ExchangeError(ValueError):
    """A foreign data set can't be imported; the message names the file, the frame and the remedy."""


@dataclass(frozen=True)
class Frame:
    """One image of a foreign data set."""

    path: Path
    camera: Camera
    parameters: tuple[float, ...]
    split: str


@dataclass(frozen=True)
class _Group:
    name: str
    parameters: tuple[float, ...]
    split: str
    frames: tuple[Frame, ...]


def import_nerf(
    directory: Path | str,
    catalog_path: Path | str,
    *,
    bounds: Sequence[Sequence[float]],
    background: Sequence[float] = (1.0, 1.0, 1.0),
    space: ParameterSpace | None = None,
    validation_members: int = 2,
    seed: int = 0,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress = lambda done, total: None,
) -> Catalog:
    """Import a D-NeRF / Blender data set; an interrupted import goes on, a finished one does nothing.

    Parameters
    ----------
    bounds : world box (low, high) that holds the volume: the files don't say.
    background : RGB in [0, 1] that opaque images stand on.
    space : names and bounds of `params`; by default p0, p1, ... over the range of the training frames.
    validation_members : how many training members to set aside, drawn by `seed` among those inside the range of every
        parameter where there are enough.

    Raises ExchangeError before anything is written where a file, frame, matrix or image is not as it should be, and
    CatalogError where `catalog_path` holds another import.
    """
    directory = Path(directory)
    frames = read_frames(directory)
    space = space or _space_of(frames)
    groups = _group(frames, space, validation_members, seed)
    low, high = (tuple(map(float, corner)) for corner in bounds)
    plan = CatalogPlan(
        space=space,
        appearances=(ImportedImages(APPEARANCE, f"images of {directory.name}"),),
        cameras=(),
        view_splits=(),
        bounds=(low, high),  # type: ignore[arg-type]
        background=tuple(map(float, background)),  # type: ignore[arg-type]
        provenance={
            "source": directory.name,
            "validation_members": validation_members,
            "seed": seed,
            **(provenance or {}),
        },
    )
    _check_images(frames)
    catalog = Catalog.create(catalog_path, plan)
    total, done = len(frames), 0
    for group in groups:
        if group.name not in catalog:
            _import_member(catalog, group)
        done += len(group.frames)
        progress(done, total)
    catalog.rebuild_table()
    return catalog


def read_frames(directory: Path) -> list[Frame]:
    """The frames of every transforms file in `directory`, in order."""
    present = {split: directory / name for split, name in FILES.items() if (directory / name).is_file()}
    if "train" not in present:
        raise ExchangeError(f"{directory} has no {FILES['train']}: is it a D-NeRF / Blender data set?")
    return [frame for split, path in present.items() for frame in _read_file(directory, path, split)]


def _read_file(directory: Path, path: Path, split: str) -> list[Frame]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        angle, rows = float(record["camera_angle_x"]), list(record["frames"])
    except (ValueError, KeyError, TypeError) as error:
        raise ExchangeError(f"{path} is no transforms file: {error!r}") from error
    if not 0.0 < angle < math.pi:
        raise ExchangeError(f"{path}: camera_angle_x must lie in (0, pi), got {angle}")
    sizes: dict[tuple[int, int], None] = {}
    frames = []
    for number, row in enumerate(rows):
        place = f"{path}, frame {number}"
        try:
            image = _image_path(directory, str(row["file_path"]), place)
            parameters = tuple(float(value) for value in row["params"])
            matrix = np.array(row["transform_matrix"], dtype=np.float64)
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, ExchangeError):
                raise
            raise ExchangeError(f"{place} is malformed: {error!r}") from error
        if not parameters or not all(map(math.isfinite, parameters)):
            raise ExchangeError(f"{place}: params must be finite numbers, got {row['params']}")
        if not sizes:
            sizes[_size(image)] = None
        width, height = next(iter(sizes))
        focal = width / (2.0 * math.tan(angle / 2.0))
        pose = _world_to_camera(matrix, place)
        camera = Camera(pose, focal, focal, width / 2.0, height / 2.0, width, height)
        frames.append(Frame(image, camera, parameters, split))
    counts = {len(f.parameters) for f in frames}
    if len(counts) > 1:
        raise ExchangeError(f"{path}: frames have different numbers of params: {sorted(counts)}")
    return frames


def _image_path(directory: Path, text: str, place: str) -> Path:
    relative = PurePosixPath(text)
    if relative.is_absolute() or ".." in relative.parts or "\x00" in text:
        raise ExchangeError(f"{place}: file_path {text!r} leaves the data set")
    path = directory / relative
    path = path if path.suffix.lower() == ".png" else path.with_name(path.name + ".png")
    if not path.is_file():
        raise ExchangeError(f"{place}: {path} is missing")
    if not path.resolve().is_relative_to(directory.resolve()):
        raise ExchangeError(f"{place}: {path} is a link that leaves the data set")
    return path


def _world_to_camera(matrix: NDArray[np.float64], place: str) -> NDArray[np.float64]:
    """World to camera in OpenCV axes (4, 4) of a camera-to-world matrix in OpenGL axes, its rotation made exact by SVD."""
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ExchangeError(f"{place}: transform_matrix must be a finite 4x4 matrix")
    left, stretch, right = np.linalg.svd(matrix[:3, :3])
    rotation = left @ right
    if np.abs(stretch - 1.0).max() > RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
        raise ExchangeError(f"{place}: transform_matrix is not rigid (axes of length {np.round(stretch, 4).tolist()})")
    exact = np.eye(4)
    exact[:3, :3], exact[:3, 3] = rotation, matrix[:3, 3]
    return np.asarray(np.linalg.inv(exact @ OPENGL_TO_OPENCV), dtype=np.float64)


def _size(path: Path) -> tuple[int, int]:
    try:
        image = read_image(path)
    except ImageError as error:
        raise ExchangeError(str(error)) from error
    return image.shape[1], image.shape[0]


def named_space(directory: Path, names: Sequence[str]) -> ParameterSpace:
    """The space over the range of the training frames' `params`, with these names."""
    space = _space_of(read_frames(directory))
    if len(names) != len(space):
        raise ExchangeError(f"frames have {len(space)} params, {len(names)} names were given: {list(names)}")
    return ParameterSpace(
        tuple(Parameter(name.strip(), p.low, p.high) for name, p in zip(names, space.parameters, strict=True))
    )


def _space_of(frames: Sequence[Frame]) -> ParameterSpace:
    values = np.array([f.parameters for f in frames if f.split == "train"])  # [F, P]
    low, high = values.min(axis=0), values.max(axis=0)
    high = np.where(high > low, high, low + 1.0)
    return ParameterSpace(tuple(Parameter(f"p{i}", *pair) for i, pair in enumerate(zip(low, high, strict=True))))


def _group(frames: Sequence[Frame], space: ParameterSpace, validation_members: int, seed: int) -> list[_Group]:
    if len(frames[0].parameters) != len(space):
        raise ExchangeError(f"frames have {len(frames[0].parameters)} params, the space {len(space)}: {space.names}")
    found: dict[tuple[float, ...], list[Frame]] = {}
    for frame in frames:
        found.setdefault(frame.parameters, []).append(frame)
    splits = {p: min((f.split for f in group), key=SPLITS.index) for p, group in found.items()}
    for parameters in _set_aside([p for p, s in splits.items() if s == "train"], space, validation_members, seed):
        splits[parameters] = "validation"
    counters = dict.fromkeys(SPLITS, 0)
    groups = []
    for parameters, group in found.items():
        split = splits[parameters]
        groups.append(_Group(f"{split}-{counters[split]:03d}", parameters, split, tuple(group)))
        counters[split] += 1
    return groups


def _set_aside(
    members: Sequence[tuple[float, ...]], space: ParameterSpace, count: int, seed: int
) -> list[tuple[float, ...]]:
    if count >= len(members):
        raise ExchangeError(f"{count} validation members leave no training member: there are {len(members)}")
    values = np.array(members)  # [M, P]
    inside = ((values > values.min(axis=0)) & (values < values.max(axis=0))).all(axis=1)
    pool = [m for m, i in zip(members, inside, strict=True) if i]
    pool = pool if len(pool) >= count else list(members)
    drawn = np.random.default_rng(seed).choice(len(pool), size=count, replace=False)
    return [pool[i] for i in sorted(drawn)]


def _check_images(frames: Sequence[Frame]) -> None:
    """Decode every image once, so that nothing is written for a data set with a damaged one."""

    def check(frame: Frame) -> None:
        size = _size(frame.path)
        if size != (frame.camera.width, frame.camera.height):
            raise ExchangeError(
                f"{frame.path} is {size[0]}x{size[1]}, the first one {frame.camera.width}x{frame.camera.height}"
            )

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(check, frames))


def _import_member(catalog: Catalog, group: _Group) -> None:
    views = [f.split if group.split != "test" else "test" for f in group.frames]
    digest = hashlib.sha256("".join(str(f.path.name) for f in group.frames).encode()).hexdigest()[:16]
    with catalog.begin_member(
        group.name,
        dict(zip(catalog.plan.space.names, group.parameters, strict=True)),
        split=group.split,
        cameras=[f.camera for f in group.frames],
        view_splits=views,
        provenance={"frames": [f.path.name for f in group.frames], "digest": digest},
    ) as writer:
        for view, frame in enumerate(group.frames):
            writer.write_image(APPEARANCE, view, read_image(frame.path))
