"""A scene: everything that one run of the whole line needs, read from one TOML file.

The table says where the fields come from, which members there are, how they are shown, from where, and with what
budget the surrogate is trained.  Each half of the product checks the part it acts on: `source` belongs to `insitu`,
`training` to `surrogate`; what both must agree on is checked here.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catalogs.appearance import Appearance, appearance_from_json
from catalogs.cameras import Camera, orbit, view_splits
from catalogs.parameters import SPLITS, Parameter, ParameterSpace

SOURCES = ("simulation", "hdf5", "nerf")
DATA_FOLDER = "GS_SURROGATE_DATA"
TABLES = {"name", "title", "source", "parameters", "members", "appearance", "views", "render", "training"}


@dataclass(frozen=True)
class PlannedMember:
    """A member that the scene asks for: its name in the catalog, parameters by name, and split."""

    name: str
    parameters: Mapping[str, float]
    split: str


@dataclass(frozen=True)
class ViewPlan:
    """Viewpoints on the icosphere of `frequency` around the volume, and the frame (pixels)."""

    frequency: int = 5
    width: int = 256
    height: int = 256
    fill: float = 0.9
    vertical_fov_degrees: float = 30.0

    def __post_init__(self) -> None:
        if self.frequency < 1 or self.width < 1 or self.height < 1:
            raise ValueError(f"frequency, width and height must be at least 1, got {self}")

    def cameras(self, center: Sequence[float], radius: float) -> tuple[Camera, ...]:
        """The plan's cameras around a bounding sphere (world units)."""
        return tuple(
            orbit(
                center,
                radius,
                width=self.width,
                height=self.height,
                fill=self.fill,
                vertical_fov_degrees=self.vertical_fov_degrees,
                frequency=self.frequency,
            )
        )

    def splits(self) -> tuple[str, ...]:
        """The split of each of those cameras."""
        return tuple(view_splits(10 * self.frequency**2 + 2))


@dataclass(frozen=True)
class RenderPlan:
    """How exact the pictures must be: PSNR in dB against a converged reference, or a fixed step in world units."""

    target_decibels: float = 50.0
    sample_distance: float | None = None


@dataclass(frozen=True)
class Scene:
    """A parsed scene file.

    Attributes
    ----------
    name : names the folder of its results, `runs/<name>`.
    source : the `[source]` table; its `kind` is one of `SOURCES`.
    space : the ensemble's parameters; empty where the source's file states them (`hdf5`).
    members : what a simulation must run; empty where the source's file holds the members.
    validation_members : how many training members of a file become validation members.
    appearances : the visualization parameters; empty for images made elsewhere (`nerf`).
    training : the raw `[training]` table, checked by the surrogate.
    """

    name: str
    title: str
    path: Path
    source: Mapping[str, Any]
    space: ParameterSpace
    members: tuple[PlannedMember, ...]
    appearances: tuple[Appearance, ...]
    views: ViewPlan
    render: RenderPlan
    training: Mapping[str, Any] = field(default_factory=dict)
    validation_members: int = 0
    seed: int = 0

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scene:
        """Read a scene; raises ValueError naming the file, the table and the remedy, FileNotFoundError without one."""
        path = Path(path)
        if not path.is_file():
            known = sorted(p.stem for p in path.parent.glob("*.toml"))
            raise FileNotFoundError(f"there is no scene {path}; known here: {', '.join(known) or 'none'}")
        try:
            tables = tomllib.loads(path.read_text(encoding="utf-8"))
            return _parse(tables, path)
        except (ValueError, KeyError, TypeError) as error:
            reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
            raise ValueError(f"scene {path}: {reason}") from error

    def run_directory(self, runs: str | os.PathLike[str] = "runs") -> Path:
        """Where this scene's catalog, surrogate and report live."""
        return Path(runs) / self.name

    def data_path(self) -> Path:
        """The source's file or folder, relative to $GS_SURROGATE_DATA (default `../shared/data`).

        Raises FileNotFoundError saying what is missing and how to name its place.
        """
        path = Path(os.environ.get(DATA_FOLDER, "../shared/data")) / str(self.source["path"])
        if not path.exists():
            raise FileNotFoundError(
                f"scene {self.name} needs {path}, which is not here: set {DATA_FOLDER} to the folder that holds "
                f"{self.source['path']}"
            )
        return path


def _parse(tables: Mapping[str, Any], path: Path) -> Scene:
    unknown = sorted(set(tables) - TABLES)
    if unknown:
        raise ValueError(f"unknown tables or keys {unknown}; known are {sorted(TABLES)}")
    source = tables["source"]
    if source.get("kind") not in SOURCES:
        raise ValueError(f"source.kind must be one of {SOURCES}, got {source.get('kind')!r}")
    space = ParameterSpace(tuple(Parameter(**record) for record in tables.get("parameters", ())))
    plan = dict(tables.get("members", {}))
    seed = int(plan.pop("seed", 0))
    members: tuple[PlannedMember, ...] = ()
    if source["kind"] == "simulation":
        members = _members(plan, space, seed)
        validation_members = 0
    else:
        validation_members = int(plan.pop("validation", 0))
        if plan:
            raise ValueError(f"members come from the source's file: only seed and validation apply, got {sorted(plan)}")
    appearances = tuple(appearance_from_json(record) for record in tables.get("appearance", ()))
    if not appearances and source["kind"] != "nerf":
        raise ValueError("at least one [[appearance]] must say how the field is shown")
    if len({a.name for a in appearances}) != len(appearances):
        raise ValueError("the names of appearances must be unique")
    return Scene(
        name=str(tables["name"]),
        title=str(tables.get("title", tables["name"])),
        path=path,
        source=source,
        space=space,
        members=members,
        appearances=appearances,
        views=ViewPlan(**tables.get("views", {})),
        render=RenderPlan(**tables.get("render", {})),
        training=tables.get("training", {}),
        validation_members=validation_members,
        seed=seed,
    )


def _members(plan: Mapping[str, Any], space: ParameterSpace, seed: int) -> tuple[PlannedMember, ...]:
    """Members per split: a count (Latin hypercube) or a list of values, one per parameter."""
    unknown = sorted(set(plan) - set(SPLITS))
    if unknown:
        raise ValueError(f"members: unknown keys {unknown}; known are {[*SPLITS, 'seed']}")
    members = []
    for offset, split in enumerate(SPLITS):
        wanted = plan.get(split, 0)
        rows = space.latin_hypercube(wanted, seed + offset).tolist() if isinstance(wanted, int) and wanted else wanted
        for i, row in enumerate(rows or ()):
            values = row if isinstance(row, list) else [row]
            if len(values) != len(space):
                raise ValueError(f"members.{split}[{i}] must hold {len(space)} values for {space.names}, got {values}")
            parameters = dict(zip(space.names, map(float, values), strict=True))
            space.values(parameters)
            members.append(PlannedMember(f"{split}-{i:03d}", parameters, split))
    if not any(m.split == "train" for m in members):
        raise ValueError("members.train must ask for at least one member")
    if len({tuple(m.parameters.values()) for m in members}) != len(members):
        raise ValueError("members must differ in their parameters: two are the same")
    return tuple(members)
