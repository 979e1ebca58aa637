"""Import of D-NeRF / Blender data sets with `params` or `time`; `catalogs.exchange.transforms` reads the files.

Frames with equal `params` and `time` (to nine digits) become one member with its own cameras.

- Members in the training file are training members; `validation_members` of them are set aside for validation.
- Members only in the validation or the test file are for validation or test.
- Views in the training file are training views.  Views in the other files belong to their split, unless a training frame of any
  member has the same camera (to half a pixel): then they are training views, too.

A row of the table is for training only if both its member and its view are, as in rendered catalogs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.exchange.records import ExchangeError
from catalogs.exchange.transforms import FILES, Frame, read_frames
from catalogs.files.images import read_image
from catalogs.store.catalog import Catalog, CatalogPlan, Member, MemberWriter
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import SPLITS, Parameter, ParameterSpace
from catalogs.vocabulary.words import joined_names

APPEARANCE = "imported"
WRITERS = 4
SAME_VIEW_PIXELS = 0.5
SAME_PARAMETER_DIGITS = 9

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class ImportedMember:
    """A member to import: its frames in the files' order, and the split of each as a view."""

    name: str
    parameters: tuple[float, ...]
    split: str
    frames: tuple[Frame, ...] = field(repr=False)
    view_splits: tuple[str, ...] = field(repr=False)

    @property
    def pictures(self) -> list[str]:
        """Folder and name of each frame's file."""
        return [f"{frame.path.parent.name}/{frame.path.name}" for frame in self.frames]


def import_nerf(
    directory: Path | str,
    catalog_path: Path | str,
    *,
    bounds: Sequence[Sequence[float]],
    background: Sequence[float] | None = (1.0, 1.0, 1.0),
    space: ParameterSpace | None = None,
    names: Sequence[str] | None = None,
    validation_members: int = 2,
    seed: int = 0,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress = lambda done, total: None,
) -> Catalog:
    """Import a D-NeRF / Blender data set; an interrupted import is resumed, a finished one does nothing.

    Parameters
    ----------
    directory : with `transforms_train.json`, optionally `transforms_val.json` and `transforms_test.json`, and 8-bit RGB(A) PNGs.
    catalog_path : the `.cdb` folder to write.
    bounds : world box (low, high) of the volume, which the files lack.
    background : RGB in [0, 1] behind the opaque images; None to keep the alpha of RGBA images.
    space : names and bounds of `params`; by default `names` (or the file's, or p0, p1, ...) and the range of the training frames.
    validation_members : number in all.  Those that the validation file lacks are drawn by `seed` from the training members,
        first those at the end of the fewest parameters.
    progress : called with images done and in all.

    Raises ExchangeError, before anything is written, for an invalid file, frame, matrix or image; CatalogError where
    `catalog_path` holds another import.
    """
    directory = Path(directory)
    frames = read_frames(directory)
    _check_alpha(frames, background)
    space = _space(frames, space, names)
    members = plan_members(frames, space, validation_members, seed)
    files = [directory / file for file in FILES.values() if (directory / file).is_file()]
    provenance = {
        "source": directory.resolve().name,
        "sha256": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
        "validation_members": validation_members,
        "seed": seed,
        **(provenance or {}),
    }
    plan = CatalogPlan(
        space=space,
        appearances=(ImportedImages(APPEARANCE, f"pictures of {provenance['source']}"),),
        cameras=(),
        view_splits=(),
        bounds=bounds,  # type: ignore[arg-type]
        background=background,  # type: ignore[arg-type]
        provenance=provenance,
    )
    catalog = Catalog.create(catalog_path, plan)
    _write_members(catalog, members, progress)
    return catalog


def _write_members(catalog: Catalog, members: Sequence[ImportedMember], progress: Progress) -> None:
    """Store the members that the catalog lacks; raises ExchangeError where it has one of other frames."""
    names, done, total = catalog.plan.space.names, 0, sum(len(member.frames) for member in members)
    for member in members:
        if member.name in catalog:
            _check_same(catalog.member(member.name), member, names)
            done += len(member.frames)
            progress(done, total)
            continue
        with (
            catalog.begin_member(
                member.name,
                dict(zip(names, member.parameters, strict=True)),
                split=member.split,
                cameras=[frame.camera for frame in member.frames],
                view_splits=member.view_splits,
                provenance={"pictures": member.pictures},
            ) as writer,
            ThreadPoolExecutor(WRITERS) as pool,
        ):
            for _ in pool.map(partial(_write, writer), range(len(member.frames)), member.frames):
                done += 1
                progress(done, total)
    catalog.rebuild_table()


def _write(writer: MemberWriter, view: int, frame: Frame) -> None:
    writer.write_image(APPEARANCE, view, read_image(frame.path))


def plan_members(
    frames: Sequence[Frame], space: ParameterSpace, validation_members: int, seed: int
) -> list[ImportedMember]:
    """Members by the module's rules, sorted by split and parameters, with names such as "train-007"."""
    groups: dict[tuple[float, ...], list[Frame]] = {}
    for frame in frames:  # two files may print the same number with other last digits
        key = tuple(float(f"{value:.{SAME_PARAMETER_DIGITS}g}") + 0.0 for value in frame.parameters)
        groups.setdefault(key, []).append(frame)
    splits = {key: min((f.file_split for f in group), key=SPLITS.index) for key, group in groups.items()}
    lacking = max(0, validation_members - sum(split == "validation" for split in splits.values()))
    for key in _set_aside([key for key, split in splits.items() if split == "train"], space, lacking, seed):
        splits[key] = "validation"
    poses = np.unique([f.camera.world_to_camera for f in frames if f.file_split == "train"], axis=0)  # [T, 4, 4]
    members = []
    for split in SPLITS:
        keys = sorted(key for key in groups if splits[key] == split)
        for number, key in enumerate(keys):
            group = tuple(groups[key])
            views = tuple("train" if _is_seen(f.camera, poses) else f.file_split for f in group)
            members.append(ImportedMember(f"{split}-{number:03d}", group[0].parameters, split, group, views))
    return members


def _set_aside(
    members: Sequence[tuple[float, ...]], space: ParameterSpace, count: int, seed: int
) -> list[tuple[float, ...]]:
    """`count` of the members, drawn by `seed`, first those at the end of the fewest parameters."""
    if count < 0 or count >= len(members):
        raise ExchangeError(f"{count} validation members leave no training member: there are {len(members)} in all")
    values = space.normalize(sorted(members))  # [M, P]
    varying = np.ptp(values, axis=0) > 0  # [P]
    ends = ((values == values.min(axis=0)) | (values == values.max(axis=0)))[:, varying].sum(axis=1)  # [M]
    order = np.lexsort((np.random.default_rng(seed).permutation(len(values)), ends))  # [M]
    return [sorted(members)[i] for i in order[:count]]


def _is_seen(camera: Camera, poses: np.ndarray) -> bool:
    """True if one of the poses [T, 4, 4] agrees with `camera` to half a pixel at the world's origin."""
    allowed = SAME_VIEW_PIXELS / camera.fx
    distance = max(float(np.linalg.norm(camera.position)), 1e-12)
    turned = np.abs(poses[:, :3, :3] - camera.rotation).max(axis=(1, 2))  # [T]
    moved = np.abs(poses[:, :3, 3] - camera.world_to_camera[:3, 3]).max(axis=1) / distance  # [T]
    return bool(((turned < allowed) & (moved < allowed)).any())


def _space(frames: Sequence[Frame], space: ParameterSpace | None, names: Sequence[str] | None) -> ParameterSpace:
    count = len(frames[0].parameters)
    if space is None:
        own = frames[0].names
        names = list(own) if names is None else list(names)
        if len(names) != count:
            last = ", the last of which is time" if own[-1] == "time" else ""
            raise ExchangeError(
                f"frames have {count} params{last}, there are {len(names)} names: {joined_names(names)}"
            )
        values = np.array([f.parameters for f in frames if f.file_split == "train"])  # [F, P]
        low, high = values.min(axis=0), values.max(axis=0)  # [P]
        high = np.where(high > low, high, low + np.maximum(np.abs(low), 1.0))  # a constant has no range of its own
        space = ParameterSpace(
            tuple(Parameter(name, float(a), float(b)) for name, a, b in zip(names, low, high, strict=True))
        )
    elif names is not None and tuple(names) != space.names:
        raise ExchangeError(
            f"names {joined_names(names)} contradict the parameter space's {joined_names(space.names)}: give one of them"
        )
    if len(space) != count:
        raise ExchangeError(
            f"frames have {count} params, the parameter space {len(space)}: {joined_names(space.names)}"
        )
    return space


def _check_alpha(frames: Sequence[Frame], background: Sequence[float] | None) -> None:
    if background is None:
        opaque = next((f for f in frames if not f.has_alpha), None)
        if opaque is not None:
            raise ExchangeError(f"{opaque.path} has no alpha: name the background of the images")
        return
    for frame in frames:
        if frame.has_alpha and read_image(frame.path)[..., 3].min() < 255:
            raise ExchangeError(
                f"{frame.path} is transparent and so has no background: import with background none, which keeps its alpha"
            )


def _check_same(present: Member, member: ImportedMember, names: Sequence[str]) -> None:
    same = (
        tuple(present.parameters[name] for name in names) == member.parameters
        and present.view_splits == member.view_splits
        and present.provenance.get("pictures") == member.pictures
    )
    if not same:
        raise ExchangeError(
            f"{present.path} was imported from other frames than member {member.name} has now: the data set, "
            "validation_members or seed changed; choose another catalog, or remove this one first"
        )
