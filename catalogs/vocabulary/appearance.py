"""Appearances of a field: transfer functions, volume renderings and isosurfaces.

Colours are straight (not premultiplied) RGB in [0, 1].  Values are in the field's physical units and fixed for the whole
ensemble, so that equal colours mean equal values in every image.

Every constructor raises ValueError naming the appearance, the argument and its value; numpy's numbers become plain ones.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from reprlib import repr as shortened
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.plugins import APPEARANCES, plugins
from catalogs.vocabulary import numbers
from catalogs.vocabulary.plugin_appearance import MissingAppearance, PluginAppearance, plugin_kind
from catalogs.vocabulary.words import check_keys, joined_names, keys_of


@dataclass(frozen=True)
class TransferFunction:
    """Piecewise-linear colour and opacity over field values, constant beyond the end points.

    Attributes
    ----------
    color_points : (value, red, green, blue) per control point, values strictly increasing.
    opacity_points : (value, opacity) per control point, values strictly increasing, opacity in [0, 1].
    opacity_unit_distance : the path length, in world units, over which a homogeneous medium has the stated
        opacity: a step of length s has opacity 1 - (1 - opacity)**(s / opacity_unit_distance).

    Examples
    --------
    >>> from catalogs import TransferFunction
    >>> heat = TransferFunction(
    ...     color_points=((0, 0, 0, 1), (10, 1, 0, 0)), opacity_points=((2, 0), (10, 0.8)), opacity_unit_distance=0.1
    ... )
    >>> heat.opacities([2, 6, 10]).tolist()
    [0.0, 0.4, 0.8]
    >>> heat.colors([5]).tolist()
    [[0.5, 0.0, 0.5]]
    """

    color_points: tuple[tuple[float, float, float, float], ...]
    opacity_points: tuple[tuple[float, float], ...]
    opacity_unit_distance: float

    def __post_init__(self) -> None:
        distance = numbers.positive(self.opacity_unit_distance, "opacity_unit_distance")
        object.__setattr__(self, "color_points", _points("color_points", self.color_points, 4))
        object.__setattr__(self, "opacity_points", _points("opacity_points", self.opacity_points, 2))
        object.__setattr__(self, "opacity_unit_distance", distance)

    def __repr__(self) -> str:
        low, high = self.bounds
        points = f"{len(self.color_points)} colour and {len(self.opacity_points)} opacity points"
        return f"<TransferFunction over [{low:g}, {high:g}]: {points}>"

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest control point: values outside are shown like the nearest end (clipped)."""
        values = [p[0] for p in self.color_points + self.opacity_points]
        return min(values), max(values)

    def colors(self, values: ArrayLike) -> NDArray[np.float64]:
        """Straight RGB (..., 3) at field `values` (...)."""
        places, *channels = np.array(self.color_points).T  # [P], 3 of [P]
        return np.stack([np.interp(np.asarray(values, dtype=np.float64), places, c) for c in channels], axis=-1)

    def opacities(self, values: ArrayLike) -> NDArray[np.float64]:
        """Opacity per `opacity_unit_distance` (...) at field `values` (...)."""
        return np.interp(np.asarray(values, dtype=np.float64), *np.array(self.opacity_points).T)


@dataclass(frozen=True)
class VolumeRendering:
    """Direct volume rendering of a field under a transfer function; `shaded` lights it by its gradient.

    `field` names the shown field; "" for members of a single field.

    Examples
    --------
    >>> from blobs import CAMERA, PLACE, simulate
    >>> from catalogs import TransferFunction, VolumeRendering
    >>> from render import render_views, to_grid
    >>> heat = TransferFunction(((0, 0, 0, 1), (1, 1, 0, 0)), ((0.1, 0), (1, 0.8)), opacity_unit_distance=0.1)
    >>> lit = VolumeRendering("lit", heat, shaded=True)
    >>> (picture,) = render_views(to_grid(simulate(0.8, 0.3), **PLACE), lit, [CAMERA])
    """

    name: str
    transfer_function: TransferFunction
    shaded: bool = False
    field: str = ""

    def __post_init__(self) -> None:
        what = _called(self)
        _check_field(self.name, self.field)
        if not isinstance(self.transfer_function, TransferFunction):
            raise ValueError(
                f"{what}: transfer_function must be a TransferFunction, got {shortened(self.transfer_function)}"
            )
        if not isinstance(self.shaded, bool | np.bool_):
            raise ValueError(f"{what}: shaded must be True or False, got {shortened(self.shaded)}")
        object.__setattr__(self, "shaded", bool(self.shaded))


@dataclass(frozen=True)
class Isosurface:
    """The surface where a field equals `isovalue`, lit by a headlight (Phong: ambient, diffuse, specular, each from 0 on).

    `field` names the shown field; "" for members of a single field.

    Examples
    --------
    >>> from blobs import CAMERA, PLACE, simulate
    >>> from catalogs import Isosurface
    >>> from render import render_views, to_grid
    >>> surface = Isosurface("half", 0.5, color=(0.9, 0.6, 0.2))
    >>> (picture,) = render_views(to_grid(simulate(0.8, 0.3), **PLACE), surface, [CAMERA])
    >>> picture.shape
    (128, 128, 4)
    """

    name: str
    isovalue: float
    color: tuple[float, float, float] = (0.85, 0.85, 0.85)
    ambient: float = 0.15
    diffuse: float = 0.75
    specular: float = 0.2
    specular_power: float = 20.0
    field: str = ""

    def __post_init__(self) -> None:
        what = _called(self)
        _check_field(self.name, self.field)
        object.__setattr__(self, "isovalue", numbers.finite(self.isovalue, f"{what}: isovalue"))
        object.__setattr__(self, "color", numbers.color(self.color, f"{what}: color"))
        for light in ("ambient", "diffuse", "specular", "specular_power"):
            strength = numbers.finite(getattr(self, light), f"{what}: {light}")
            if strength < 0.0:
                raise ValueError(f"{what}: {light} must not be negative, got {strength:g}")
            object.__setattr__(self, light, strength)


@dataclass(frozen=True)
class ImportedImages:
    """Images of another program, described only by a `note`.

    Examples
    --------
    A catalog of pictures that another program drew:

    >>> import numpy as np
    >>> from catalogs import Catalog, CatalogPlan, ImportedImages, Parameter, ParameterSpace, orbit
    >>> cameras = tuple(orbit((0, 0, 0), 1.0, width=32, height=32, frequency=1))
    >>> space = ParameterSpace((Parameter("angle", 0, 90, "degrees"),))
    >>> plan = CatalogPlan(space, (ImportedImages("photo"),), cameras, ("train",) * 12, bounds=((-1,) * 3, (1,) * 3))
    >>> with Catalog.create("photos.cdb", plan).begin_member("first", {"angle": 30}, split="train") as writer:
    ...     for view in range(12):
    ...         writer.write_image("photo", view, np.zeros((32, 32, 4), np.uint8))  # premultiplied RGBA
    """

    name: str
    note: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.note, str):
            raise ValueError(f"{_called(self)}: note must be text, got {shortened(self.note)}")


Appearance = VolumeRendering | Isosurface | ImportedImages | PluginAppearance | MissingAppearance

KINDS: dict[str, Any] = {"volume": VolumeRendering, "isosurface": Isosurface, "imported": ImportedImages}


def field_of(appearance: Appearance) -> str:
    """The name of the shown field; "" for members of a single field, and for imported images."""
    return "" if isinstance(appearance, ImportedImages) else appearance.field


def shown_fields(appearances: Iterable[Appearance]) -> tuple[str, ...]:
    """Names of the shown fields, each once, in the order of the appearances; none for imported images."""
    return tuple(dict.fromkeys(a.field for a in appearances if not isinstance(a, ImportedImages)))


def check_fields(appearances: Iterable[Appearance]) -> None:
    """Raise ValueError where some appearances name their field and others do not."""
    rendered = [a for a in appearances if not isinstance(a, ImportedImages)]
    silent, named = ([a.name for a in rendered if bool(a.field) == named] for named in (False, True))
    if silent and named:
        raise ValueError(
            f"appearances {joined_names(named[:3])} name the field that they show, "
            f"{joined_names(silent[:3])} do not: where there are several fields, "
            'every appearance names its own, field = "..."'
        )


def appearance_to_json(appearance: Appearance) -> dict[str, Any]:
    """Plain JSON values with a `kind`, of `KINDS` or another package's; a `field` only where one is named.

    Raises ValueError for an appearance whose class no package registers.
    """
    if isinstance(appearance, MissingAppearance):
        return dict(json.loads(appearance.record))
    own = (kind for kind, form in KINDS.items() if isinstance(appearance, form))
    kind = next(own, "") or plugin_kind(appearance)
    values = asdict(appearance)  # type: ignore[arg-type]
    if not field_of(appearance):
        values.pop("field", None)
    return {"kind": kind, **values}


def appearance_from_json(record: Mapping[str, Any], *, missing: bool = False) -> Appearance:
    """The appearance of an `appearance_to_json` record or of a scene's `[[appearance]]` table.

    Raises ValueError naming an unknown kind, a missing or an unknown key; with `missing`, an unknown kind, which is that of a
    package that is not installed, gives a `MissingAppearance`.
    """
    values = dict(record)
    kind = values.pop("kind", None)
    forms = KINDS if kind in KINDS else {**plugins(APPEARANCES), **KINDS}
    if kind not in forms and missing and isinstance(kind, str) and isinstance(record.get("name"), str):
        return MissingAppearance(record["name"], json.dumps(record))
    if kind not in forms:
        raise ValueError(f"appearance kind must be one of {joined_names(sorted(forms))}, got {kind!r}")
    try:
        if isinstance(values.get("transfer_function"), Mapping):
            check_keys(keys_of(TransferFunction), values["transfer_function"], "transfer_function")
            values["transfer_function"] = TransferFunction(**values["transfer_function"])
        return forms[kind](**values)
    except (TypeError, ValueError) as error:
        place = f"appearance {record.get('name', '?')!r}"
        text = str(error)
        raise ValueError(text if text.startswith(place) else f"{place} of kind {kind!r}: {text}") from None


def _called(appearance: Appearance) -> str:
    """Subject of error messages about an appearance; raises ValueError unless its name is text."""
    if not isinstance(appearance.name, str) or not appearance.name:
        raise ValueError(f"the name of an appearance must be text, got {shortened(appearance.name)}")
    return f"appearance {appearance.name!r}"


def _check_field(appearance: str, field: Any) -> None:
    if not isinstance(field, str) or field != field.strip() or not field.isprintable():
        raise ValueError(
            f'appearance {appearance!r}: field must be a printable name without blanks around it, or "" for members of a '
            f"single field, got {field!r}"
        )


def _points(name: str, points: Any, width: int) -> tuple[tuple[float, ...], ...]:
    """Control points of `width` numbers each, the first of them increasing and the others in [0, 1]."""
    if isinstance(points, str | bytes) or not isinstance(points, Iterable):
        raise ValueError(f"{name} must be at least two points of {width} numbers each, got {shortened(points)}")
    rows = tuple(numbers.row(point, width, f"each of {name}") for point in points)
    if len(rows) < 2:
        raise ValueError(f"{name} must be at least two points of {width} numbers each, got {rows}")
    array = np.array(rows)  # [P, width]
    if (np.diff(array[:, 0]) <= 0).any():
        raise ValueError(f"{name} must have strictly increasing values, got {array[:, 0].tolist()}")
    if (array[:, 1:] < 0).any() or (array[:, 1:] > 1).any():
        raise ValueError(f"{name} must have colours and opacities in [0, 1], got {rows}")
    return rows
