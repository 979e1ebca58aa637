"""The images that an evaluation scores: test images by cell of a table, and validation images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import numpy as np

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import Variation

VIEWS = {"seen_views": ("train",), "unseen_views": ("test",)}
PARAMETERS = {"seen_parameters": ("train",), "unseen_parameters": ("test",)}
SETTINGS = {"seen_settings": ("train",), "unseen_settings": ("test",)}
VALIDATION = "validation"
MOST_IMAGES = 400  # of a cell of seen parameters, and of validation
MOST_VARIED = 300  # of a cell of a variation


@dataclass(frozen=True, eq=False)
class Case:
    """An image of the data set to be predicted.

    Attributes
    ----------
    member, view, appearance : identify the stored image.
    varied : the visualization parameters by name; empty for the base appearance.
    """

    member: Member
    view: int
    appearance: str
    varied: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def camera(self) -> Camera:
        """The camera of the image."""
        return self.member.cameras[self.view]

    @property
    def parameters(self) -> dict[str, float | str]:
        """Simulation and visualization parameters by name, as `Surrogate.at` takes them."""
        return {**self.member.parameters, **self.varied}


Group = TypeVar("Group")
Value = TypeVar("Value")
CaseCells = Mapping[str, Mapping[str, Sequence[Case]]]  # by row and column of a table


def each_cell(
    cells: Mapping[str, Mapping[str, Group]], function: Callable[[Group], Value]
) -> dict[str, dict[str, Value]]:
    """Apply a function to every cell."""
    return {row: {column: function(cell) for column, cell in columns.items()} for row, columns in cells.items()}


def all_cases(cells: CaseCells) -> list[Case]:
    """The images of all cells."""
    return [case for row in cells.values() for group in row.values() for case in group]


def cases_of(
    members: Sequence[Member],
    appearances: Mapping[str, Mapping[str, float | str]],
    member_splits: Sequence[str],
    view_splits: Sequence[str],
) -> list[Case]:
    """Images of the given splits under some appearances, named with their visualization parameters."""
    return [
        Case(member, view, appearance, varied)
        for member in members
        if member.split in member_splits
        for appearance, varied in appearances.items()
        if appearance in member.appearances
        for view, split in enumerate(member.view_splits)
        if split in view_splits
    ]


def base_cells(catalog: Catalog, appearance: str) -> CaseCells:
    """Test images of the base appearance, by row of `VIEWS` and column of `PARAMETERS`; no choice may be made on them."""
    of = partial(cases_of, catalog.members, {appearance: {}})
    return {
        row: {"seen_parameters": sample_of(of(("train",), views)), "unseen_parameters": of(("test",), views)}
        for row, views in VIEWS.items()
    }


def base_validation(catalog: Catalog, appearance: str) -> list[Case]:
    """Images of validation members, else of validation views: choices are made on these."""
    of = partial(cases_of, catalog.members, {appearance: {}})
    return of((VALIDATION,), ("train", VALIDATION)) or of(("train",), (VALIDATION,))


def variation_cells(catalog: Catalog, variation: Variation) -> CaseCells:
    """Test images at unseen views, by row of `SETTINGS` and column of `PARAMETERS`."""
    members = catalog.members
    return {
        row: {
            column: drawn_evenly(cases_of(members, _settings_of(variation, settings), splits, ("test",)))
            for column, splits in PARAMETERS.items()
        }
        for row, settings in SETTINGS.items()
    }


def variation_validation(catalog: Catalog, variation: Variation) -> list[Case]:
    """Images of validation members under validation settings; under all settings of a field, which are trained."""
    settings = _settings_of(variation, (VALIDATION,) if variation.continuous else ("train",))
    return drawn_evenly(cases_of(catalog.members, settings, (VALIDATION,), ("train", VALIDATION)))


def sample_of(cases: Sequence[Case], most: int = MOST_IMAGES) -> list[Case]:
    """At most `most` cases, drawn without replacement by a fixed seed, in order."""
    if len(cases) <= most:
        return list(cases)
    return [cases[i] for i in sorted(np.random.default_rng(0).choice(len(cases), size=most, replace=False))]


def drawn_evenly(cases: Sequence[Case], most: int = MOST_VARIED) -> list[Case]:
    """At most `most` cases, drawn by a fixed seed, in order; equally many of each member and appearance, give or take one."""
    counts: Counter[tuple[str, str]] = Counter()
    turns = []
    for i in np.random.default_rng(0).permutation(len(cases)).tolist():
        group = cases[i].member.name, cases[i].appearance
        turns.append((counts[group], i))
        counts[group] += 1
    return [cases[i] for i in sorted(i for _, i in sorted(turns, key=lambda turn: turn[0])[:most])]


def _settings_of(variation: Variation, splits: Sequence[str]) -> dict[str, dict[str, float | str]]:
    """Visualization parameters of a surrogate, by appearance."""
    return {s.appearance: variation.arguments(s) for s in variation.settings if s.split in splits}
