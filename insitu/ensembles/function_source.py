"""Fields that somebody else's simulation code makes, one call of a Python function for each run."""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from catalogs.vocabulary.appearance import Appearance
from catalogs.vocabulary.scene import PlannedMember
from insitu.ensembles.dumps import TIME, but_time, runs_in_time
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import Fields, as_fields

FUNCTION = "simulate"
REQUIREMENTS = "requirements.txt"  # beside a script: what its environment needs

Simulate = Callable[..., Any]


@dataclass(frozen=True)
class HookedSource:
    """Calls a function, in the worker process that renders, wherever an ensemble needs a field.

    The function is called `simulate(parameters, **settings)` and returns a field as the hook takes it: an `insitu.Field`, a
    pyvista, VTK or xarray data set, or several fields by name.  Where "time" is one of the parameters, members that are equal in
    all others are dumps of one run.  It is called once for them, `simulate(parameters, times, **settings)`, with `parameters`
    without the time and ascending `times`, and yields the field of each time.

    Attributes
    ----------
    simulate : the function, which can be pickled.
    name : what the catalog records of where its fields come from.
    settings : its further arguments, JSON values.
    appearances : what its fields are shown with.
    nan : as in `insitu.render_member`.
    in_time : whether members are dumps of runs.
    """

    simulate: Simulate
    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    appearances: tuple[Appearance, ...] = field(default=(), repr=False)
    nan: str = "refuse"
    in_time: bool = False
    expensive: bool = True

    def __post_init__(self) -> None:
        try:
            json.dumps(self.settings, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ValueError(f"source.settings must be JSON values ({error}), got {dict(self.settings)}") from None

    @property
    def identity(self) -> Mapping[str, Any]:
        identity = {"kind": "hooked", "script": self.name, "settings": dict(self.settings)}
        return identity | ({"code": self.simulate.code} if isinstance(self.simulate, ScriptFunction) else {})

    def check(self) -> None:
        """Raise FileNotFoundError, ValueError or RuntimeError where a script's function can't be called in this environment."""
        if isinstance(self.simulate, ScriptFunction):
            self.simulate.function()

    def runs(self, members: Sequence[PlannedMember]) -> list[tuple[PlannedMember, ...]]:
        """The members grouped by run, those of a run in the order of time."""
        return runs_in_time(members) if self.in_time else [(member,) for member in members]

    def dumps(self, run: Sequence[PlannedMember], progress: Callable[[float], None]) -> Iterator[Fields]:
        """The fields of some members of one run, one after the other."""
        if not self.in_time:
            for member in run:
                yield self._as_fields(self.simulate(dict(member.parameters), **self.settings))
            return
        times = [member.parameters[TIME] for member in run]
        fields = iter(self.simulate(but_time(run[0]), times, **self.settings))
        for _ in times:  # the code is not asked for more than is rendered
            field = next(fields, None)
            if field is None:
                return
            yield self._as_fields(field)

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Fields:
        """The fields of one member."""
        return next(self.dumps([member], progress))

    def _as_fields(self, data: Any) -> Fields:
        return as_fields(data, self.appearances, FieldLocation(nan=self.nan))


@dataclass(frozen=True)
class ScriptFunction:
    """The function `simulate` of a Python file, loaded where it is first called.

    Attributes
    ----------
    path : the file.
    scene : what errors name.
    code : a hash over the file's statements, without comments and docstrings: a catalog takes no members of another code.
    """

    path: Path
    scene: str
    code: str

    def __call__(self, *arguments: Any, **settings: Any) -> Any:
        return self.function()(*arguments, **settings)

    def function(self) -> Simulate:
        """The function itself; raises RuntimeError where the file imports what this environment does not have."""
        try:
            return _loaded(self.path)
        except ModuleNotFoundError as error:
            raise RuntimeError(
                f"scene {self.scene} runs {self.path}, which needs the Python package {error.name!r}, and {sys.prefix} does not "
                f"have it: {self._remedy()}"
            ) from None

    def _remedy(self) -> str:
        requirements = self.path.with_name(REQUIREMENTS)
        if not requirements.is_file():
            return "install it there, or run this command in an environment that has it"
        return f"`python -m pip install -r {requirements}` installs it"


def scripted(path: Path, scene: str) -> ScriptFunction:
    """The function `simulate` of the file at `path`; raises ValueError where there is no such file."""
    if not path.is_file():
        raise ValueError(f"source.script names {path}, and there is no such file: it is relative to the scene's folder")
    return ScriptFunction(path.resolve(), scene, _code_of(path))


def _code_of(path: Path) -> str:
    """A hash over a Python file's statements; raises ValueError where it is none."""
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError) as error:
        raise ValueError(f"source.script names {path}, which is not a Python file: {error}") from None
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:16]


@cache
def _loaded(path: Path) -> Simulate:
    name = f"insitu_hooked_{path.parent.name}_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ValueError(f"source.script names {path}, which is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # its classes look for their module there
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    function = getattr(module, FUNCTION, None)
    if not callable(function):
        raise ValueError(
            f"{path} has no function {FUNCTION}(parameters, ...), which makes the fields of a hooked scene"
        )
    return function
