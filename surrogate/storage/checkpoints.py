"""Checkpoints of training, written whole or not at all, and the fingerprint by which a run is recognized."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.torch
from torch import Tensor

from catalogs.files import durable
from catalogs.store.catalog import Catalog, Member
from catalogs.store.pictures import picture_sizes
from catalogs.vocabulary.appearance import appearance_to_json
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.words import one_line
from surrogate.settings import FORMER, TrainingSettings

CHECKPOINT = "checkpoint.safetensors"
NOT_LEARNT = (
    "appearances",
    "provenance",
    "variations",
    "fields",
    "layout",
)  # of a plan, whatever is not taken up one by one
TIMING_ONLY = ("checkpoint_seconds",)  # settings that change no result


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """All that training knows: tensors by name, and `record`, JSON values, which say where it stands."""

    tensors: Mapping[str, Tensor]
    record: Mapping[str, Any]

    __repr__ = one_line

    def save(self, directory: Path) -> None:
        """Replace the checkpoint in `directory` atomically; one file, so that its parts can't disagree."""
        metadata = {"record": json.dumps(self.record)}
        durable.replace(directory / CHECKPOINT, safetensors.torch.save(dict(self.in_main_memory().tensors), metadata))

    def in_main_memory(self) -> Checkpoint:
        """The same with tensors in main memory, which nobody differentiates."""
        return Checkpoint({n: t.detach().cpu().contiguous() for n, t in self.tensors.items()}, self.record)

    def digest(self) -> str:
        """A SHA-256 over names and bytes of all tensors."""
        digest = hashlib.sha256()
        for name, tensor in sorted(self.in_main_memory().tensors.items()):
            digest.update(name.encode())
            digest.update(tensor.numpy().tobytes())
        return digest.hexdigest()

    @classmethod
    def load(cls, directory: Path) -> Checkpoint | None:
        """The checkpoint in `directory`, or None; raises ValueError naming a file that is not one."""
        path = directory / CHECKPOINT
        if not path.exists():
            return None
        try:
            with safetensors.safe_open(path, framework="pt") as file:
                record = json.loads(file.metadata()["record"])
                # Copied, for in the file they begin at any address, and some processors' matrix products depend on it.
                return cls({n: file.get_tensor(n).clone() for n in file.keys()}, record)  # noqa: SIM118 - not a dict
        except (safetensors.SafetensorError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is not a checkpoint ({error}): delete it to train anew") from error


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Hold `directory` for one training run; raises RuntimeError where another process trains there."""
    with (directory / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RuntimeError(f"another process is training in {directory}: wait for it or stop it") from None
        durable.remove_abandoned(directory)
        yield


def fingerprint(settings: TrainingSettings, catalog: Catalog) -> str:
    """A SHA-256 over all that determines a training run: settings, the catalog's plan, its members and image sizes."""
    plan = catalog.plan
    appearance = settings.appearance or plan.appearances[0].name
    learnt = [v for v in plan.variations if v.base == appearance and settings.visualization_steps]
    carried = any(settings.carry_values(a) for a in plan.appearances if a.name == appearance)
    return _digest(
        {
            **({"carried": "values"} if carried else {}),
            "settings": {**FORMER, **{k: v for k, v in settings.to_json().items() if k not in TIMING_ONLY}},
            **_identity_of_data(catalog, appearance, learnt, sizes=True),
        }
    )


def fingerprint_of_scene(catalog: Catalog) -> str:
    """A SHA-256 over what a catalog's first appearance and its variations show, whatever learns it.

    It is the same where the same scene was rendered on a processor of another kind, which rounds otherwise: its pictures, and
    the last digits of its cameras.
    """
    appearance = catalog.plan.appearances[0].name
    varied = [v for v in catalog.plan.variations if v.base == appearance]
    return _digest(_rounded(_identity_of_data(catalog, appearance, varied, sizes=False)))


def _identity_of_data(
    catalog: Catalog, appearance: str, variations: Sequence[Variation], *, sizes: bool
) -> dict[str, Any]:
    """A catalog's plan, as far as it matters to an appearance and its variations, and its members."""
    plan = catalog.plan
    names = [appearance, *(s.appearance for v in variations for s in v.settings)]
    return {
        "plan": {k: v for k, v in plan.to_json().items() if k not in NOT_LEARNT},
        "variations": [v.to_json() for v in variations],
        "appearances": [appearance_to_json(a) for a in plan.appearances if a.name in set(names)],
        "members": [_identity(catalog, member, names if sizes else ()) for member in catalog.members],
    }


def _digest(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def _rounded(value: Any) -> Any:
    """The same with nine digits; of the entries of a camera's matrix, nine of the largest, for zeros are not exact there."""
    if isinstance(value, dict):
        return {
            name: (_rounded_matrix if name == "world_to_camera" else _rounded)(each) for name, each in value.items()
        }
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return float(f"{value:.9g}") if isinstance(value, float) else value


def _rounded_matrix(rows: Any) -> Any:
    matrix = np.array(rows)  # [4, 4]
    scale = float(np.abs(matrix).max())
    return [_rounded(scale), (np.round(matrix / scale, 9) + 0.0).tolist()]  # -0 is 0 too


def _identity(catalog: Catalog, member: Member, appearances: Sequence[str]) -> dict[str, Any]:
    """All that identifies a member's images without reading them."""
    names = [a for a in appearances if a in member.appearances]
    own = member.cameras is not catalog.plan.cameras
    return {
        "name": member.name,
        "parameters": dict(member.parameters),
        "split": member.split,
        "views": list(member.view_splits),
        "cameras": [camera.to_json() for camera in member.cameras] if own else None,
        "bytes": picture_sizes(member, catalog.plan, names),
    }
