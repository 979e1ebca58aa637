"""A scene: all settings of one run from the simulation to the report, read from one TOML file.

It describes the source of the fields, the members, appearances, views and training.  `insitu` validates `source`, `surrogate`
validates `training`; everything else is validated here.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.plugins import TABLES as TABLES_ELSEWHERE
from catalogs.plugins import plugins
from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import Appearance, VolumeRendering, appearance_from_json, check_fields, shown_fields
from catalogs.vocabulary.cameras import Camera, orbit, view_splits
from catalogs.vocabulary.parameters import SPLITS, ParameterSpace
from catalogs.vocabulary.quantity import Quantity, quantities_from, quantities_of
from catalogs.vocabulary.variations import Family, Variation, variation_kind
from catalogs.vocabulary.words import check_keys, joined_names, keys_of, member_line, shortened

SOURCES = ("simulation", "hooked", "loop", "hdf5", "files", "nerf", "catalog")
PLANNED = ("simulation", "hooked")  # kinds of sources whose members the scene lists
CATALOG_TABLES = {"name", "title", "source", "members", "training"}  # of a scene whose source is a catalog
DATA_FOLDER = "GS_SURROGATE_DATA"
NAN = ("refuse", "transparent")
BACKENDS = ("auto", "vtk", "cpu")
TABLES = {"name", "title", "source", "parameters", "members", "appearance", "variation", "fields"}
TABLES |= {"views", "render", "training"}


@dataclass(frozen=True)
class PlannedMember:
    """A member to render: its name in the catalog, parameters by name, split and appearances."""

    name: str
    parameters: Mapping[str, float]
    split: str
    appearances: tuple[str, ...] | None = None  # by name; None: all

    def __repr__(self) -> str:
        return member_line(self, f"appearances: {'all' if self.appearances is None else shortened(self.appearances)}")


@dataclass(frozen=True)
class ViewPlan:
    """Viewpoints on the icosphere of `frequency` around the volume, and the frame (pixels).

    Examples
    --------
    >>> from insitu import ViewPlan
    >>> views = ViewPlan(frequency=2, width=128, height=128)
    >>> len(views.cameras((0, 0, 0), radius=1.0)), views.splits().count("test")
    (42, 21)
    """

    frequency: int = 5
    width: int = 256
    height: int = 256
    fill: float = 0.9
    vertical_fov_degrees: float = 30.0

    def __post_init__(self) -> None:
        for name in ("frequency", "width", "height"):
            object.__setattr__(self, name, numbers.count(getattr(self, name), f"views: {name}"))
        object.__setattr__(self, "fill", numbers.positive(self.fill, "views: fill"))
        angle = numbers.positive(self.vertical_fov_degrees, "views: vertical_fov_degrees")
        object.__setattr__(self, "vertical_fov_degrees", angle)
        if self.fill > 1.0 or angle >= 180.0:
            raise ValueError(
                f"views: fill must lie in (0, 1] and vertical_fov_degrees in (0, 180), got {self.fill:g} and {angle:g}"
            )

    def cameras(self, center: Sequence[float], radius: float) -> tuple[Camera, ...]:
        """The plan's cameras around a bounding sphere (world units)."""
        return tuple(orbit(center, radius, **vars(self)))

    def splits(self) -> tuple[str, ...]:
        """The split of each of those cameras."""
        return tuple(view_splits(10 * self.frequency**2 + 2))


@dataclass(frozen=True)
class VariedMembers:
    """The members that show the settings of one variation.

    Training and test members show training and test settings, validation members those of validation.  Does not apply to field
    variations, whose settings are shown by all members.

    Attributes
    ----------
    variation : the variation.
    share : fraction of the training members that show it, drawn by the scene's seed; at least one.
    compared : number of evenly spread training settings that a test member shows as well; None: all.
    """

    variation: Variation
    share: float = 1.0
    compared: int | None = None

    def choose(self, training: Sequence[str], random: np.random.Generator) -> set[str]:
        """Names of the training members that show the variation."""
        exact = round(self.share * len(training), 9)  # 0.07 of 100 members is 7.000000000000001
        count = max(1, math.ceil(exact)) if training else 0
        return set(random.choice(training, count, replace=False).tolist()) if count else set()

    def shown_by(self, split: str) -> tuple[str, ...]:
        """Names of the appearances that a member of this split shows."""
        if split == "validation":
            return self.variation.named("validation")
        train = self.variation.named("train")
        if split == "test" and self.compared is not None and self.compared < len(train):
            train = tuple(train[i * len(train) // self.compared] for i in range(self.compared))
        return (*train, *self.variation.named("test"))


@dataclass(frozen=True)
class RenderPlan:
    """Accuracy of images: PSNR in dB against a converged reference, or a fixed step in world units.

    `nan` is "refuse", or "transparent" for fields with NaN or infinite values, such as land in an ocean.  `coarse_field` is False
    where no field with few samples is to be stored beside the images of each member.  `backend` draws: "vtk", "cpu", which casts
    rays without OpenGL, or "auto".
    """

    target_decibels: float = 50.0
    sample_distance: float | None = None
    nan: str = "refuse"
    coarse_field: bool = True
    backend: str = "auto"

    def __post_init__(self) -> None:
        if self.backend not in BACKENDS:
            raise ValueError(f"render: backend must be one of {joined_names(BACKENDS)}, got {self.backend!r}")
        if not isinstance(self.coarse_field, bool):
            raise ValueError(f"render: coarse_field must be true or false, got {self.coarse_field!r}")
        if self.nan not in NAN:
            raise ValueError(f"render: nan must be one of {joined_names(NAN)}, got {self.nan!r}")


@dataclass(frozen=True)
class Scene:
    """A parsed scene file.

    Attributes
    ----------
    name : also of the folder of results, `runs/<name>`.
    source : the `[source]` table; its `kind` is one of `SOURCES`, "loop" where a simulation brings its members to the hook.
    space : the ensemble's parameters; empty where the source's file has them (`hdf5`).
    members : members to simulate; empty where the source's file has them.
    validation_members : number of training members of a file that become validation members.
    appearances : including those of variations; empty for imported images (`nerf`).
    varied : the variations among the appearances, and the members that show them.
    training : the raw `[training]` table, validated by the surrogate.
    quantities : names and units of the shown fields, from the `[fields]` table (`Q = "1/s²"`); a source may add more.

    Examples
    --------
    >>> from catalogs import Scene
    >>> Scene.load("vortex.toml")
    <Scene vortex: 4 planned members; Re in [100, 200]; appearances: cores>
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
    varied: tuple[VariedMembers, ...] = ()
    quantities: Mapping[str, Quantity] = field(default_factory=dict)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scene:
        """Read a scene; raises ValueError naming file, table and remedy, FileNotFoundError where the file is absent."""
        path = Path(path)
        if not path.is_file():
            present = sorted(p.stem for p in path.parent.glob("*.toml"))
            raise FileNotFoundError(f"scene {path} does not exist; present here: {', '.join(present) or 'none'}")
        try:
            tables = tomllib.loads(path.read_text(encoding="utf-8"))
            return _parse(tables, path)
        except (ValueError, KeyError, TypeError) as error:
            reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
            raise ValueError(f"scene {path}: {reason}") from error

    def __repr__(self) -> str:
        appearances = shortened([appearance.name for appearance in self.appearances])
        return f"<Scene {self.name}: {len(self.members)} planned members; {self.space}; appearances: {appearances}>"

    @property
    def variations(self) -> tuple[Variation, ...]:
        return tuple(v.variation for v in self.varied)

    def check_tables(self) -> None:
        """Raise ValueError for a table that other parts of the package read later, such as `[training]`, if it is wrong."""
        names = [appearance.name for appearance in self.appearances]
        try:
            if self.training:
                plugins(TABLES_ELSEWHERE).get("training", dict)(self.training)
            if names and self.training.get("appearance", names[0]) not in names:
                raise ValueError(
                    f"training.appearance must be one of {joined_names(names)}, got {self.training['appearance']!r}"
                )
        except ValueError as error:
            raise ValueError(f"scene {self.path}: {error}") from None

    def assigned(self, members: Sequence[PlannedMember]) -> tuple[PlannedMember, ...]:
        """The members with the appearances that each shows."""
        if not self.varied:
            return tuple(members)
        training = [m.name for m in members if m.split == "train"]
        sampled = [v for v in self.varied if v.variation.continuous]
        settings = {s.appearance for v in sampled for s in v.variation.settings}
        plain = [a.name for a in self.appearances if a.name not in settings]
        random = np.random.default_rng(self.seed)
        chosen = [v.choose(training, random) for v in sampled]

        def appearances_of(member: PlannedMember) -> tuple[str, ...]:
            of = [v for v, some in zip(sampled, chosen, strict=True) if member.split != "train" or member.name in some]
            return (*plain, *(name for v in of for name in v.shown_by(member.split)))

        return tuple(replace(member, appearances=appearances_of(member)) for member in members)

    def run_directory(self, runs: str | os.PathLike[str] = "runs") -> Path:
        """The folder of this scene's catalog, surrogate and report."""
        return Path(runs) / self.name

    @property
    def catalog_path(self) -> Path:
        """The path of the catalog of a source of kind "catalog", given relative to the scene's folder."""
        return self.path.parent / str(self.source["path"])

    def data_path(self) -> Path:
        """The source's file or folder, relative to $GS_SURROGATE_DATA (default: the current folder).

        Raises FileNotFoundError naming the path and the remedy.
        """
        path = Path(os.environ.get(DATA_FOLDER, "")) / str(self.source["path"])
        if not path.exists():
            raise FileNotFoundError(
                f"scene {self.name} needs {path}, which is missing: set {DATA_FOLDER} to the folder that holds "
                f"{self.source['path']}"
            )
        return path


def _parse(tables: Mapping[str, Any], path: Path) -> Scene:
    unknown = sorted(set(tables) - TABLES)
    if unknown:
        raise ValueError(f"unknown tables or keys {joined_names(unknown)}; known are {joined_names(sorted(TABLES))}")
    source = tables["source"]
    if source.get("kind") not in SOURCES:
        raise ValueError(f"source.kind must be one of {SOURCES}, got {source.get('kind')!r}")
    if source["kind"] == "catalog":
        _check_catalog_source(tables)
    space = ParameterSpace.from_json(tables.get("parameters", ()))
    plan = dict(tables.get("members", {}))
    seed = int(plan.pop("seed", 0))
    members: tuple[PlannedMember, ...] = ()
    if source["kind"] in PLANNED:
        members = _members(plan, space, seed)
        validation_members = 0
    else:
        validation_members = int(plan.pop("validation", 0))
        if plan:
            raise ValueError(
                f"members come from the source: only seed and validation apply, got {joined_names(sorted(plan))}"
            )
    appearances = tuple(appearance_from_json(record) for record in tables.get("appearance", ()))
    variations = tables.get("variation", [])
    if not isinstance(variations, list) or not all(isinstance(record, dict) for record in variations):
        raise ValueError(f"variation must be tables with double brackets, [[variation]], got {variations!r}")
    families = [_family(record, appearances) for record in variations]
    appearances += tuple(a for family, _ in families for a in family.appearances)
    if not appearances and source["kind"] not in ("nerf", "catalog"):
        raise ValueError("at least one [[appearance]] is required")
    if len({a.name for a in appearances}) != len(appearances):
        raise ValueError("the names of appearances must be unique")
    check_fields(appearances)
    check_keys(keys_of(ViewPlan), tables.get("views", {}), "views")
    check_keys(keys_of(RenderPlan), tables.get("render", {}), "render")
    quantities = quantities_of(quantities_from(tables.get("fields", {})), shown_fields(appearances))
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
        varied=tuple(varied for _, varied in families),
        quantities=quantities,
    )


def _check_catalog_source(tables: Mapping[str, Any]) -> None:
    """Raise ValueError for settings that do not apply to a scene of a catalog."""
    if surplus := sorted(set(tables) - CATALOG_TABLES):
        raise ValueError(f"source of kind catalog: {joined_names(surplus)} are in the catalog, leave them out")
    source = tables["source"]
    check_keys(["hold_out", "kind", "path"], source, "source of kind catalog")
    if not isinstance(source.get("path"), str) or not source["path"]:
        raise ValueError(f"source.path must name a catalog, from this scene's folder, got {source.get('path')!r}")
    hold_out = source.get("hold_out")
    if hold_out is not None and (type(hold_out) is not float or not 0.0 < hold_out < 1.0):
        raise ValueError(
            f"source.hold_out, the share of members that test the surrogate, must lie in (0, 1), got {hold_out!r}"
        )
    if "validation" in tables.get("members", {}):
        raise ValueError("members.validation does not apply to a catalog, some of whose members validate by default")


def _family(record: Mapping[str, Any], appearances: Sequence[Appearance]) -> tuple[Family, VariedMembers]:
    """One `[[variation]]` table: a family of appearances around its base, and the members that show it."""
    values = dict(record)
    form, base_name = variation_kind(values.pop("kind", None)), values.pop("of", None)
    share, compared = values.pop("members", 1.0), values.pop("compared", None)
    base = next((a for a in appearances if a.name == base_name), None)
    if not isinstance(base, VolumeRendering):
        raise ValueError(f"variation.of must name a volume rendering among the appearances, got {base_name!r}")
    if type(share) not in (int, float) or not 0.0 < share <= 1.0:
        raise ValueError(f"variation.members, the share of training members, must lie in (0, 1], got {share!r}")
    if compared is not None and (type(compared) is not int or compared < 1):
        raise ValueError(f"variation.compared must be a count, at least 1, got {compared!r}; left out, it is all")
    if not form.continuous and {"members", "compared"} & set(record):
        raise ValueError(f"variation of {base.name}: every member shows every field, leave out members and compared")
    try:
        family = form.family(base, [a.name for a in appearances], **values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"variation of {base.name}: {error}") from None
    return family, VariedMembers(family.variation, float(share), compared)


def _members(plan: Mapping[str, Any], space: ParameterSpace, seed: int) -> tuple[PlannedMember, ...]:
    """Members per split: a count (Latin hypercube) or a list whose entries `_rows` describes."""
    check_keys([*SPLITS, "seed"], plan, "members")
    members = []
    for offset, split in enumerate(SPLITS):
        listed = plan.get(split, 0)
        if isinstance(listed, int):
            rows = space.latin_hypercube(listed, seed + offset).tolist() if listed else []
        else:
            rows = [row for i, entry in enumerate(listed) for row in _rows(entry, space, f"members.{split}[{i}]")]
        for i, row in enumerate(rows):
            parameters = dict(zip(space.names, row, strict=True))
            space.values(parameters, stacklevel=4)  # who called `Scene.load`
            members.append(PlannedMember(f"{split}-{i:03d}", parameters, split))
    if not any(m.split == "train" for m in members):
        raise ValueError("members.train must ask for at least one member")
    if len({tuple(m.parameters.values()) for m in members}) != len(members):
        raise ValueError("members must differ in their parameters: two are the same")
    return tuple(members)


def _rows(entry: Any, space: ParameterSpace, place: str) -> list[list[float]]:
    """Parameters, in the space's order, of the members in one entry of a list.

    An entry is a list of values, or a single value for one parameter.  Several members that differ in one parameter, such as the
    dumps of a run, are a table: `{ Re = 400.0, time = [2.0, 4.5, 7.0] }`.
    """
    if not isinstance(entry, dict):
        values = entry if isinstance(entry, list) else [entry]
        if len(values) != len(space):
            raise ValueError(f"{place} must hold {len(space)} values for {space.names}, got {values}")
        return [list(map(float, values))]
    if set(entry) != set(space.names):
        raise ValueError(f"{place} must give {', '.join(space.names)}, got {', '.join(entry) or 'nothing'}")
    several = [name for name, value in entry.items() if isinstance(value, list)]
    if len(several) > 1:
        raise ValueError(
            f"{place}: one parameter may be a list, {' and '.join(several)} are: write a table for each value of one"
        )
    if not several:
        return [[float(entry[name]) for name in space.names]]
    if not entry[several[0]]:
        raise ValueError(f"{place}.{several[0]} is empty: list at least one value, or leave the table out")
    return [[float({**entry, several[0]: value}[name]) for name in space.names] for value in entry[several[0]]]
