"""Parameters of further runs, and how much closer the surrogate would come with them."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.store.splits import run_numbers
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.words import joined_names, one_line, plural
from surrogate.emulation.emulator import FieldEmulator
from surrogate.emulation.fields import EmulatedFields
from surrogate.emulation.learning_curve import Gain, LearningCurve, TooFew
from surrogate.randomness import sobol_points

CANDIDATES = 1024
MOST = 256  # suggestions
WORST = 3  # members that are named
DIGITS = 6


@dataclass(frozen=True, eq=False)
class NextRuns:
    """Suggested runs, and what they are worth.

    Attributes
    ----------
    space : the parameters.
    runs : (N, P), in the parameters' units.
    members : parameters of those there are, by name.
    lengths : (P,) length scales of the emulated field, in ranges of the parameters; None without an emulator.
    curve : the learning curve; None without an emulator, or where there are too few members.
    why_no_curve : the reason, for people.
    errors : relative errors of members that the emulator predicted without them, by name.
    """

    space: ParameterSpace
    runs: NDArray[np.float64]  # [N, P]
    members: Mapping[str, Mapping[str, float]]
    lengths: NDArray[np.float64] | None = None  # [P]
    curve: LearningCurve | None = None
    why_no_curve: str = ""
    errors: Mapping[str, float] = field(default_factory=dict)

    __repr__ = one_line

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def sentences(self) -> list[str]:
        """Sentences on them for people."""
        said = [f"{plural(len(self.runs), 'run')} beside {len(self.members)} members{self._measure}"]
        if self.curve is None:
            said.append(f"what they are worth is not known: {self.why_no_curve}")
        else:
            said += [str(gain) for gain in self.gains]
            said.append("(of the emulated field's error; where runs lie matters less than how many there are)")
        if self.errors:
            worst = sorted(self.errors, key=lambda name: -self.errors[name])[:WORST]
            said.append(f"predicted worst without themselves: {joined_names(self._described(n) for n in worst)}")
        return said

    @property
    def gains(self) -> list[Gain]:
        """Those of as many runs as are suggested, and of as many as there are members."""
        counts = sorted({len(self.runs), len(self.members)})
        return [] if self.curve is None else [self.curve.gain(count) for count in counts]

    @property
    def _measure(self) -> str:
        if self.lengths is None:
            return ", far from them and from each other"
        fastest = [self.space.names[i] for i in np.argsort(self.lengths)[:2]]
        return f"; the field changes fastest with {joined_names(fastest)}"

    def _described(self, name: str) -> str:
        at = ", ".join(f"{p.name}={p.text(self.members[name][p.name], 3)}" for p in self.space.parameters)
        return f"{name} ({at}: {100.0 * self.errors[name]:.0f} % of the spread)"

    def table(self) -> str:
        """The runs as comma-separated values: names, then a row for each."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.space.names)
        writer.writerows([f"{value:.{DIGITS}g}" for value in run] for run in self.runs)
        return text.getvalue()

    def to_json(self) -> dict[str, Any]:
        """JSON values."""
        return {
            "runs": [dict(zip(self.space.names, run, strict=True)) for run in self.runs.tolist()],
            "lengths": None
            if self.lengths is None
            else dict(zip(self.space.names, self.lengths.tolist(), strict=True)),
            "gains": [vars(gain) for gain in self.gains],
            "curve": None if self.curve is None else self.curve.to_json(),
            "why_no_curve": self.why_no_curve,
            "errors": dict(self.errors),
        }


def next_runs(
    catalog: Catalog,
    fields: EmulatedFields | None,
    count: int,
    *,
    splits: Sequence[str] = ("train",),
    seed: int = 0,
) -> NextRuns:
    """Suggest `count` runs beside the members of a catalog, one by one where they teach most; see `best_points`.

    The first of the emulated `fields` decides; without any, runs lie as far as they can from members and from each other.
    The learning curve and the errors are of that field and of the members of `splits`, which its emulator learnt from.

    Raises ValueError for a catalog without parameters, and for a `count` outside 1 to `MOST`.
    """
    if not 1 <= count <= MOST:
        raise ValueError(f"the number of runs must be 1 to {MOST}, got {count}")
    space = catalog.plan.space.with_logarithms()
    if not len(space):
        raise ValueError(f"{catalog.path} has no parameters, over which further runs could differ")
    named = {m.name: {n: float(m.parameters[n]) for n in space.names} for m in catalog.members}
    existing = np.reshape([list(at.values()) for at in named.values()], (-1, len(space)))  # [M, P]
    candidates = catalog.plan.space.denormalize(
        sobol_points(CANDIDATES, len(space), seed)
    )  # [C, P], even as the plan means it
    points, possible = space.normalize(existing), space.normalize(candidates)
    if not fields:
        runs = candidates[farthest(possible, points, count)]
        return NextRuns(space, runs, named, why_no_curve="the catalog keeps no coarse fields to learn from")
    name, emulator = next(iter(fields.items()))
    runs = candidates[best_points(emulator, points, possible, count)]
    learnt = [m for m in catalog.members if m.split in splits and name in m.coarse_names()]
    errors = {m.name: float(e / emulator.spread) for m, e in zip(learnt, emulator.errors, strict=True)}
    return NextRuns(space, runs, named, mean_lengths(emulator), *learning_curve(catalog, fields, splits=splits), errors)


def mean_lengths(emulator: FieldEmulator) -> NDArray[np.float64]:
    """The length scale of each parameter (P,), in ranges: the geometric mean over components, weighted by their variance."""
    processes = emulator.processes
    weights = (processes.coefficients**2).mean(0)  # [K]
    if not weights.sum() > 0.0:
        return np.ones(processes.points.shape[1])
    logarithms = np.log(processes.lengths[processes.groups])  # [K, P]
    return np.asarray(0.5 * np.exp(weights @ logarithms / weights.sum()))  # normalized parameters span 2


def best_points(
    emulator: FieldEmulator, points: NDArray[np.float64], candidates: NDArray[np.float64], count: int
) -> list[int]:
    """The numbers of the candidates (C, P) that, one by one, lower the variance of the field most, on average over all of them.

    Points (M, P) are those of all members, whether the emulator learnt from them or not.  The average is over components, too
    (Cohn 1996, section 4; Seo et al. 2000, "ALC").
    """
    processes = emulator.processes
    strengths = np.bincount(processes.groups, (processes.coefficients**2).mean(0), len(processes.lengths))  # [G]
    covariances = [
        processes.posterior_covariance(group, points, candidates) for group in range(len(processes.lengths))
    ]  # G of [C, C]
    chosen: list[int] = []
    for _ in range(count):
        gains = np.zeros(len(candidates))
        for strength, noise, covariance in zip(strengths, processes.noises, covariances, strict=True):
            gains += strength * (covariance**2).sum(0) / (np.diag(covariance) + noise)
        gains[chosen] = -1.0
        chosen.append(best := int(gains.argmax()))
        for noise, covariance in zip(processes.noises, covariances, strict=True):
            row = covariance[best].copy()
            covariance -= np.outer(row, row) / (row[best] + noise)
    return chosen


def farthest(candidates: NDArray[np.float64], points: NDArray[np.float64], count: int) -> list[int]:
    """The numbers of the candidates (C, P) that lie, one by one, farthest from all points (M, P) and those before."""
    distances, chosen = np.full(len(candidates), np.inf), list[int]()
    for point in points:
        distances = np.minimum(distances, ((candidates - point) ** 2).sum(1))
    for _ in range(count):
        chosen.append(int(distances.argmax()))
        distances = np.minimum(distances, ((candidates - candidates[chosen[-1]]) ** 2).sum(1))
    return chosen


def learning_curve(
    catalog: Catalog, fields: EmulatedFields, *, splits: Sequence[str] = ("train",)
) -> tuple[LearningCurve | None, str]:
    """The learning curve of the first field over members of `splits`, or the reason why there is none; see `LearningCurve.of`."""
    space = catalog.plan.space.with_logarithms()
    name, emulator = next(iter(fields.items()))
    learnt = [m for m in catalog.members if m.split in splits and name in m.coarse_names()]
    points = space.normalize([[m.parameters[p] for p in space.names] for m in learnt])
    values = [coarse.values for m in learnt if (coarse := m.coarse_field(name)) is not None]
    try:
        return LearningCurve.of(points, np.stack(values), emulator.scale, runs=run_numbers(learnt, space)), ""
    except TooFew as error:
        return None, str(error)
