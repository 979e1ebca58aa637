"""The plan of an ensemble, fixed before its first member is written: the contents of `catalog.json`."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catalogs.files import cinema, durable
from catalogs.files.images import FORMATS
from catalogs.files.packed import PACK
from catalogs.vocabulary.appearance import (
    Appearance,
    Isosurface,
    appearance_from_json,
    appearance_to_json,
    check_fields,
    field_of,
    shown_fields,
)
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import color, row
from catalogs.vocabulary.parameters import SPLITS, ParameterSpace
from catalogs.vocabulary.quantity import Quantity, quantities_from, quantities_of
from catalogs.vocabulary.variations import ISOVALUE, Variation, VariationSetting, variation_from_json
from catalogs.vocabulary.words import joined_names, shortened

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+=-]{0,99}")
PACKED = "packed"  # layout with one file of images per member
RESERVED_NAMES = (
    "member.json",
    "rows.csv",
    "cameras.json",
    "field.npz",
    "coarse.npz",
    PACK,
)  # in a member's folder, beside images
CHANGED = "it is not as it was written (its digest differs)"
ACCEPT = "if you changed it on purpose, `catalogs check --accept` takes it as it is"
VIEW_COLUMNS = ("member", "view", "phi", "theta", "split", "member_split", "view_split")


class CatalogError(ValueError):
    """A catalog can't be created, read or written; the message names the place and the remedy.

    Examples
    --------
    >>> from catalogs import Catalog, CatalogError
    >>> try:
    ...     Catalog.open("absent.cdb")
    ... except CatalogError as error:
    ...     print(error)
    absent.cdb/catalog.json is missing: is absent.cdb a catalog made by gs-surrogate?
    """


@dataclass(frozen=True)
class CatalogPlan:
    """Everything that is fixed for the whole ensemble before its first member.

    Attributes
    ----------
    space : the simulation parameters.
    appearances : the visualization parameters, each with its own name.
    cameras : shared by all members; () where every member has its own.
    view_splits : "train", "validation" or "test" per camera.
    bounds : world box (low, high) of the volume.
    background : None for images with alpha; else the RGB colour in [0, 1] behind opaque images.
    image_format : "png" (8 bits) or "exr" (float32).
    provenance : JSON values: software, sample distances, scene.
    variations : the appearances that sample visualization parameters.
    quantities : names and units of the shown fields, by the names in `fields`; for some, all or none of them.
    packed : True where each member's images are in one HDF5 file (`catalogs.files.packed`); such a catalog is read-only.
    digest : of the contents of the `catalog.json` that this plan was read from, provenance aside; "" for a plan not stored yet.

    Examples
    --------
    >>> from blobs import make_run
    >>> from catalogs import Catalog
    >>> plan = Catalog.open(make_run() / "blobs.cdb").plan
    >>> plan.space.names, len(plan.cameras), plan.view_splits.count("train")
    (('separation', 'width'), 12, 5)
    >>> plan.bounds
    ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    """

    space: ParameterSpace
    appearances: tuple[Appearance, ...]
    cameras: tuple[Camera, ...]
    view_splits: tuple[str, ...]
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    background: tuple[float, float, float] | None = None
    image_format: str = "png"
    provenance: Mapping[str, Any] = field(default_factory=dict)
    variations: tuple[Variation, ...] = ()
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    packed: bool = False
    digest: str = field(default="", compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "provenance", json_values(self.provenance, "provenance"))
        names = self.appearance_names
        if not names or len(set(names)) != len(names):
            raise CatalogError(f"a catalog needs appearances with unique names, got {joined_names(names)}")
        for problem in filter(None, map(name_problem, names)):
            raise CatalogError(f"invalid appearance name: {problem}")
        try:
            object.__setattr__(self, "bounds", _box(self.bounds))
            if self.background is not None:
                object.__setattr__(self, "background", color(self.background, "background"))
            check_fields(self.appearances)
            object.__setattr__(self, "quantities", quantities_of(quantities_from(self.quantities), self.fields))
        except ValueError as error:
            raise CatalogError(str(error)) from None
        _check_variations(self.variations, self.appearances)
        _check_parameter_names(self.space, self.variations)
        object.__setattr__(self, "variations", self.in_field_units(self.variations))
        if self.cameras or self.view_splits:
            check_views(self.cameras, self.view_splits)
        if self.image_format not in FORMATS:
            raise CatalogError(
                f"image_format must be one of {joined_names(sorted(FORMATS))}, got {self.image_format!r}"
            )
        problems = cinema.header_problems(self.header)
        if problems:
            raise CatalogError(f"these columns would break Cinema specification D: {'; '.join(problems)}")

    def __repr__(self) -> str:
        views = f"{len(self.cameras) or 'own'} views"
        return f"<CatalogPlan of {self.space}; {views} of {shortened(self.appearance_names)}>"

    @property
    def appearance_names(self) -> list[str]:
        return [appearance.name for appearance in self.appearances]

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the shown fields in the order of the appearances; ("",) for a single unnamed field."""
        return shown_fields(self.appearances)

    def quantity(self, field: str = "") -> Quantity:
        """Name and unit of a shown field, by default of the first; empty where not recorded."""
        name = field or (self.fields[0] if self.fields else "")
        return self.quantities.get(name, Quantity(name))

    def field_label(self, field: str = "") -> str:
        """Axis label of a shown field, such as "Q (1/s²)"; "" where name and unit are not recorded."""
        return str(self.quantity(field))

    def in_field_units(self, variations: Sequence[Variation]) -> tuple[Variation, ...]:
        """Variations of this catalog's appearances, with the units of the fields that they show."""
        fields = {appearance.name: field_of(appearance) for appearance in self.appearances}
        return tuple(v.with_unit(self.quantity(fields[v.settings[0].appearance]).unit) for v in variations)

    @property
    def header(self) -> list[str]:
        """The labels of the table's columns, in order."""
        return [*self.parameter_labels, *self._other_labels]

    @property
    def parameter_labels(self) -> list[str]:
        """The labels of the parameters' columns: their names, or "parameter_theta" where that has another meaning."""
        return cinema.parameter_labels(self.space.names, self._other_labels)

    @property
    def _other_labels(self) -> list[str]:
        return ["appearance", *self.varied_names, *VIEW_COLUMNS, "FILE"]

    @property
    def varied_names(self) -> list[str]:
        """The visualization parameters with a column in the table; first the isovalue, if a surface is shown."""
        isovalue = [ISOVALUE] * any(isinstance(appearance, Isosurface) for appearance in self.appearances)
        varied = [name for variation in self.variations if variation.continuous for name in variation.space.names]
        return list(dict.fromkeys([*isovalue, *varied]))

    def setting(self, appearance: str) -> VariationSetting | None:
        """The variation setting of this appearance; None for a base, and for an appearance outside variations."""
        return next(filter(None, (variation.setting(appearance) for variation in self.variations)), None)

    def varied(self, appearance: str) -> dict[str, float]:
        """The values of `varied_names` for an appearance, by name; zero where it has none."""
        values = dict.fromkeys(self.varied_names, 0.0)
        for surface in (a for a in self.appearances if isinstance(a, Isosurface) and a.name == appearance):
            values[ISOVALUE] = float(surface.isovalue)
        for variation in (v for v in self.variations if v.continuous):
            setting = variation.setting(appearance)
            values |= dict(zip(variation.space.names, setting.values, strict=True)) if setting else {}
        return values

    @property
    def plain_appearances(self) -> tuple[Appearance, ...]:
        """The appearances outside continuous variations."""
        varied = {s.appearance for v in self.variations if v.continuous for s in v.settings}
        return tuple(a for a in self.appearances if a.name not in varied)

    def image_name(self, appearance: str, view: int) -> str:
        """Path of an image, relative to its member's folder."""
        return f"{appearance}/{view:03d}{FORMATS[self.image_format]}"

    def file_name(self, appearance: str, view: int) -> str:
        """Path of the file that holds an image, relative to its member's folder: its own, or the member's pack."""
        return PACK if self.packed else self.image_name(appearance, view)

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
            **({"variations": [v.to_json() for v in self.variations]} if self.variations else {}),
            **({"layout": PACKED} if self.packed else {}),
            **({"fields": {name: q.to_json() for name, q in self.quantities.items()}} if self.quantities else {}),
        }

    @classmethod
    def from_json(cls, record: Mapping[str, Any], *, digest: str = "") -> CatalogPlan:
        """The plan of a `to_json` record, which has this digest.

        Unknown keys are ignored, since changes of meaning raise the schema; inside appearances and parameters they are errors.
        """
        if record.get("layout") not in (None, PACKED):
            raise ValueError(f"its layout is {record['layout']!r}")
        return cls(
            space=ParameterSpace.from_json(record["parameters"]),
            appearances=tuple(appearance_from_json(a, missing=True) for a in record["appearances"]),
            cameras=tuple(Camera.from_json(c) for c in record["cameras"]),
            view_splits=tuple(record["view_splits"]),
            bounds=record["bounds"],
            background=record["background"],
            image_format=record["image_format"],
            provenance=record.get("provenance", {}),
            variations=tuple(variation_from_json(v) for v in record.get("variations", ())),
            quantities=record.get("fields", {}),
            packed=record.get("layout") == PACKED,
            digest=digest,
        )

    def check_recordable(self) -> None:
        """Raise CatalogError unless this plan survives a round trip through JSON."""
        try:
            again = CatalogPlan.from_json(json.loads(json.dumps(self.to_json(), allow_nan=False)))
        except (KeyError, TypeError, ValueError) as error:
            raise CatalogError(f"this plan can't be recorded: {error}") from error
        if differing := again.differences(self):
            raise CatalogError(f"this plan can't be recorded: {', '.join(differing)} would be read differently")

    def differences(self, other: CatalogPlan) -> list[str]:
        """Keys of `to_json` that differ, provenance aside."""
        mine, theirs = json.loads(json.dumps(self.to_json())), json.loads(json.dumps(other.to_json()))
        return [key for key in {**mine, **theirs} if key != "provenance" and mine.get(key) != theirs.get(key)]


def _check_variations(variations: Sequence[Variation], appearances: Sequence[Appearance]) -> None:
    """Raise CatalogError unless the variations differ in kind and every setting agrees with its appearance."""
    kinds = [variation.kind for variation in variations]
    if len(set(kinds)) != len(kinds):
        raise CatalogError(f"a catalog takes one variation of each kind, got {kinds}")
    settings = [setting.appearance for variation in variations for setting in variation.settings]
    unknown = sorted({*settings, *(variation.base for variation in variations)} - {a.name for a in appearances})
    twice = sorted(name for name, count in Counter(settings).items() if count > 1)
    if unknown or twice:
        raise CatalogError(
            "every setting of a variation, and its base, must be an appearance of the catalog and occur once; unknown: "
            f"{shortened(unknown) or 'none'}; repeated: {shortened(twice) or 'none'}"
        )
    wrong = [problem for variation in variations for problem in variation.mismatches(appearances)]
    if wrong:
        raise CatalogError(f"appearances contradict their variation: {'; '.join(wrong[:3])}")


def _check_parameter_names(space: ParameterSpace, variations: Sequence[Variation]) -> None:
    """Raise CatalogError where a simulation parameter and a visualization parameter of a variation have one name."""
    for variation in variations:
        if shared := [name for name in space.names if name in variation.argument_names]:
            raise CatalogError(
                f"the simulation parameter {shared[0]!r} has the name of a visualization parameter of this catalog's "
                f"{variation.plural}: call it otherwise, such as {shared[0] + '_of_run'!r}"
            )


def check_views(cameras: Sequence[Camera], view_splits: Sequence[str]) -> None:
    """Raise CatalogError unless every camera has a valid split."""
    if len(cameras) != len(view_splits):
        raise CatalogError(f"{len(cameras)} cameras need as many splits, got {len(view_splits)}")
    unknown = sorted(set(view_splits) - set(SPLITS))
    if unknown:
        raise CatalogError(f"a view's split must be one of {joined_names(SPLITS)}, got {joined_names(unknown)}")


def name_problem(name: str) -> str | None:
    """The reason why a member or an appearance can't have this name, a folder and a cell of the table; None for a valid one."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        return f"a name must be 1 to 100 letters, digits and _.+=-, a letter or digit first, got {name!r}"
    if cinema.reads_as_number(name):
        return f"{name!r} would be read as a number by Cinema viewers: put a letter first"
    if name in RESERVED_NAMES:
        return f"{name!r} is a reserved name"
    return None


def json_values(values: Mapping[str, Any], what: str) -> dict[str, Any]:
    """A copy of `values` after a round trip through JSON; raises CatalogError naming `what` for values beyond JSON."""
    try:
        return json.loads(json.dumps(dict(values), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise CatalogError(f"{what} must hold JSON values (words, finite numbers, lists, tables): {error}") from error


def read_json(path: Path, kind: type = dict) -> Any:
    """Contents of a JSON file; raises CatalogError naming it where it is absent, damaged, or not of `kind`."""
    return parsed_json(path, read_bytes(path), kind)


def read_bytes(path: Path) -> bytes:
    """Contents of a file of a catalog; raises CatalogError naming it where it is absent or not a regular file."""
    try:
        return durable.read(path)
    except FileNotFoundError:
        raise CatalogError(f"{path} is missing: is {path.parent} a catalog made by gs-surrogate?") from None
    except durable.SpecialFileError as error:
        raise CatalogError(str(error)) from None


def parsed_json(path: Path, data: bytes, kind: type = dict) -> Any:
    """JSON values from the contents of the file `path`; raises CatalogError naming it where they are damaged or not of `kind`."""
    try:
        record = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise CatalogError(f"{path} is damaged: {error}") from error
    if not isinstance(record, kind):
        raise CatalogError(f"{path} is damaged: it must hold a {kind.__name__}")
    return record


def _box(bounds: Any) -> tuple[tuple[float, ...], ...]:
    corners = (
        tuple(row(corner, 3, "each corner of bounds") for corner in bounds) if isinstance(bounds, Iterable) else ()
    )
    if len(corners) != 2 or not all(a < b for a, b in zip(*corners, strict=True)):
        raise ValueError(f"bounds must be two corners low < high of three finite numbers, got {bounds}")
    return corners
