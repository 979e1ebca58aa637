"""Emulated fields at parameters of no member: pictures, values, intervals, numbers, seconds and megabytes.

    python -m research.benchmarks.emulation.unseen SCENE... [--runs runs] [--views 4] [--write]

Learns from the training members' fields with at most 64³ samples, those of the scene's catalog or, where that has none,
of its source. Fields of the test members are predicted, drawn as the true ones are, and compared. Prints Markdown;
`--write` puts it into docs/results/emulation.md.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.store.coarse import CoarseField
from catalogs.vocabulary.appearance import Appearance, VolumeRendering, field_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.scene import Scene
from insitu.ensembles.dumps import dumps_of, runs_of
from insitu.ensembles.sources import ensemble_of
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import as_fields
from render import Grid, render_views
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import EmulatedField, FieldEmulator
from surrogate.evaluation.numbers import VALUES, number_errors

PAGE, PART = RESULTS / "emulation.md", "unseen"
SIDE, SEED = 128, 0
HEADER = (
    "scene",
    "members",
    "samples",
    "modes",
    "fit, s",
    "MB",
    "a field, ms",
    "picture, dB: mean / worst",
    "values, relative rms: left out / unseen",
    "in 90 % intervals: values / minimum / maximum / mean / share above the median",
)


@dataclass(frozen=True, eq=False)
class Known:
    """A member's parameters (P,), its split and its field."""

    parameters: NDArray[np.float64]
    split: str
    field: CoarseField


def known_fields(scene: Scene, run: Path, appearance: Appearance) -> tuple[ParameterSpace, list[Known]]:
    """The space of a scene, and the members' fields that an appearance shows."""
    name = field_of(appearance)
    if (run / "catalog.cdb").is_dir():
        catalog = Catalog.open(run / "catalog.cdb")
        pairs = [(member, member.coarse_field(name)) for member in catalog.members]
        space = catalog.plan.space
        stored = [Known(_row(space, m.parameters), m.split, field) for m, field in pairs if field is not None]
        if stored:
            return space.with_logarithms(), stored
    ensemble = ensemble_of(scene)
    found = []
    for member_run in runs_of(ensemble.source, ensemble.members):
        for dump in dumps_of(ensemble.source, member_run, None):
            if dump.error is not None:
                raise dump.error
            fields = as_fields(dump.field, [appearance], FieldLocation(), all_appearances=scene.appearances)
            (coarse,) = fields.coarse([name]).values()
            found.append(Known(_row(ensemble.space, dump.member.parameters), dump.member.split, coarse))
    return ensemble.space.with_logarithms(), found


def _row(space: ParameterSpace, parameters: object) -> NDArray[np.float64]:
    return space.values(parameters, outside="allow")  # type: ignore[arg-type]


def cameras(field: CoarseField, count: int) -> list[Camera]:
    """Cameras all around a field, in random directions."""
    size = np.array(field.spacing) * (np.array(field.values.shape[::-1]) - 1)
    center, random = np.array(field.origin) + size / 2.0, np.random.default_rng(SEED)
    found = []
    for _ in range(count):
        direction = random.standard_normal(3)
        place = center + direction / np.linalg.norm(direction) * 2.0 * np.linalg.norm(size)
        found.append(Camera.look_at(place, center, vertical_fov_degrees=30, width=SIDE, height=SIDE))
    return found


def decibels(
    truth: CoarseField, predicted: EmulatedField, appearance: Appearance, views: Sequence[Camera]
) -> list[float]:
    """PSNR of pictures of a predicted field on white, for each view."""

    def drawn(values: NDArray[np.floating]) -> Iterator[NDArray[np.float64]]:
        grid = Grid(np.ascontiguousarray(values, np.float32), truth.spacing, truth.origin)
        for picture in render_views(grid, appearance, views, sample_distance=0.6 * min(truth.spacing)):
            shares = np.asarray(picture, np.float64) / 255.0
            yield shares[..., :3] + 1.0 - shares[..., 3:]

    values = predicted.values if predicted.holes is None else np.where(predicted.holes, np.nan, predicted.values)
    pairs = zip(drawn(values), drawn(truth.values), strict=True)
    return [-10.0 * float(np.log10(max(((a - b) ** 2).mean(), 1e-12))) for a, b in pairs]


def row(name: str, space: ParameterSpace, members: Sequence[Known], appearance: Appearance, views: int) -> list[str]:
    """A scene's row of the table."""
    learnt, unseen = ([m for m in members if m.split == split] for split in ("train", "test"))
    if not unseen:
        raise ValueError(f"{name} has no test members")
    first = learnt[0].field
    scale = ValueScale.of_function(appearance.transfer_function) if isinstance(appearance, VolumeRendering) else None
    fields = np.stack([m.field.values for m in learnt])
    points = space.normalize(np.stack([m.parameters for m in learnt]))
    started = time.process_time()
    emulator = FieldEmulator.fit(points, fields, first.spacing, first.origin, scale)
    seconds = time.process_time() - started
    level, shown = float(np.nanmedian(fields)), cameras(first, views)
    pictures, pairs, spent = list[float](), list[tuple[EmulatedField, EmulatedField]](), 0.0
    for member in unseen:
        point = space.normalize(member.parameters)
        started = time.process_time()
        predicted = emulator.at(point)
        spent += time.process_time() - started
        pairs.append((predicted, EmulatedField(member.field.values, member.field.holes, first.spacing, first.origin)))
        pictures += decibels(member.field, predicted, appearance, shown)
    errors = number_errors(pairs, emulator.spread, level)
    z, y, x = first.values.shape
    return [
        f"`{name}`",
        f"{len(learnt)}, {len(unseen)} unseen",
        f"{x} x {y} x {z}",
        str(len(emulator.modes)),
        f"{seconds:.1f}",
        f"{emulator.megabytes:.1f}",
        f"{1e3 * spent / len(unseen):.0f}",
        f"{np.mean(pictures):.1f} / {np.min(pictures):.1f}",
        f"{emulator.relative_error:.3f} / {errors[VALUES].error / emulator.spread:.3f}",
        " / ".join(f"{100.0 * error.inside:.0f}" for error in errors.values()),
    ]


def main() -> None:
    """Fit, predict, compare, print."""
    parser, say = command_line("emulation.unseen", __doc__), stopwatch()
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--views", type=int, default=4)
    parser.add_argument("--write", action="store_true", help="into docs/results/emulation.md")
    given = parser.parse_args()
    rows = list(_measured(given.scenes, given.runs, given.views, say))
    words = " ".join(map(str, given.scenes))
    text = f"{table(HEADER, rows)}\n<sub>{made_by(f'emulation.unseen {words}')}, processor seconds of one core</sub>"
    publish(text, PAGE, PART, write=given.write)


def _measured(scenes: Sequence[Path], runs: Path, views: int, say: Callable[[str], None]) -> Iterator[list[str]]:
    for scene in map(Scene.load, scenes):
        appearance = scene.appearances[0]
        say(scene.name)
        space, members = known_fields(scene, scene.run_directory(runs), appearance)
        cells = row(scene.name, space, members, appearance, views)
        print(" | ".join(cells), flush=True)
        yield cells


if __name__ == "__main__":
    main()
