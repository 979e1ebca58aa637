"""Errors of emulated numbers at members that no emulator learnt from: values, and what a field's box holds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from catalogs.store.members import Member
from surrogate.emulation import EmulatedField, EmulatedFields, FieldEmulator
from surrogate.emulation.measures import NUMBERS, SHARE, Measured
from surrogate.emulation.validation import NORMAL
from surrogate.evaluation.cases import PARAMETERS
from surrogate.evaluation.scoring import spread

PLACES, SEED = 4_000, 0
MOST_MEMBERS = 60
VALUES = "values"


@dataclass(frozen=True)
class NumberError:
    """The error of one number over members.

    Attributes
    ----------
    error : mean over members, in the field's unit or for shares of 1: root mean square of values, else the absolute error.
    relative : the same over the standard deviation of all the members' values that were learnt; None for shares.
    inside : the share that lies within intervals of 90 %.
    members : their number.
    """

    error: float
    relative: float | None
    inside: float
    members: int


@dataclass(frozen=True)
class FieldNumbers:
    """Errors of an emulated field, by `VALUES` and `NUMBERS` of its whole box; shares are those above `level`."""

    name: str
    unit: str
    level: float
    errors: dict[str, NumberError]


def numbers_of(
    fields: EmulatedFields, members: Sequence[Member], progress: Callable[[int, int], None] = lambda *_: None
) -> list[FieldNumbers]:
    """Errors of each field at test members that keep it, at most `MOST_MEMBERS`; fields that none keeps are left out."""
    unseen = [m for m in members if m.split in PARAMETERS["unseen_parameters"]]
    some = [unseen[i] for i in spread(len(unseen), MOST_MEMBERS)]
    numbers = []
    for place, (name, emulator) in enumerate(fields.items()):
        report = partial(_report, progress, place, len(fields))
        level, pairs = _level(emulator), _pairs(fields, name, some, report)
        if errors := number_errors(pairs, emulator.spread, level):
            quantity = fields.quantity(name)
            numbers.append(FieldNumbers(quantity.name, quantity.unit, level, errors))
    return numbers


def _report(progress: Callable[[int, int], None], place: int, count: int, done: int, of: int) -> None:
    progress(place * of + done, count * of)


def _pairs(
    fields: EmulatedFields, name: str, members: Sequence[Member], report: Callable[[int, int], None]
) -> Iterator[tuple[EmulatedField, EmulatedField]]:
    """The predicted and the true field of the members that keep it."""
    for done, member in enumerate(members):
        report(done, len(members))
        coarse = member.coarse_field(name)
        if coarse is not None:
            point = fields.space.normalize([member.parameters[parameter] for parameter in fields.space.names])
            truth = EmulatedField(coarse.values, coarse.holes, coarse.spacing, coarse.origin)
            yield fields[name].at(point), truth


def number_errors(
    pairs: Iterable[tuple[EmulatedField, EmulatedField]], spread_of_values: float, level: float
) -> dict[str, NumberError]:
    """Errors of predicted fields beside true ones; a field's values are those at `PLACES` random places of its box."""
    random = np.random.default_rng(SEED).random((PLACES, 3))
    errors: dict[str, list[tuple[float, float]]] = {
        name: [] for name in (VALUES, *NUMBERS)
    }  # each with its share inside
    for predicted, truth in pairs:
        lengths = np.array(truth.spacing) * (np.array(truth.values.shape[::-1]) - 1)
        places = np.array(truth.origin) + random * lengths
        ours, true = predicted.sample(places), truth.sample(places)
        off = np.abs(ours.values - true.values)
        there = np.isfinite(off)
        if there.any():
            inside = off <= NORMAL * np.asarray(ours.deviations)
            errors[VALUES].append((float(np.sqrt(np.mean(off[there] ** 2))), float(inside[there].mean())))
        ours_of_box, true_of_box = predicted.statistics(level=level), truth.statistics(level=level)
        for name in NUMBERS:
            one: Measured = getattr(ours_of_box, name)
            error = abs(one.value - getattr(true_of_box, name).value)
            errors[name].append((error, float(error <= NORMAL * (one.deviation or 0.0))))
    return {name: _over_members(name, each, spread_of_values) for name, each in errors.items() if each}


def _over_members(name: str, each: Sequence[tuple[float, float]], spread_of_values: float) -> NumberError:
    error, inside = np.mean(each, axis=0).tolist()
    relative = error / spread_of_values if name != SHARE and spread_of_values > 0.0 else None
    return NumberError(error, relative, inside, len(each))


def _level(emulator: FieldEmulator) -> float:
    """The median of the ensemble's mean field."""
    mean = emulator.mean if emulator.scale is None else emulator.scale.values(emulator.mean)
    return float(np.median(mean if emulator.solid is None else mean[~emulator.solid]))
