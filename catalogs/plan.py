"""What is fixed for a whole ensemble before its first member is written."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from catalogs import cinema
from catalogs.appearance import Appearance, Isosurface, appearance_from_json, appearance_to_json
from catalogs.cameras import Camera
from catalogs.images import FORMATS
from catalogs.parameters import SPLITS, ParameterSpace

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+=-]*")


class CatalogError(ValueError):
    """A catalog is not what was asked for: the message says what, where, and what would do."""


@dataclass(frozen=True)
class CatalogPlan:
    """What is fixed for the whole ensemble before its first member.

    Attributes
    ----------
    space : the simulation parameters.
    appearances : the visualization parameters, each with its own name.
    cameras : shared by all members; () when every member brings its own.
    view_splits : "train", "validation" or "test" per camera.
    bounds : world box (low, high) that holds the volume.
    background : None: images have alpha; else they are opaque and stand on this RGB colour in [0, 1].
    image_format : "png" (8 bits) or "exr" (float32).
    provenance : JSON values: software, sample distances, scene.
    """

    space: ParameterSpace
    appearances: tuple[Appearance, ...]
    cameras: tuple[Camera, ...]
    view_splits: tuple[str, ...]
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    background: tuple[float, float, float] | None = None
    image_format: str = "png"
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        low, high = (tuple(map(float, corner)) for corner in self.bounds)
        if len(low) != 3 or len(high) != 3 or not all(a < b for a, b in zip(low, high, strict=True)):
            raise CatalogError(f"bounds must be two corners low < high of three numbers, got {self.bounds}")
        names = [a.name for a in self.appearances]
        if not names or len(set(names)) != len(names) or not all(NAME.fullmatch(n) for n in names):
            raise CatalogError(f"appearances need unique names of letters, digits and _.+=-, got {names}")
        check_views(self.cameras, self.view_splits)
        if self.image_format not in FORMATS:
            raise CatalogError(f"image_format must be one of {sorted(FORMATS)}, got {self.image_format!r}")
        problems = cinema.header_problems(table_header(self))
        if problems:
            raise CatalogError(f"these columns would break Cinema specification D: {'; '.join(problems)}")
        object.__setattr__(self, "bounds", (low, high))

    def to_json(self) -> dict[str, Any]:
        """Everything but the schema version, as JSON values."""
        return {
            "parameters": self.space.to_json(),
            "appearances": [appearance_to_json(a) for a in self.appearances],
            "cameras": [c.to_json() for c in self.cameras],
            "view_splits": list(self.view_splits),
            "bounds": [list(corner) for corner in self.bounds],
            "background": None if self.background is None else list(self.background),
            "image_format": self.image_format,
            "images": {"memory": "premultiplied RGBA", "disk": "straight RGBA", "rows": "top first"},
            "provenance": dict(self.provenance),
        }

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> CatalogPlan:
        """The plan of a `to_json` record; unknown keys are ignored, so that minor additions stay readable."""
        low, high = record["bounds"]
        return cls(
            space=ParameterSpace.from_json(record["parameters"]),
            appearances=tuple(appearance_from_json(a) for a in record["appearances"]),
            cameras=tuple(Camera.from_json(c) for c in record["cameras"]),
            view_splits=tuple(record["view_splits"]),
            bounds=(tuple(low), tuple(high)),
            background=None if record["background"] is None else tuple(record["background"]),
            image_format=record["image_format"],
            provenance=record.get("provenance", {}),
        )

    def differences(self, other: CatalogPlan) -> list[str]:
        """Names of what differs, provenance aside."""
        mine, theirs = json.loads(json.dumps(self.to_json())), json.loads(json.dumps(other.to_json()))
        return [key for key in mine if key != "provenance" and mine[key] != theirs[key]]


def table_header(plan: CatalogPlan) -> list[str]:
    """The labels of the plan's table, in their order."""
    isovalue = ["isovalue"] if any(isinstance(a, Isosurface) for a in plan.appearances) else []
    views = ["member", "view", "phi", "theta", "split", "member_split", "view_split"]
    return [*plan.space.names, "appearance", *isovalue, *views, "FILE"]


def check_views(cameras: Sequence[Camera], view_splits: Sequence[str]) -> None:
    """Raise CatalogError unless every camera has one of the known splits."""
    if len(cameras) != len(view_splits):
        raise CatalogError(f"{len(cameras)} cameras need as many splits, got {len(view_splits)}")
    strange = sorted(set(view_splits) - set(SPLITS))
    if strange:
        raise CatalogError(f"a view's split must be one of {SPLITS}, got {strange}")
