"""What an ensemble fixes before its first member."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catalogs.appearance import (
    Appearance,
    VolumeRendering,
    appearance_from_json,
    check_fields,
    field_of,
    shown_fields,
)
from catalogs.catalog import CatalogPlan
from catalogs.parameters import SPLITS, Parameter, ParameterSpace
from catalogs.scene import Scene, ViewPlan
from catalogs.variations import Variation
from insitu.boxes import Box, box_around, cameras_around, check_inside, checked_box
from insitu.summarize import value_range

if TYPE_CHECKING:
    from insitu.fields import Fields
    from render.quality import SampleDistance

TARGET_DECIBELS = 50.0
CORNERS = 6  # settings of a variation whose sample distance is measured; the finest serves the whole variation
BEST_DECIBELS = 99.0  # recorded where a picture equals its reference: JSON has no infinity


@dataclass(frozen=True)
class PlanOptions:
    """What a caller wants fixed for the ensemble; None leaves it to the catalog or, in a new one, to a default.

    The attributes are arguments of `insitu.render_member`, which describes them.
    """

    space: ParameterSpace | None = None
    appearances: tuple[Appearance, ...] | None = field(default=None, repr=False)
    views: ViewPlan | None = None
    bounds: Box | None = None
    target_decibels: float | None = None
    sample_distance: float | Mapping[str, float] | None = None
    image_format: str | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    variations: tuple[Variation, ...] | None = field(default=None, repr=False)

    @classmethod
    def of_scene(cls, scene: Scene, space: ParameterSpace, provenance: Mapping[str, Any] | None = None) -> PlanOptions:
        """What a scene says about rendering an ensemble; raises ValueError where it says nothing."""
        if not scene.appearances:
            raise ValueError(f"scene {scene.path} has no [[appearance]]: its images were made elsewhere")
        distance = scene.render.sample_distance
        return cls(
            space,
            scene.appearances,
            scene.views,
            target_decibels=scene.render.target_decibels if distance is None else None,
            sample_distance=distance,
            provenance=provenance or {},
            variations=scene.variations,
        )

    def __post_init__(self) -> None:
        if self.bounds is not None:
            object.__setattr__(self, "bounds", checked_box(self.bounds))
        if self.target_decibels is not None and not self.target_decibels > 0:
            raise ValueError(f"target_decibels must be positive, got {self.target_decibels}")
        if self.sample_distance is not None and self.target_decibels is not None:
            raise ValueError("give target_decibels or sample_distance, not both: the one is chosen to reach the other")
        steps = self.sample_distance.values() if isinstance(self.sample_distance, Mapping) else [self.sample_distance]
        if any(s is not None and not (np.isfinite(s) and s > 0) for s in steps):
            raise ValueError(f"sample_distance must be positive (world units), got {self.sample_distance}")


def space_from(space: ParameterSpace | Mapping[str, tuple[float, float]] | None) -> ParameterSpace | None:
    """A parameter space, also from `{name: (low, high)}`."""
    if space is None or isinstance(space, ParameterSpace):
        return space
    return ParameterSpace(tuple(Parameter(name, float(low), float(high)) for name, (low, high) in space.items()))


def appearances_from(appearances: Appearance | Iterable[Appearance] | None) -> tuple[Appearance, ...] | None:
    """One appearance or several, as a tuple."""
    if appearances is None:
        return None
    return tuple(appearances) if isinstance(appearances, Iterable) else (appearances,)


def appearances_from_toml(path: Path) -> tuple[Appearance, ...]:
    """The `[[appearance]]` tables of a TOML file, such as `insitu probe` prints; raises ValueError naming the file."""
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8")).get("appearance", [])
        if not isinstance(tables, list) or not tables:
            raise ValueError("it holds no [[appearance]] table")
        return tuple(appearance_from_json(table) for table in tables)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


@dataclass(frozen=True)
class Pilot:
    """What the plan of a new catalog needs to know of one member's field, or of several, before member 1.

    Attributes
    ----------
    bounds : world box that holds the field.
    ranges : smallest and largest finite value by field, "" for an only one without a name.
    distances : by volume rendering, the sample distance that reaches the target; empty where it is given.
    notes : what the user should know of them.
    """

    bounds: Box
    ranges: Mapping[str, tuple[float, float]]
    distances: Mapping[str, SampleDistance] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def measure_pilot(fields: Fields, options: PlanOptions) -> Pilot:
    """Measure one member: its box, its ranges and, unless given, the sample distances that its pictures need."""
    _, appearances = check_complete(options)
    bounds = options.bounds or fields.box
    check_inside(fields.box, bounds)
    volumes = [a for a in appearances if isinstance(a, VolumeRendering)]
    if options.sample_distance is not None or not volumes:
        return Pilot(bounds, fields.ranges)
    from render.quality import choose_sample_distance

    variations = [v for v in options.variations or () if v.continuous]  # nothing is in common between fields
    cameras = cameras_around(bounds, options.views or ViewPlan())
    target = options.target_decibels or TARGET_DECIBELS
    found = {
        a.name: choose_sample_distance(fields.shown_by(a), a, cameras, target, warn=False)
        for a in _measured(volumes, variations)
    }
    related = {a.name: _related(a.name, variations) & found.keys() for a in volumes}
    finest = {
        name: min((found[other] for other in found if other in names), key=_length) for name, names in related.items()
    }
    return Pilot(bounds, fields.ranges, finest, tuple(distance.note for distance in found.values() if distance.note))


def _measured(volumes: Sequence[VolumeRendering], variations: Sequence[Variation]) -> list[VolumeRendering]:
    """The volume renderings whose sample distance is measured: of a variation, the base and a few that lie far from it."""
    settings = {s.appearance for v in variations for s in v.settings}
    kept = {name for v in variations for name in v.named("train")[:: max(1, len(v.named("train")) // CORNERS)]}
    return [a for a in volumes if a.name not in settings or a.name in kept]


def _related(name: str, variations: Sequence[Variation]) -> set[str]:
    """The appearances whose finest sample distance an appearance takes: its own, and those of its variation."""
    families = [{variation.base, *variation.named(*SPLITS)} for variation in variations]
    return {name}.union(*(family for family in families if name in family))


def _length(distance: SampleDistance) -> float:
    return distance.distance


def combine_pilots(pilots: Sequence[Pilot]) -> Pilot:
    """One pilot for all: the box around their boxes, the widest ranges, the finest sample distances."""
    return Pilot(
        box_around([p.bounds for p in pilots]),
        {
            name: (min(p.ranges[name][0] for p in pilots), max(p.ranges[name][1] for p in pilots))
            for name in pilots[0].ranges
        },
        {name: min((p.distances[name] for p in pilots), key=_length) for name in pilots[0].distances},
    )


def check_complete(options: PlanOptions) -> tuple[ParameterSpace, tuple[Appearance, ...]]:
    """The space and appearances that a new catalog needs; raises ValueError without them: no field can stand in."""
    if options.space is None or not options.appearances:
        missing = "space" if options.space is None else "appearances"
        raise ValueError(
            f"a new catalog needs {missing}=, because what is fixed for the ensemble cannot come from its first member "
            "(`insitu probe` suggests a transfer function)"
        )
    check_fields(options.appearances)
    if isinstance(options.sample_distance, Mapping):
        given_distances(options.sample_distance, options.appearances)
    return options.space, options.appearances


def plan_catalog(pilot: Pilot, options: PlanOptions) -> CatalogPlan:
    """The plan of a new catalog: the options, and from `pilot` what they leave open."""
    space, appearances = check_complete(options)
    views = options.views or ViewPlan()
    provenance: dict[str, Any] = {
        **options.provenance,
        "bounds_from": "given" if options.bounds else "pilot members",
        "software": _software(),
        **_value_ranges(pilot, appearances),
    }
    if options.sample_distance is not None:
        provenance["sample_distances"] = given_distances(options.sample_distance, appearances)
    elif pilot.distances:
        provenance["target_decibels"] = options.target_decibels or TARGET_DECIBELS
        provenance["sample_distances"] = {name: float(d.distance) for name, d in pilot.distances.items()}
        provenance["measured_decibels"] = {
            name: round(min(float(d.decibels), BEST_DECIBELS), 2) for name, d in pilot.distances.items()
        }
    return CatalogPlan(
        space=space,
        appearances=appearances,
        cameras=cameras_around(pilot.bounds, views),
        view_splits=views.splits(),
        bounds=pilot.bounds,
        image_format=options.image_format or "png",
        provenance=provenance,
        variations=options.variations or (),
    )


def _value_ranges(pilot: Pilot, appearances: Sequence[Appearance]) -> dict[str, Any]:
    """What a plan records of the ensemble's fixed range of values, or of the range of each of several fields."""
    shown = shown_fields(appearances)
    by = {f: list(value_range([a for a in appearances if field_of(a) == f], pilot.ranges[f])) for f in shown}
    return {"value_ranges": by} if len(by) > 1 else {"value_range": next(iter(by.values()))}


def is_catalog(path: Path) -> bool:
    """Whether there is a catalog at `path`; one whose creation was interrupted does not count."""
    return (path / "catalog.json").is_file()


def given_distances(distance: float | Mapping[str, float], appearances: Sequence[Appearance]) -> dict[str, float]:
    """The sample distance of each volume rendering; raises ValueError where a mapping names others."""
    names = [a.name for a in appearances if isinstance(a, VolumeRendering)]
    if not isinstance(distance, Mapping):
        return {name: float(distance) for name in names}
    if set(distance) != set(names):
        raise ValueError(f"sample_distance must name the volume renderings {names}, got {sorted(distance)}")
    return {name: float(distance[name]) for name in names}


def _software() -> dict[str, str]:
    found = {}
    for package in ("gs-surrogate", "vtk", "numpy"):
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found
