"""Files that are there whole or not at all: training checkpoints, and the marks by which one is recognized."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
from torch import Tensor

from catalogs.appearance import appearance_to_json
from catalogs.catalog import Catalog
from surrogate.settings import TrainingSettings

CHECKPOINT = "checkpoint.safetensors"
TIMING_ONLY = ("checkpoint_seconds",)  # settings that change no result


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """All that training knows: tensors by name, and `record`, JSON values, which say where it stands."""

    tensors: Mapping[str, Tensor]
    record: Mapping[str, Any]

    def save(self, directory: Path) -> None:
        """Replace the checkpoint in `directory` atomically; one file, so that its parts can't disagree."""
        tensors = {name: tensor.detach().contiguous() for name, tensor in self.tensors.items()}
        metadata = {"record": json.dumps(self.record)}
        write_atomically(directory / CHECKPOINT, safetensors.torch.save(tensors, metadata))

    @classmethod
    def load(cls, directory: Path) -> Checkpoint | None:
        """The checkpoint in `directory`, or None; raises ValueError naming a file that is not one."""
        path = directory / CHECKPOINT
        if not path.exists():
            return None
        try:
            with safetensors.safe_open(path, framework="pt") as file:
                record = json.loads(file.metadata()["record"])
                return cls({name: file.get_tensor(name) for name in file.keys()}, record)  # noqa: SIM118 - not a dict
        except (safetensors.SafetensorError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is not a checkpoint ({error}): delete it to train anew") from error


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path`: readers see the old file or the new one, never a part, even after a crash."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Hold `directory` for one training run; raises RuntimeError where another process trains there."""
    with (directory / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RuntimeError(f"another process is training in {directory}: wait for it or stop it") from None
        yield


def fingerprint(settings: TrainingSettings, catalog: Catalog) -> str:
    """A SHA-256 over all that determines a training run: settings, the catalog's plan, its members and image sizes."""
    plan = catalog.plan
    appearance = settings.appearance or plan.appearances[0].name
    values = {
        "settings": {k: v for k, v in settings.to_json().items() if k not in TIMING_ONLY},
        "space": plan.space.to_json(),
        "appearances": [appearance_to_json(a) for a in plan.appearances if a.name == appearance],
        "bounds": plan.bounds,
        "background": plan.background,
        "members": [
            {
                "name": member.name,
                "parameters": dict(member.parameters),
                "split": member.split,
                "views": list(member.view_splits),
                "cameras": [camera.to_json() for camera in member.cameras],
                "bytes": [
                    catalog.image_path(member, appearance, view).stat().st_size for view in range(len(member.cameras))
                ],
            }
            for member in catalog.members
        ],
    }
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=list).encode()).hexdigest()
