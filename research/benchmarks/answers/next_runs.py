"""Gains that the learning curve expects of more members, beside those that happened; suggested members beside random ones.

    python -m research.benchmarks.answers.next_runs SCENE... [--runs runs] [--members 30] [--subsets 3] [--write]

Each subset of the members for training and validation, in whole runs, is an ensemble of its own. Its curve is asked for
the gain of 10 and of 60 more, or of as many as there are. Emulators fitted with these as well show what happened, at
the test members. Of the members outside the subset, ten are chosen as `surrogate ask next` would, and ten at random, four
times. Prints Markdown; `--write` puts it into docs/results/answers.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.store.splits import run_numbers
from catalogs.vocabulary.appearance import field_of
from catalogs.vocabulary.scene import Scene
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from surrogate.answers.next_runs import best_points
from surrogate.emulation import FieldEmulator
from surrogate.emulation.learning_curve import LearningCurve

PAGE, PART = RESULTS / "answers.md", "next runs"
FEW, MANY, RANDOM = 10, 60, 4
HEADER = ("scene", "members", "subset", "more", "expected, dB", "happened, dB", "10 suggested, dB", "10 at random, dB")


@dataclass(frozen=True, eq=False)
class Fields:
    """Normalized parameters (M, P), fields (M, Z, Y, X) and runs (M,) of members."""

    points: NDArray[np.float64]
    values: NDArray[np.float32]
    runs: NDArray[np.int64]

    @classmethod
    def of(cls, catalog: Catalog, splits: Sequence[str]) -> Fields:
        """Of the members of some splits, the field that the first appearance shows."""
        space, name = catalog.plan.space.with_logarithms(), field_of(catalog.plan.appearances[0])
        members = [m for m in catalog.members if m.split in splits and name in m.coarse_names()]
        rows = [[m.parameters[n] for n in space.names] for m in members]
        values = [coarse.values for m in members if (coarse := m.coarse_field(name)) is not None]
        return cls(space.normalize(rows), np.stack(values), np.array(run_numbers(members, space)))

    def drawn(self, random: np.random.Generator) -> NDArray[np.int64]:
        """The members in random order, those of a run together."""
        return np.lexsort((random.random(len(self.runs)), random.permutation(len(self.runs))[self.runs]))

    def emulator(self, members: NDArray[np.int64]) -> FieldEmulator:
        """Fitted to some of them."""
        return FieldEmulator.fit(self.points[members], self.values[members], (1.0,) * 3, (0.0,) * 3)


def accuracy(emulator: FieldEmulator, unseen: Fields) -> float:
    """Minus twenty logarithms of the root mean square error, mean over members, dB."""
    errors = [np.nanmean((emulator.at(p).values - v) ** 2) for p, v in zip(unseen.points, unseen.values, strict=True)]
    return float(-10.0 * np.log10(np.array(errors)).mean())


def rows(name: str, catalog: Catalog, members: int, subsets: int) -> list[list[str]]:
    """The rows of a scene."""
    learnt, unseen = Fields.of(catalog, ("train", "validation")), Fields.of(catalog, ("test",))
    count = min(members, len(learnt.points) - FEW)
    result = []
    for subset in range(subsets):
        random = np.random.default_rng(subset)
        order = learnt.drawn(random)
        own, others = order[:count], order[count:]
        emulator = learnt.emulator(own)
        now = accuracy(emulator, unseen)
        curve = LearningCurve.of(learnt.points[own], learnt.values[own], runs=learnt.runs[own])
        chosen = best_points(emulator, learnt.points[own], learnt.points[others], FEW)
        suggested = accuracy(learnt.emulator(np.append(own, others[chosen])), unseen) - now
        drawn = [
            accuracy(learnt.emulator(np.append(own, random.permutation(others)[:FEW])), unseen) - now
            for _ in range(RANDOM)
        ]
        for more in sorted({FEW, min(MANY, len(others))}):
            gain = curve.gain(more)
            happened = accuracy(learnt.emulator(order[: count + more]), unseen) - now
            expected = f"{gain.decibels:+.2f} ({gain.low:+.1f} to {gain.high:+.1f})"
            choices = [f"{suggested:+.2f}", f"{np.mean(drawn):+.2f}"] if more == FEW else ["", ""]
            result.append([f"`{name}`", str(count), str(subset), str(more), expected, f"{happened:+.2f}", *choices])
    return result


def main() -> None:
    """Fit, expect, compare, print."""
    parser, say = command_line("answers.next_runs", __doc__), stopwatch()
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--members", type=int, default=30)
    parser.add_argument("--subsets", type=int, default=3)
    parser.add_argument("--write", action="store_true", help="into docs/results/answers.md")
    given, lines = parser.parse_args(), list[list[str]]()
    for scene in map(Scene.load, given.scenes):
        say(scene.name)
        catalog = Catalog.open(scene.run_directory(given.runs) / "catalog.cdb")
        lines += rows(scene.name, catalog, given.members, given.subsets)
    words = " ".join(map(str, given.scenes))
    text = f"{table(HEADER, lines)}\n<sub>{made_by(f'answers.next_runs {words} --members {given.members}')}</sub>"
    publish(text, PAGE, PART, write=given.write)


if __name__ == "__main__":
    main()
