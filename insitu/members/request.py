"""The arguments that describe one member, and the request they make, checked before anything is rendered or written."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

from catalogs.store.members import known_appearances
from catalogs.store.plan import CatalogError, json_values, name_problem
from catalogs.vocabulary.appearance import Appearance
from catalogs.vocabulary.numbers import finite
from catalogs.vocabulary.parameters import SPLITS, ParameterSpace
from catalogs.vocabulary.plugin_appearance import check_present
from catalogs.vocabulary.words import joined_names

TIMES = ("time", "t")  # a parameter of this name is the simulation's time
SAME_TIME = 1e-6  # relative: times that went through single precision
LONGEST_NAME = 80
Existing = Literal["error", "skip", "replace"]
EXISTING = get_args(Existing)
OnError = Literal["raise", "warn"]
ON_ERROR = get_args(OnError)
T = TypeVar("T")


@dataclass(frozen=True)
class MemberArguments:
    """Arguments of the hook that describe one member, as the caller gave them; see `insitu.render_member`."""

    parameters: Mapping[str, float]
    name: str | None = None
    split: str = "train"
    time: float | None = None
    provenance: Mapping[str, Any] | None = None
    appearances: Sequence[str] | None = None
    existing: Existing = "error"
    on_error: OnError = "raise"

    def check_policies(self) -> None:
        """Raise ValueError for an `existing` or `on_error` that is none of the choices."""
        one_of(self.existing, EXISTING, "existing")
        one_of(self.on_error, ON_ERROR, "on_error")


def one_of(value: T, choices: Sequence[str], name: str) -> T:
    """`value` of the argument `name`; raises ValueError unless it is one of the choices."""
    if value not in choices:
        raise ValueError(f"{name} must be one of {joined_names(choices)}, got {value!r}")
    return value


@dataclass(frozen=True)
class MemberRequest:
    """One member to be rendered, checked.

    Attributes
    ----------
    name : in the catalog; `named` says whether the caller chose it.
    parameters : by name, in the space's order, its time among them where that is one.
    split : "train", "validation" or "test".
    record : JSON values that are kept with the member.
    appearances : the appearances that it is shown with, in the catalog's order.
    """

    name: str
    named: bool
    parameters: Mapping[str, float]
    split: str
    record: Mapping[str, Any]
    appearances: tuple[Appearance, ...]


def member_request(
    space: ParameterSpace,
    all_appearances: Sequence[Appearance],
    arguments: MemberArguments,
) -> MemberRequest:
    """The checked request of a member of an ensemble of this space and these appearances.

    Raises ValueError or CatalogError naming what is wrong: parameters, time, name, split, provenance or appearances.
    """
    parameters, time = with_time(arguments.parameters, arguments.time, space)
    ordered = dict(zip(space.names, space.values(parameters, outside="allow").tolist(), strict=True))
    wanted = set(known_appearances(arguments.appearances, [a.name for a in all_appearances]))
    if arguments.split not in SPLITS:
        raise ValueError(f"split must be one of {joined_names(SPLITS)}, got {arguments.split!r}")
    chosen = member_name(ordered) if arguments.name is None else arguments.name
    problem = name_problem(chosen)
    if problem:
        raise CatalogError(f"invalid member name: {problem}")
    stated = {**(arguments.provenance or {}), **({} if time is None else {"time": time})}
    record = json_values(stated, f"the provenance of member {chosen}")
    appearances = tuple(a for a in all_appearances if a.name in wanted)
    check_present(appearances)
    return MemberRequest(chosen, arguments.name is not None, ordered, arguments.split, record, appearances)


def with_time(
    parameters: Mapping[str, float], time: float | None, space: ParameterSpace
) -> tuple[Mapping[str, float], float | None]:
    """The parameters with the time among them where it is one of the space's, and the time; raises ValueError where two differ."""
    if not isinstance(parameters, Mapping):
        raise ValueError(f"parameters must be values by name, such as {{'Re': 1500}}, got {parameters!r}")
    name = next((name for name in TIMES if name in space.names), None)
    time = None if time is None else finite(time, "time")
    if name is None:
        return parameters, time
    if name not in parameters:
        return (parameters if time is None else {**parameters, name: time}), time
    value = finite(parameters[name], f"parameter {name}")
    if time is not None and not math.isclose(value, time, rel_tol=SAME_TIME, abs_tol=1e-12):
        raise ValueError(
            f"time={time!r} and the parameter {name} = {value!r} disagree: give one of them, or the same twice"
        )
    return parameters, value


def member_name(parameters: Mapping[str, float]) -> str:
    """A member's default name: its parameters, or a digest of them where that would be too long or not allowed."""
    text = "_".join(f"{name}-{float(value)!r}" for name, value in parameters.items())
    text = "".join(c if c.isalnum() or c in "-_.+" else "-" for c in text)
    fits = len(text) <= LONGEST_NAME and name_problem(text) is None
    return text if fits else "member-" + hashlib.sha256(text.encode()).hexdigest()[:12]
