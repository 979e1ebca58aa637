"""A member's scalar fields, under the names by which appearances show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from catalogs.store.coarse import CoarseField
from catalogs.store.plan import CatalogPlan
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, check_fields, field_of, shown_fields
from catalogs.vocabulary.numbers import finite
from catalogs.vocabulary.quantity import Quantity
from catalogs.vocabulary.words import joined_names
from insitu.fields.boxes import Box, box_of, same_box
from insitu.fields.coarse import coarse_fields
from insitu.fields.location import FieldLocation
from insitu.fields.summarize import FieldPart, summarize_shown
from render.datasets import to_grid
from render.xarray_fields import chosen as one_of_set
from render.xarray_fields import is_labelled, is_labelled_set

if TYPE_CHECKING:
    from render.grids import Grid
    from render.quality import Drawable


class MemberFields(Protocol):
    """The fields of a member, be they in this process or in the blocks of several."""

    @property
    def box(self) -> Box:
        """The world box that they all fill."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user on how their samples were made."""

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """Smallest and largest finite value by name."""

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """The names and units that the data state."""

    def backend(self, appearance: Appearance, wanted: str, usual: str) -> str:
        """The way in which an appearance is drawn, see `render.backends.backend_of`."""

    def drawable(self, appearance: Appearance, backend: str) -> Drawable:
        """The field that an appearance shows, to be drawn in that way."""

    def summaries(self, names: Sequence[str], plan: CatalogPlan) -> dict[str, FieldSummary]:
        """The summaries of the fields of these names, which the catalog stores."""

    def coarse(self, names: Sequence[str]) -> dict[str, CoarseField]:
        """The coarse fields of these names, but those that would be all holes."""


class MemberInput(Protocol):
    """A member's field that nobody has looked at yet."""

    def take(self, appearances: Sequence[Appearance], all_appearances: Sequence[Appearance]) -> MemberFields:
        """The fields that `appearances` show; `all_appearances` are all of the catalog's.  Raises as `as_fields` does."""


@dataclass(frozen=True, eq=False)
class Fields:
    """The fields of one member, all on the same points.

    Attributes
    ----------
    grids : by name, at least one, in the order in which appearances show them; "" is the single field that they do not name.
    quantities : the names and units that the data state, likewise by name; of some, of all, or of none.
    """

    grids: Mapping[str, Grid]
    quantities: Mapping[str, Quantity] = field(default_factory=dict)

    @property
    def box(self) -> Box:
        """The world box that they all fill."""
        return box_of(next(iter(self.grids.values())))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user on how their samples were made."""
        return tuple(dict.fromkeys(note for grid in self.grids.values() for note in grid.notes))

    def shown_by(self, appearance: Appearance) -> Grid:
        """The field that an appearance shows."""
        return self.grids[field_of(appearance)]

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """Smallest and largest finite value by name."""
        return {name: grid.range for name, grid in self.grids.items()}

    def backend(self, appearance: Appearance, wanted: str, usual: str) -> str:
        """See `MemberFields`."""
        from render.backends import backend_of

        return backend_of(self.shown_by(appearance), appearance, wanted, usual)

    def drawable(self, appearance: Appearance, backend: str) -> Drawable:
        """See `MemberFields`."""
        from render.quality import WholeField

        return WholeField(self.shown_by(appearance), backend or "auto")

    def summaries(self, names: Sequence[str], plan: CatalogPlan) -> dict[str, FieldSummary]:
        """See `MemberFields`."""
        return summarize_shown({name: FieldPart.all_of(self.grids[name]) for name in names}, plan)

    def coarse(self, names: Sequence[str]) -> dict[str, CoarseField]:
        """See `MemberFields`."""
        return coarse_fields({name: FieldPart.all_of(self.grids[name]) for name in names})


@dataclass(frozen=True, eq=False)
class LocalField:
    """A member's field in this process, as the caller gave it: `data`, or a function that returns them, and their place."""

    data: Any
    location: FieldLocation = FieldLocation()  # noqa: RUF009 - frozen

    def take(self, appearances: Sequence[Appearance], all_appearances: Sequence[Appearance]) -> Fields:
        """See `MemberInput`."""
        return as_fields(self.loaded, appearances, self.location, all_appearances=all_appearances)

    @property
    def lacks_spacing(self) -> bool:
        """True if the values are in arrays, and nobody says how far apart."""
        first = next(iter(self.data.values()), None) if type(self.data) is dict else self.data
        return self.location.spacing is None and isinstance(first, np.ndarray)

    @property
    def loaded(self) -> Any:
        """The data, from the function where there is one."""
        return self.data() if callable(self.data) else self.data


def as_fields(
    data: Any,
    appearances: Sequence[Appearance],
    location: FieldLocation = FieldLocation(),  # noqa: B008 - frozen
    *,
    all_appearances: Sequence[Appearance] | None = None,
) -> Fields:
    """The fields that `appearances` show of a member.

    Parameters
    ----------
    data : one field, anything that `to_grid` takes; or several of them by name, all of one shape and place.  Of a pyvista or VTK
        data set or an xarray.Dataset the names of the fields choose arrays, each loaded when its turn comes.  `Fields` are
        returned as they are.
    appearances : those that the member is shown with.
    location : where all of them lie.
    all_appearances : all of the catalog's, by default the same; a mapping may hold what one of these shows.

    Raises ValueError or TypeError, naming the field and the appearance that shows it, where a field is missing, of another shape
    or place, or not acceptable.  Raises ValueError where a mapping holds a field that none shows, or several unnamed ones.
    """
    if isinstance(data, Fields):
        return data
    check_fields(all_appearances or appearances)
    names = shown_fields(appearances) or ("",)
    several = isinstance(data, Mapping) and not is_labelled_set(data)
    if several:
        check_names(list(data), appearances, all_appearances or appearances)
    elif names != ("",):
        _check_nameable(data, appearances, location.array)
    grids, quantities = {}, {}
    for name in names:
        dataset = data if not several else data[name] if name else next(iter(data.values()))
        chosen = location.array if several or is_labelled(dataset) else name or location.array
        try:
            if is_labelled_set(dataset):
                dataset, chosen = one_of_set(dataset, chosen), None
            grids[name] = to_grid(
                dataset,
                spacing=location.spacing,
                origin=location.origin,
                array=chosen,
                dims=location.dims,
                nan=location.nan,
                warn=False,
            )
        except (TypeError, ValueError) as error:
            if not name:
                raise
            kind = TypeError if isinstance(error, TypeError) else ValueError
            raise kind(f"field {name!r}, which {_shows(name, appearances)} shows: {error}") from error
        quantities[name] = quantity_of(dataset)
    _check_same_points(grids)
    return Fields(grids, {name: quantity for name, quantity in quantities.items() if quantity})


def check_names(names: Sequence[Any], appearances: Sequence[Appearance], all_appearances: Sequence[Appearance]) -> None:
    """Raise ValueError unless the fields called `names` are all that `appearances` show, and only what `all_appearances` do."""
    if not names or not all(isinstance(name, str) and name for name in names):
        raise ValueError(
            f"the fields of a member are held by name, {{'speed': array}}, got the names {joined_names(names)}"
        )
    wanted, possible = shown_fields(appearances), shown_fields(all_appearances)
    if possible in ((), ("",)):
        if len(names) > 1:
            raise ValueError(
                f"the member has the fields {joined_names(names)}, but appearance {_shows('', all_appearances)} does not "
                f"say which of them it shows: "
                f"give every appearance its field, such as field={names[0]!r}, or pass one field alone"
            )
        return
    for name in wanted:
        if name not in names:
            raise ValueError(
                f"appearance {_shows(name, appearances)} shows the field {name!r}, but the member has {joined_names(names)}: "
                "add it, or let the appearance name one of these"
            )
    unused = [name for name in names if name not in possible]
    if unused:
        raise ValueError(
            f"the member has the fields {joined_names(unused)}, which no appearance shows (they show "
            f"{joined_names(possible)}): leave them out, or add an "
            f"appearance with field={unused[0]!r}"
        )


def quantity_of(data: Any) -> Quantity:
    """The name and the unit that one field states: a `Field` by itself, labelled arrays by their name and `attrs["units"]`."""
    attributes = getattr(data, "attrs", None)
    unit = getattr(data, "unit", None) or (attributes.get("units") if isinstance(attributes, Mapping) else None)
    said = [value if isinstance(value, str) else "" for value in (getattr(data, "name", None), unit)]
    return Quantity(*(value if value.strip().isprintable() else "" for value in said))


def time_of(data: Any) -> float | None:
    """The simulation time that a field, or the first of several, states; None where it does not."""
    several = isinstance(data, Mapping) and not is_labelled_set(data)
    time: Any = getattr(next(iter(data.values()), None) if several else data, "time", None)
    if hasattr(time, "dtype") and (np.size(time) != 1 or time.dtype.kind not in "fiu"):
        return None  # a date, or several times
    try:
        return None if time is None else finite(time, "time")
    except ValueError:  # a date, or no single time
        return None


def _check_nameable(data: Any, appearances: Sequence[Appearance], array: str | None) -> None:
    """Raise ValueError unless the names of fields say what to take of `data`."""
    name, *others = shown_fields(appearances)
    if is_labelled(data) and data.name == name and not others:
        return
    if not hasattr(data, "GetClassName") and not is_labelled_set(data):
        raise ValueError(
            f"appearance {_shows(name, appearances)} shows the field {name!r}, but the member is one {type(data).__name__} without "
            f"a name: pass {{{name!r}: ...}}, or a data set with an array of this name"
        )
    if array is not None:
        raise ValueError(
            f"array={array!r} would choose one array, but appearance {_shows(name, appearances)} names the field {name!r}, which "
            "is the array that it shows: leave array out"
        )


def _check_same_points(grids: Mapping[str, Grid]) -> None:
    (first, grid), *others = grids.items()
    for name, other in others:
        if other.shape != grid.shape or not same_box(box_of(other), box_of(grid)):
            raise ValueError(
                f"the fields of a member share shape, spacing and origin, but {name!r} is {_place(other)} and {first!r} is "
                f"{_place(grid)}: resample one of them, or render it into a catalog of its own"
            )


def _place(grid: Grid) -> str:
    nz, ny, nx = grid.shape
    low, high = (tuple(f"{x:.6g}" for x in corner) for corner in box_of(grid))
    return f"{nx} x {ny} x {nz} from ({', '.join(low)}) to ({', '.join(high)})"


def _shows(field: str, appearances: Sequence[Appearance]) -> str:
    """The name of the first appearance that shows a field."""
    return next((a.name for a in appearances if field_of(a) == field), "")
