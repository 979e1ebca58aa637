"""Warnings of a run: each kind is given once, and repeated at the end with the number of members that it holds for."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.scene import PlannedMember
from catalogs.vocabulary.words import FEWEST_LEARNT
from insitu.members.result import RenderedMember

NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?|\binf\b")
NO_SPACING = (
    "the first field states no spacing, so its values are 1 apart along every axis: pass spacing=(x, y, z) if not"
)
LOOKED_THROUGH = 100  # members of a catalog that a session looks through at its end


def kind_of(note: str) -> str:
    """A warning without its numbers: the same for all members that it holds for."""
    return NUMBER.sub("#", note)


class Once:
    """Gives each kind of warning once, to `warn`; `said` are the kinds that were given before."""

    def __init__(self, warn: Callable[[Warning], None], said: set[str] | None = None) -> None:
        self._warn = warn
        self._said = set() if said is None else said

    def say(self, name: str, notes: Iterable[str | Warning]) -> None:
        """Warn of the notes about the member of this name; "" for the ensemble."""
        for note in notes:
            kind = kind_of(str(note))
            if kind not in self._said:
                self._said.add(kind)
                called = f"{name}: {note}" if name else str(note)
                self._warn(type(note)(called) if isinstance(note, Warning) else UserWarning(called))

    def repeat(self, results: Sequence[RenderedMember]) -> None:
        """Say of each kind of warning for how many of several rendered members it holds."""
        of: dict[str, list[str]] = {}
        for result in results:
            for kind, note in {kind_of(note): note for note in result.warnings}.items():
                of.setdefault(kind, []).append(note)
        for notes in of.values():
            if len(notes) > 1:
                self._warn(UserWarning(f"{len(notes)} of {len(results)} members had this warning: {notes[-1]}"))


_SAID: dict[Path, set[str]] = {}


def said_of(catalog: Path) -> set[str]:
    """The kinds of warnings that this process has given of a catalog; none of one that does not exist yet."""
    place = catalog.absolute()
    if not (place / "catalog.json").is_file():
        _SAID.pop(place, None)
    return _SAID.setdefault(place, set())


def notes_on_catalog(catalog: Catalog) -> list[str]:
    """Sentences about the members that a catalog has so far; none of a large one, of which they were said when it was small."""
    if not 1 < len(catalog.member_paths()) <= LOOKED_THROUGH:
        return []
    return [f"{catalog.path.name} so far: {note}" for note in notes_on_ensemble(catalog.members, catalog.plan.space)]


def notes_on_ensemble(members: Sequence[PlannedMember | Member], space: ParameterSpace) -> list[str]:
    """Sentences about the members of an ensemble, most of them to be rendered yet."""
    notes: list[str] = []
    for parameter in space.parameters:
        values = [float(member.parameters[parameter.name]) for member in members]
        notes += filter(None, [parameter.note_on(values)])
        if len(values) > 1 and min(values) == max(values):
            notes.append(
                f"parameter {parameter.name} is {parameter.text(values[0])} in every member: nothing is learnt of how fields "
                "depend on it"
            )
    learnt = sum(member.split == "train" for member in members)
    if learnt < FEWEST_LEARNT:
        notes.append(
            f"{learnt} of {len(members)} members are to learn from: a surrogate of fewer than {FEWEST_LEARNT} can at best blend "
            "between them"
        )
    return notes
