"""Options of several commands for the source of an ensemble, and the ensemble that they open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from catalogs.store.catalog import Catalog, CatalogPlan
    from catalogs.vocabulary.appearance import Appearance
    from catalogs.vocabulary.parameters import ParameterSpace
    from catalogs.vocabulary.scene import PlannedMember, Scene
    from insitu.ensembles.files import FileEnsemble
    from insitu.fields.location import FieldLocation
    from insitu.members.planning import PlanOptions
    from insitu.readers.reader import Sampling
    from insitu.readers.stored import StoredEnsemble
    from insitu.readers.tables import MemberTable

TABLES = {".csv", ".tsv", ".txt"}
TRIPLE = (float, float, float)
PARAMETERS = click.option("--parameters", metavar="A,B", help="Arrays, attributes or columns that are the parameters.")
NAMES = click.option("--names", metavar="A,B", help="Names of the columns of one array of parameters.")
OPTIONS = (
    click.option(
        "--array",
        "--dataset",
        "--field",
        "arrays",
        multiple=True,
        help="Array that holds the field; several, one by one.  [default: those that appearances name, else the only one]",
    ),
    PARAMETERS,
    NAMES,
    click.option("--units", metavar="U,V", help="Units of the parameters."),
    click.option("--split", metavar="ARRAY", help="Array of train, validation and test."),
    click.option(
        "--bounds",
        type=(str, float, float),
        multiple=True,
        metavar="NAME LOW HIGH",
        help="Range of a parameter.  [default: as the file says, else that of the members]",
    ),
    click.option("--spacing", type=TRIPLE, metavar="X Y Z", help="Distance between values, where files do not say."),
    click.option("--origin", type=TRIPLE, metavar="X Y Z", help="Place of the first value, where files do not say."),
    click.option("--dims", metavar="z,y,x", help="What the last axes of arrays are, in the arrays' own order."),
)
CODES = (
    click.option(
        "--reader",
        metavar="CODE",
        default="",
        help="The code that wrote the files, where they don't show it: adios2, amrex, athena, cloverleaf, mpas, openpmd, store, "
        "vtk, well, xcompact3d.",
    ),
    click.option("--resolution", type=(int, int, int), metavar="X Y Z", help="Values of resampled data (amrex, mpas)."),
    click.option(
        "--interpolation",
        type=click.Choice(["nearest", "linear"]),
        help="Between cells of a mesh (mpas): the containing cell's value, or linear between their centres.  [default: nearest]",
    ),
    click.option("--mesh", type=click.Path(path_type=Path), help="File of the mesh, where the others lack it (mpas)."),
)


def code_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options that say which code wrote the files, as the keyword arguments that it takes."""
    for option in reversed(CODES):
        function = option(function)
    return function


def reading_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of `ReadingOptions`, as the keyword arguments that it takes."""
    for option in reversed((*OPTIONS, *CODES)):
        function = option(function)
    return function


@dataclass(frozen=True)
class ReadingOptions:
    """The options, as click hands them over."""

    arrays: tuple[str, ...] = ()
    parameters: str | None = None
    names: str | None = None
    units: str | None = None
    split: str | None = None
    bounds: tuple[tuple[str, float, float], ...] = ()
    spacing: tuple[float, float, float] | None = None
    origin: tuple[float, float, float] | None = None
    dims: str | None = None
    reader: str = ""
    resolution: tuple[int, int, int] | None = None
    interpolation: str | None = None
    mesh: Path | None = None
    nan: str | None = None

    @property
    def record(self) -> dict[str, dict[str, str]]:
        """The options that a catalog remembers, beside its source of fields."""
        from insitu.members.agreement import READING

        options = {name: getattr(self, name) for name in ("parameters", "names", "split", "reader", "mesh", "nan")}
        return {READING: {name: str(value) for name, value in options.items() if value}}

    def as_in(self, plan: CatalogPlan | None) -> ReadingOptions:
        """The options with those of an existing catalog where they are left out; of `insitu probe` and a new one as they are."""
        if plan is None:
            return self
        from insitu.members.agreement import READING, SOURCE

        source, chosen = plan.provenance.get(SOURCE, {}), plan.provenance.get(READING, {})
        one = (source["dataset"],) if "dataset" in source else ()
        names = {name for name, *_ in self.bounds}
        return replace(
            self,
            arrays=self.arrays or tuple(source.get("arrays") or source.get("datasets") or one),
            bounds=(*self.bounds, *((p.name, p.low, p.high) for p in plan.space.parameters if p.name not in names)),
            units=self.units or ",".join(p.unit for p in plan.space.parameters),
            spacing=self.spacing or source.get("spacing"),
            origin=self.origin or source.get("origin"),
            dims=self.dims or ",".join(source.get("dims", ())),
            resolution=self.resolution or source.get("resolution"),
            interpolation=self.interpolation or source.get("interpolation"),
            mesh=self.mesh or (Path(chosen["mesh"]) if "mesh" in chosen else None),
            reader=self.reader or chosen.get("reader", ""),
            **{name: getattr(self, name) or chosen.get(name) for name in ("parameters", "names", "split", "nan")},
        )

    def open(self, sources: Sequence[str], appearances: Any = ()) -> StoredEnsemble | FileEnsemble:
        """The ensemble of a table, a pattern, a folder, one file or several; `appearances` name its fields.

        Raises ValueError or FileNotFoundError naming what is missing.
        """
        from catalogs.vocabulary.appearance import shown_fields
        from insitu.fields.member_fields import check_names
        from insitu.readers.layout import FileMapping
        from insitu.readers.stored import StoredEnsemble

        arrays = self.arrays or tuple(filter(None, shown_fields(appearances)))
        if not self._is_one_store(sources):
            return self._files(sources, arrays)
        if ignored := self.sampling.identity:
            raise ValueError(f"{sources[0]} is not resampled: leave {', '.join(f'--{name}' for name in ignored)} out")
        mapped = FileMapping(
            arrays,
            listed(self.parameters),
            listed(self.names),
            listed(self.units),
            self.split,
            listed(self.dims) or None,
        )
        ensemble = StoredEnsemble.open(sources[0], mapped, spacing=self.spacing, origin=self.origin, bounds=self.ranges)
        if appearances:
            check_names(ensemble.fields, appearances, appearances)
        return ensemble

    def _is_one_store(self, sources: Sequence[str]) -> bool:
        """True if it is one HDF5, netCDF or Zarr file with all members, written by no code that is known."""
        from insitu.readers.arrays import is_store
        from insitu.readers.codes import reader_of

        path = Path(sources[0])
        return (
            len(sources) == 1 and is_store(path) and not is_listing(sources[0]) and reader_of(path, self.reader) is None
        )

    def _files(self, sources: Sequence[str], arrays: tuple[str, ...]) -> FileEnsemble:
        from insitu.ensembles.files import FileEnsemble
        from insitu.readers.states import members_of

        if self.names or self.split:
            raise ValueError("--names and --split are of one file that holds all members; a table has columns")
        wanted = listed(self.parameters)
        table, code = members_of(
            lambda more_in_files: self._table(sources, wanted, more_in_files),
            self.reader,
            self.sampling,
            wanted,
            arrays,
        )
        how: dict[str, Any] = {"location": self.location, "reader": code, "sampling": self.sampling}
        return FileEnsemble.of(table, bounds=self.ranges, units=listed(self.units), arrays=arrays, **how)

    def _table(self, sources: Sequence[str], wanted: Sequence[str], more_in_files: bool) -> MemberTable:
        """The files, with the parameters that a table or a pattern names; `more_in_files`: the files may state others."""
        from insitu.readers.states import dumps_below, no_ensemble, table_of_files
        from insitu.readers.tables import match_files, read_table

        if len(sources) == 1 and Path(sources[0]).suffix.lower() in TABLES:
            return read_table(sources[0], wanted, more_in_files=more_in_files)
        if len(sources) == 1 and is_listing(sources[0]):
            return match_files(sources[0], more_in_files=more_in_files)
        if not more_in_files:
            raise no_ensemble(sources[0])
        if len(sources) == 1 and Path(sources[0]).is_dir():
            return table_of_files(dumps_below(Path(sources[0]), self.reader))
        return table_of_files([Path(source) for source in sources])

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Bounds by parameter."""
        return {name: (low, high) for name, low, high in self.bounds}

    @property
    def location(self) -> FieldLocation:
        """The place of values in files that do not say."""
        from insitu.fields.location import FieldLocation

        return FieldLocation(self.spacing, self.origin, dims=listed(self.dims) or None)

    @property
    def sampling(self) -> Sampling:
        """The resampling of data that lie on no one regular grid."""
        from insitu.readers.reader import Sampling

        return Sampling(self.resolution, self.interpolation or "nearest", self.mesh)


def is_listing(source: str) -> bool:
    """True if a source is a table or a pattern of files."""
    from insitu.readers.tables import is_pattern

    return is_pattern(source) or Path(source).suffix.lower() in TABLES


def is_ensemble(path: Path) -> bool:
    """True if a path is a table, a pattern, a folder of dumps, or one file with several members."""
    from insitu.readers.arrays import is_store, open_arrays
    from insitu.readers.codes import reader_of
    from insitu.readers.folders import is_folder_file
    from insitu.readers.reader import Sampling

    if is_listing(str(path)) or (path.is_dir() and not is_folder_file(path)):
        return True
    if (code := reader_of(path)) is not None:
        return len(code.states(path, Sampling())) > 1
    if not is_store(path):
        return False
    with open_arrays(path) as arrays:
        volumes = [a for a in arrays.arrays.values() if a.is_real and len(a.shape) >= 3 and min(a.shape[-3:]) > 1]
        return any(len(a.shape) > 3 for a in volumes) or len({a.group for a in volumes}) > 1


def listed(text: str | None) -> tuple[str, ...]:
    """The words between commas."""
    return tuple(word.strip() for word in text.split(",")) if text else ()


def pilots(source: Any, members: Any, count: int, nan: str, space: Any = None) -> dict[str, dict[str, Any]]:
    """Grids by field and member of `count` members that lie far apart; up to as many that can't be read are passed over."""
    from insitu.ensembles.ensemble import pilot_members
    from render.datasets import to_grid
    from render.xarray_fields import is_labelled_set

    fields: dict[str, dict[str, Any]] = {}
    failed: list[Exception] = []
    for member in pilot_members(members, space or source.space, 2 * count):
        if len(next(iter(fields.values()), {})) == count:
            break
        click.echo(f"reading {member.name} {dict(member.parameters)}", err=True)
        try:
            data = source.field(member, lambda fraction: None)
        except (ValueError, OSError, RuntimeError) as error:
            failed.append(error)
            if len(failed) == count:
                break
            continue
        for name, field in (data if isinstance(data, dict) and not is_labelled_set(data) else {"": data}).items():
            try:
                fields.setdefault(name, {})[member.name] = to_grid(field, nan=nan, warn=False)
            except (TypeError, ValueError) as error:
                raise ValueError(f"field {name!r} of {member.name}: {error}") from error
    if not fields and failed:
        raise failed[0]
    for reason in failed:
        click.echo(f"passed over: {reason}", err=True)
    return fields


def suggested(fields: dict[str, dict[str, Any]], alpha: float = 0.5) -> dict[str, tuple[Any, Any]]:
    """The values in each field, and a suggested appearance, which names its field where there are several."""
    from insitu.ensembles.probe import probe_fields
    from insitu.ensembles.suggestion import appearance_names, suggest

    suggestions, names = {}, appearance_names(list(fields))
    for name, grids in fields.items():
        probe = probe_fields(grids)
        of = {"name": names[name], "field": name} if len(fields) > 1 else {}
        suggestions[name] = probe, suggest(probe, list(grids.values()), alpha=alpha, **of)
    return suggestions


@dataclass(frozen=True)
class Looks:
    """Images as --scene, --appearance, --size and --target-decibels ask for them, else as an existing catalog has them.

    Attributes
    ----------
    appearances : those that a file or a scene states, () without.
    catalog : the one that exists.
    """

    scene: Scene | None
    appearances: tuple[Appearance, ...]
    catalog: Catalog | None
    size: int | None
    target_decibels: float | None

    @classmethod
    def of(
        cls, catalog: Path, scene: Path | None, appearance: Path | None, size: int | None, target_decibels: float | None
    ) -> Looks:
        """The options of a command; raises ValueError for a scene with others beside it."""
        from catalogs.store.catalog import Catalog
        from catalogs.vocabulary.scene import Scene
        from insitu.members.beginning import check_free
        from insitu.members.planning import appearances_from_toml, is_catalog

        if scene is not None and (appearance is not None or size is not None or target_decibels is not None):
            raise ValueError("a scene says how to render: leave out --appearance, --size and --target-decibels")
        loaded = None if scene is None else Scene.load(scene)
        appearances = appearances_from_toml(appearance) if appearance else loaded.appearances if loaded else ()
        existing = Catalog.open(catalog) if is_catalog(catalog) else None
        looks = cls(loaded, appearances, existing, size, target_decibels)
        if existing is None:
            check_free(catalog)
        return looks

    @property
    def catalog_appearances(self) -> tuple[Appearance, ...]:
        """The appearances of the catalog, if it exists."""
        return () if self.catalog is None else self.catalog.plan.appearances

    def split_as_stored(self, members: Sequence[PlannedMember]) -> tuple[PlannedMember, ...]:
        """Members with the splits that the catalog has drawn for them, if it exists."""
        splits = {} if self.catalog is None else {member.name: member.split for member in self.catalog.members}
        return tuple(replace(member, split=splits.get(member.name, member.split)) for member in members)

    def options(self, space: ParameterSpace, reading: ReadingOptions) -> PlanOptions:
        """The plan of a catalog of these parameters, read with these options."""
        from catalogs.vocabulary.scene import ViewPlan
        from insitu.members.planning import PlanOptions

        if self.scene is not None:
            return PlanOptions.of_scene(self.scene, space, reading.record)
        size = self.size or (None if self.catalog_appearances else 256)
        views = None if size is None else ViewPlan(width=size, height=size)
        appearances = self.appearances or None
        return PlanOptions(space, appearances, views, target_decibels=self.target_decibels, provenance=reading.record)
