"""The plan of an ensemble, fixed before its first member."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from reprlib import repr as shortened
from typing import TYPE_CHECKING, Any

from catalogs.files.images import FORMATS
from catalogs.store.catalog import CatalogPlan
from catalogs.store.plan import CatalogError, json_values
from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import (
    Appearance,
    ImportedImages,
    Isosurface,
    TransferFunction,
    VolumeRendering,
    appearance_from_json,
    check_fields,
    field_of,
    shown_fields,
)
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.plugin_appearance import MissingAppearance, PluginAppearance, check_present
from catalogs.vocabulary.quantity import Quantity, quantities_from, quantities_of
from catalogs.vocabulary.scene import BACKENDS, Scene, ViewPlan
from catalogs.vocabulary.variations import Family, Variation
from catalogs.vocabulary.words import joined_names
from insitu.fields.boxes import Box, box_around, cameras_around, check_inside, checked_box
from insitu.fields.distances import finest_of_families, measured_distances
from insitu.fields.summarize import value_range
from insitu.members.backends import backends_of

if TYPE_CHECKING:
    from insitu.fields.member_fields import MemberFields
    from render.quality import SampleDistance

Space = ParameterSpace | Parameter | Iterable[Parameter] | Mapping[str, Any]

TARGET_DECIBELS = 50.0
SPACES = (
    'space must be {name: (low, high)}, {name: (low, high, "unit")}, Parameter(name, low, high, unit, scale) or several of '
    "them, or a ParameterSpace"
)
MOST_STEPS = 20_000  # of a ray: beyond, they are lost in the rounding of single precision
BEST_DECIBELS = 99.0  # recorded where a picture equals its reference: JSON has no infinity


@dataclass(frozen=True)
class PlanOptions:
    """A caller's options for the ensemble; None leaves one to the catalog or, in a new one, to a default.

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
    fields: Mapping[str, Quantity] = field(default_factory=dict)
    coarse_field: bool = True
    backend: str = "auto"

    @classmethod
    def of_scene(cls, scene: Scene, space: ParameterSpace, provenance: Mapping[str, Any] | None = None) -> PlanOptions:
        """A scene's options for rendering an ensemble; raises ValueError where it has none."""
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
            fields=scene.quantities,
            coarse_field=scene.render.coarse_field,
            backend=scene.render.backend,
        )

    def __post_init__(self) -> None:
        object.__setattr__(self, "fields", quantities_from(self.fields))
        if self.bounds is not None:
            object.__setattr__(self, "bounds", checked_box(self.bounds))
        if self.views is not None and not isinstance(self.views, ViewPlan):
            raise ValueError(f"views must be a ViewPlan(frequency, width, height), got {shortened(self.views)}")
        if not isinstance(self.coarse_field, bool):
            raise ValueError(f"coarse_field must be True or False, got {shortened(self.coarse_field)}")
        if self.backend not in BACKENDS:
            raise ValueError(f"backend must be one of {joined_names(BACKENDS)}, got {shortened(self.backend)}")
        if self.image_format is not None and self.image_format not in FORMATS:
            raise ValueError(f"image_format must be one of {joined_names(sorted(FORMATS))}, got {self.image_format!r}")
        if not isinstance(self.provenance, Mapping):
            raise ValueError(f"provenance must be a mapping of words to JSON values, got {shortened(self.provenance)}")
        try:
            object.__setattr__(self, "provenance", json_values(self.provenance, "provenance"))
        except CatalogError as error:
            raise ValueError(str(error)) from None
        if self.target_decibels is not None:
            numbers.decibels(self.target_decibels, "target_decibels")
        if self.sample_distance is not None and self.target_decibels is not None:
            raise ValueError("give target_decibels or sample_distance, not both: the one is chosen to reach the other")
        steps = self.sample_distance.values() if isinstance(self.sample_distance, Mapping) else [self.sample_distance]
        for step in steps:
            if step is not None:
                numbers.positive(step, "sample_distance (world units)")


def space_from(space: Space | None) -> ParameterSpace | None:
    """A parameter space, also from `{name: (low, high)}`, `{name: (low, high, unit)}` and from one or several `Parameter`.

    Raises ValueError that says what may be given.
    """
    if space is None or isinstance(space, ParameterSpace):
        return space
    if isinstance(space, Parameter):
        return ParameterSpace((space,))
    if isinstance(space, Mapping):
        return ParameterSpace(tuple(_parameter(name, bounds) for name, bounds in space.items()))
    parameters = tuple(space) if isinstance(space, Iterable) else ()
    if not parameters or not all(isinstance(parameter, Parameter) for parameter in parameters):
        raise ValueError(f"{SPACES}, got space={shortened(space)}")
    return ParameterSpace(parameters)


def _parameter(name: Any, bounds: Any) -> Parameter:
    if isinstance(bounds, Parameter):
        if bounds.name != name:
            raise ValueError(f"space names parameter {bounds.name!r} {name!r}: give it one name")
        return bounds
    if isinstance(bounds, str) or not isinstance(bounds, Iterable):
        bounds = (bounds,)
    values = tuple(bounds)
    if len(values) not in (2, 3):
        raise ValueError(f"{SPACES}, got {shortened(values)} for {name!r}")
    return Parameter(name, *values)


def appearances_from(appearances: Appearance | Iterable[Appearance] | None) -> tuple[Appearance, ...] | None:
    """One appearance or several, as a tuple; raises ValueError with the remedy for what is none, or can't be rendered."""
    if appearances is None:
        return None
    several = isinstance(appearances, Iterable) and not isinstance(appearances, str | bytes | Mapping)
    chosen: tuple[Any, ...] = tuple(appearances) if several else (appearances,)  # type: ignore[arg-type]
    for appearance in chosen:
        if isinstance(appearance, TransferFunction):
            raise ValueError(
                "a TransferFunction is not yet an appearance: say how it shows the field and what that is called, "
                f'VolumeRendering("dvr", {shortened(appearance)})'
            )
        if isinstance(appearance, Family):
            raise ValueError(
                "a family is a variation and its appearances: pass appearances=[base, *family.appearances] and "
                "variations=[family.variation]"
            )
        if isinstance(appearance, ImportedImages):
            raise ValueError(
                f"appearance {appearance.name!r} is of images made elsewhere, none can be rendered with it"
            )
        if not isinstance(appearance, VolumeRendering | Isosurface | PluginAppearance | MissingAppearance):
            raise ValueError(
                "appearances must be VolumeRendering(name, transfer_function), Isosurface(name, isovalue) or several of "
                f"them, got {shortened(appearance)}"
            )
    check_present(chosen)
    return chosen


def variations_from(variations: Iterable[Variation] | None) -> tuple[Variation, ...] | None:
    """Variations as a tuple; raises ValueError for what is none."""
    if variations is None:
        return None
    chosen = tuple(variations) if isinstance(variations, Iterable) else (variations,)
    for variation in chosen:
        if not isinstance(variation, Variation):
            remedy = ": pass its .variation" if isinstance(variation, Family) else ""
            raise ValueError(f"variations must be Variation objects, got {shortened(variation)}{remedy}")
    return chosen


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
    """Measurements of one member's fields, or of several members', that the plan of a new catalog needs.

    Attributes
    ----------
    bounds : world box that holds the field.
    ranges : smallest and largest finite value by field, "" for a single one without a name.
    distances : by volume rendering, the sample distance that reaches the target; empty where it is given.
    notes : what the user should know of them.
    quantities : what the fields say of their names and units.
    changes : by volume rendering that was measured, how much the field it was measured on changes from sample to sample, as the
        transfer function shows it (`render.steepness.mean_change`).
    backends : by appearance, what draws it.
    """

    bounds: Box
    ranges: Mapping[str, tuple[float, float]]
    distances: Mapping[str, SampleDistance] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    changes: Mapping[str, float] = field(default_factory=dict)
    backends: Mapping[str, str] = field(default_factory=dict)


def measure_pilot(fields: MemberFields, options: PlanOptions) -> Pilot:
    """Measure one member: its box, its ranges and, unless given, the sample distances that its pictures need."""
    from render.views import check_sizes

    _, appearances = check_complete(options)
    bounds = options.bounds or fields.box
    check_inside(fields.box, bounds)
    volumes = [a for a in appearances if isinstance(a, VolumeRendering)]
    cameras = cameras_around(bounds, options.views or ViewPlan())
    backends = backends_of(fields, appearances, options.backend)
    check_sizes([a for a in appearances if backends.get(a.name) == "vtk"], cameras)
    check_steps(options.sample_distance, bounds)
    if options.sample_distance is not None or not volumes:
        return Pilot(bounds, fields.ranges, quantities=fields.quantities, backends=backends)
    variations, target = options.variations or (), options.target_decibels or TARGET_DECIBELS
    distances = measured_distances(fields, appearances, variations, cameras, target, backends)
    return Pilot(
        bounds,
        fields.ranges,
        finest_of_families(distances, appearances, variations),
        tuple(distance.note for distance in distances.values() if distance.note),
        fields.quantities,
        {name: distance.change for name, distance in distances.items()},
        backends,
    )


def check_steps(distance: float | Mapping[str, float] | None, bounds: Box) -> None:
    """Raise ValueError for a step of rays that is longer than the box, or that rays would need too many of."""
    longest = math.dist(*bounds)
    for step in distance.values() if isinstance(distance, Mapping) else [distance]:
        if step is not None and not longest / MOST_STEPS <= step <= longest:
            raise ValueError(
                f"sample_distance = {step:g} does not fit the box, which is {longest:g} across: the step of rays, in world units, "
                f"lies between {longest / MOST_STEPS:.3g} and {longest:.3g}"
            )


def combine_pilots(pilots: Sequence[Pilot]) -> Pilot:
    """One pilot for all: the box around their boxes, the widest ranges, the finest sample distances."""
    return Pilot(
        box_around([p.bounds for p in pilots]),
        {
            name: (min(p.ranges[name][0] for p in pilots), max(p.ranges[name][1] for p in pilots))
            for name in pilots[0].ranges
        },
        {name: min((p.distances[name] for p in pilots), key=lambda d: d.distance) for name in pilots[0].distances},
        quantities=pilots[0].quantities,
        changes={name: max(p.changes[name] for p in pilots) for name in pilots[0].changes},
        backends=pilots[0].backends,
    )


def check_complete(options: PlanOptions) -> tuple[ParameterSpace, tuple[Appearance, ...]]:
    """The space and appearances that a new catalog needs; raises ValueError without them: no field can stand in."""
    if options.space is None or not options.appearances:
        missing = "space" if options.space is None else "appearances"
        raise ValueError(
            f"a new catalog needs {missing}=, because what is fixed for the ensemble cannot come from its first member "
            "(`insitu probe` suggests a transfer function)"
        )
    for name in options.space.names:
        tidy = "".join(c if c.isprintable() else " " for c in name).strip()
        if name != tidy:
            raise ValueError(
                f"parameter {name!r} has blanks around its name, or signs in it that nobody sees: call it {tidy or 'x'!r}"
            )
    check_fields(options.appearances)
    quantities_of(options.fields, shown_fields(options.appearances))
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
        **({"backends": dict(pilot.backends)} if pilot.backends else {}),
    }
    if options.sample_distance is not None:
        provenance["sample_distances"] = given_distances(options.sample_distance, appearances)
    elif pilot.distances:
        provenance["target_decibels"] = options.target_decibels or TARGET_DECIBELS
        provenance["sample_distances"] = {name: float(d.distance) for name, d in pilot.distances.items()}
        provenance["measured_decibels"] = {
            name: round(min(float(d.decibels), BEST_DECIBELS), 2) for name, d in pilot.distances.items()
        }
        provenance["measured_changes"] = {name: float(f"{change:.4g}") for name, change in pilot.changes.items()}
    return CatalogPlan(
        space=space,
        appearances=appearances,
        cameras=cameras_around(pilot.bounds, views),
        view_splits=views.splits(),
        bounds=pilot.bounds,
        image_format=options.image_format or "png",
        provenance=provenance,
        variations=options.variations or (),
        quantities={**pilot.quantities, **quantities_of(options.fields, shown_fields(appearances))},
    )


def _value_ranges(pilot: Pilot, appearances: Sequence[Appearance]) -> dict[str, Any]:
    """The ensemble's fixed range of values, or the range of each of several fields, as a plan records them."""
    names = shown_fields(appearances)
    by = {f: list(value_range([a for a in appearances if field_of(a) == f], pilot.ranges[f])) for f in names}
    return {"value_ranges": by} if len(by) > 1 else {"value_range": next(iter(by.values()))}


def is_catalog(path: Path) -> bool:
    """True if there is a catalog at `path`; one whose creation was interrupted does not count."""
    return (path / "catalog.json").is_file()


def given_distances(distance: float | Mapping[str, float], appearances: Sequence[Appearance]) -> dict[str, float]:
    """The sample distance of each volume rendering; raises ValueError where a mapping names others."""
    names = [a.name for a in appearances if isinstance(a, VolumeRendering)]
    if not isinstance(distance, Mapping):
        return {name: float(distance) for name in names}
    if set(distance) != set(names):
        raise ValueError(
            f"sample_distance must name the volume renderings {joined_names(names)}, got {joined_names(sorted(distance))}"
        )
    return {name: float(distance[name]) for name in names}


def _software() -> dict[str, str]:
    versions = {}
    for package in ("gs-surrogate", "vtk", "numpy"):
        with suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions
