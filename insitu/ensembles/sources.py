"""The source of a scene's fields: a simulation, bundled or somebody else's, or an ensemble stored in a file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from catalogs.vocabulary.appearance import shown_fields
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, Scene
from catalogs.vocabulary.words import check_keys, joined_names
from insitu.ensembles.dumps import TIME, FieldSource, but_time, runs_in_time
from insitu.ensembles.files import FileEnsemble
from insitu.ensembles.function_source import HookedSource, Simulate, scripted
from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.readers.layout import FileMapping
from insitu.readers.reader import Sampling
from insitu.readers.states import members_of
from insitu.readers.stored import StoredEnsemble
from insitu.readers.tables import read_table
from insitu.simulations import Simulation, simulation

KEYS = {  # of a scene's `[source]`: those that must be there, and those that may
    "simulation": ({"simulation", "resolution"}, {"time", "fields", "solver_resolution"}),
    "hooked": (set(), {"script", "settings"}),
    "hdf5": ({"path"}, {"dataset", "fields"}),
    "files": ({"path"}, {"fields", "spacing", "origin", "dims", "reader", "resolution", "interpolation", "mesh"}),
}


@dataclass(frozen=True)
class SimulationSource:
    """Runs a bundled simulation in the worker that renders its members.

    Attributes
    ----------
    time : when a member is taken; None where that is the member's parameter "time".  Members equal in all other parameters are then
        dumps of one run.
    fields : what is taken of it; () stands for its first field, and is not recorded.
    solver_resolution : points of the solver, where those are more than the field's.
    """

    name: str
    resolution: int
    time: float | None
    expensive: bool = True
    fields: tuple[str, ...] = ()
    solver_resolution: int | None = None

    @property
    def identity(self) -> Mapping[str, Any]:
        identity = {"kind": "simulation", "simulation": self.name, "resolution": self.resolution}
        if self.time is not None:
            identity["time"] = self.time
        if self.solver_resolution is not None:
            identity["solver_resolution"] = self.solver_resolution
        return {**identity, "fields": list(self.fields)} if self.fields else identity

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the fields that `field` returns."""
        return self.fields or simulation(self.name).fields[:1]

    def runs(self, members: Sequence[PlannedMember]) -> list[tuple[PlannedMember, ...]]:
        """The members grouped by run, those of a run in the order of time."""
        if self.time is not None:
            return [(member,) for member in members]
        return list(runs_in_time(members))

    def dumps(self, run: Sequence[PlannedMember], progress: Callable[[float], None]) -> Iterator[dict[str, Field]]:
        """The fields of some members of one run, in order; `progress` is called with the fraction of the way to the next."""
        solver = simulation(self.name)
        how = {"fields": self.names, "resolution": self.resolution, "progress": progress}
        how["solver_resolution"] = self.solver_resolution
        if self.time is None:
            times = [member.parameters[TIME] for member in run]
            yield from solver.dumps(but_time(run[0]), times=times, **how)
        else:
            for member in run:
                yield solver.run_fields(member.parameters, time=self.time, **how)

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> dict[str, Field]:
        """The fields of one member, by name."""
        return next(self.dumps([member], progress))


@dataclass(frozen=True)
class Ensemble:
    """A scene's members, their parameters' space, the source of their fields and the names of these."""

    space: ParameterSpace
    members: Sequence[PlannedMember] = field(repr=False)
    source: FieldSource
    fields: tuple[str, ...]


def ensemble_of(scene: Scene, simulate: Simulate | None = None) -> Ensemble:
    """The ensemble behind a scene of kind "simulation", "hooked", "hdf5" or "files".

    `simulate` makes the fields of one of kind "hooked", instead of its script's function of that name.

    Raises ValueError naming a wrong key of `[source]` or another kind, FileNotFoundError for absent data.
    """
    try:
        if scene.source["kind"] == "hooked":
            return _hooked(scene, dict(scene.source), simulate)
        return _ensemble(scene, dict(scene.source))
    except ValueError as error:
        raise ValueError(f"scene {scene.path}: {error}") from None


def _ensemble(scene: Scene, table: dict[str, Any]) -> Ensemble:
    kind = _checked_kind(table)
    fields = table.get("fields", [])
    if not isinstance(fields, list) or not all(isinstance(name, str) and name for name in fields):
        raise ValueError(f"source.fields must be a list of names, got {fields!r}")
    if kind == "hdf5":
        if "dataset" in table and fields:
            raise ValueError("fields name the data sets of the file, several or one: leave dataset out")
        ensemble = StoredEnsemble.open(
            scene.data_path(), FileMapping(tuple(fields or (table.get("dataset", "field"),)))
        )
        return Ensemble(
            ensemble.space, ensemble.members(scene.validation_members, scene.seed), ensemble, ensemble.fields
        )
    if kind == "files":
        return _files(scene, table, tuple(fields))
    solver = simulation(table["simulation"])
    _check_parameters(solver, scene.space.names, "time" in table)
    try:
        solver.check_fields(fields or solver.fields[:1])
    except ValueError as error:
        raise ValueError(f"source.{error}") from None
    for key, kinds, words in (
        ("resolution", (int,), "a whole number"),
        ("solver_resolution", (int,), "a whole number"),
        ("time", (int, float), "a number"),
    ):
        if key in table and type(table[key]) not in kinds:
            raise ValueError(f"source.{key} must be {words}, got {table[key]!r}")
    source = SimulationSource(
        solver.name,
        table["resolution"],
        float(table["time"]) if "time" in table else None,
        fields=tuple(fields),
        solver_resolution=table.get("solver_resolution"),
    )
    return Ensemble(scene.space, scene.members, source, source.names)


def _checked_kind(table: dict[str, Any]) -> str:
    """The kind, taken out of `[source]`; raises ValueError for keys that are missing or of no meaning to it."""
    kind = str(table.pop("kind"))
    if kind == "loop":
        raise ValueError("members of a source of kind loop come from a simulation that calls the hook: run that")
    if kind not in KEYS:
        raise ValueError(f"a source of kind {kind} has no fields, its images were made elsewhere")
    needed, more = KEYS[kind]
    check_keys(sorted(needed | more), table, f"source of kind {kind}")
    if missing := sorted(needed - set(table)):
        raise ValueError(f"source of kind {kind} lacks {joined_names(missing)}")
    return kind


def _hooked(scene: Scene, table: dict[str, Any], simulate: Simulate | None) -> Ensemble:
    """The ensemble that a function makes, of the caller's or of the script that the scene names."""
    _checked_kind(table)
    script, settings = table.get("script", ""), table.get("settings", {})
    if not isinstance(script, str):
        raise ValueError(f"source.script must be a path, from this scene's folder, got {script!r}")
    if not isinstance(settings, dict):
        raise ValueError(f"source.settings must be a table of arguments for simulate, got {settings!r}")
    if simulate is None and not script:
        raise ValueError("source of kind hooked lacks script: name a file with a function simulate, or pass simulate=")
    source = HookedSource(
        simulate or scripted(scene.path.parent / script, scene.name),
        script or getattr(simulate, "__qualname__", type(simulate).__name__),
        settings,
        scene.appearances,
        scene.render.nan,
        in_time=TIME in scene.space.names,
    )
    return Ensemble(scene.space, scene.members, source, shown_fields(scene.appearances))


def _files(scene: Scene, table: dict[str, Any], fields: tuple[str, ...]) -> Ensemble:
    """The ensemble of a table of files; `[[parameters]]` may choose its columns and give their bounds and units."""
    for key, kinds in (("spacing", (int, float)), ("origin", (int, float)), ("dims", (str,))):
        value = table.get(key, [0, 0, 0] if kinds[0] is int else ["", "", ""])
        if not isinstance(value, list) or len(value) != 3 or not all(type(v) in kinds for v in value):
            raise ValueError(
                f"source.{key} must be a list of three {'axes' if key == 'dims' else 'numbers'}, got {value!r}"
            )
    name, sampling = _reader(scene, table)
    names, arrays = scene.space.names, fields or tuple(filter(None, shown_fields(scene.appearances)))
    rows, code = members_of(
        lambda more_in_files: read_table(scene.data_path(), names, more_in_files=more_in_files),
        name,
        sampling,
        names,
        arrays,
    )
    spacing, origin, dims = (tuple(table[key]) if key in table else None for key in ("spacing", "origin", "dims"))
    bounds = {p.name: (p.low, p.high) for p in scene.space.parameters}
    source = FileEnsemble.of(
        rows,
        bounds=bounds,
        arrays=arrays,
        reader=code,
        sampling=sampling,
        location=FieldLocation(spacing, origin, dims=dims),
    )
    if len(scene.space):
        source = replace(source, space=scene.space)
    array_names = source.arrays or ("",)
    return Ensemble(source.space, source.members(scene.validation_members, scene.seed), source, array_names)


def _reader(scene: Scene, table: Mapping[str, Any]) -> tuple[str, Sampling]:
    """The name of the code that wrote the files, "" where the scene does not say, and how they are resampled."""
    words = {
        key: table.get(key, default) for key, default in (("reader", ""), ("interpolation", "nearest"), ("mesh", ""))
    }
    for key, word in words.items():
        if not isinstance(word, str):
            raise ValueError(f"source.{key} must be a word, got {word!r}")
    counts = table.get("resolution", [2, 2, 2])
    if not isinstance(counts, list) or len(counts) != 3 or not all(type(n) is int for n in counts):
        raise ValueError(f"source.resolution must be a list of three whole numbers, got {counts!r}")
    resolution = (counts[0], counts[1], counts[2]) if "resolution" in table else None
    mesh = scene.data_path().parent / words["mesh"] if words["mesh"] else None
    return words["reader"], Sampling(resolution, words["interpolation"], mesh)


def _check_parameters(solver: Simulation, names: Sequence[str], with_time: bool) -> None:
    """Raise ValueError unless these are the simulation's parameters, and time stands in one place."""
    if set(names) - {TIME} != set(solver.parameters):
        raise ValueError(
            f"simulation {solver.name} takes the parameters {joined_names(solver.parameters)} and, maybe, {TIME!r}; "
            f"the scene has {joined_names(names)}"
        )
    if with_time and TIME in names:
        raise ValueError("time is one of [[parameters]], so every member says its own: leave it out of [source]")
    if not with_time and TIME not in names:
        raise ValueError(
            f"source of kind simulation lacks time: state it in [source], or make {TIME!r} one of [[parameters]]"
        )
