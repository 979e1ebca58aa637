"""Value of steps that learn smaller pictures first, a part of a picture, or several, beside steps of one whole picture.

    python -m research.benchmarks.training.step_pixels CATALOG [--seconds 200] [--gaussians 40000] [--seed 0] [--write]
        [KEY=VALUE ...]

Each row trains the simulation deformation for about the same processor time. Its steps are as many as fit, by the median
of `TIMED_STEPS` steps of each size of pictures, which are made before and thrown away. Parts are tiles of equal size,
each an example of its own, so an epoch shows each pixel once, as whole pictures do. Whole validation images judge.
Pictures that exceed the memory for training images would be decoded anew for each tile: choose a catalog that fits.
KEY=VALUE are training settings. Prints Markdown; `--write` puts it into docs/results/training.md.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from research.benchmarks.training.streaming import deformation_run, median_step
from surrogate.settings import TrainingSettings, values_of_words
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.data import Example, TrainingData
from surrogate.training.downsampling import shares
from surrogate.training.loop import StageRun
from surrogate.training.source import Source

PAGE, PART, TIMED_STEPS = RESULTS / "training.md", "step pixels", 40
HEADER = ("a step learns", "steps", "processor ms a step", "pixels a step", "processor s", "validation, dB")


@dataclass(frozen=True)
class Way:
    """A way to choose what a step learns: tiles of 1 / `parts` of a side, `batch` of them, with an early `downsampling`."""

    parts: int = 1
    batch: int = 1
    downsampling: int = 1

    def __str__(self) -> str:
        what = f"1/{self.parts**2} of a picture" if self.parts > 1 else "a picture"
        first = f", 1/{self.downsampling} as wide first" if self.downsampling > 1 else ""
        return f"{'' if self.batch == 1 else f'{self.batch} times '}{what}{first}"

    @property
    def share(self) -> float:
        """Of a picture's pixels that a step learns, in the mean over all steps."""
        return self.batch / self.parts**2 * sum(share / factor**2 for factor, share in shares(self.downsampling))


WAYS = (
    Way(),
    Way(downsampling=2),
    Way(downsampling=4),
    Way(downsampling=8),
    Way(parts=2),
    Way(parts=4),
    Way(batch=2),
)


def tiles(example: Example, parts: int) -> Iterator[Example]:
    """The parts² tiles of an image, row by row; raises ValueError where they would not be of equal size."""
    camera = example.camera
    if camera.height % parts or camera.width % parts:
        raise ValueError(f"pictures of {camera.width} x {camera.height} pixels have no {parts} equal parts a side")
    if parts == 1:
        yield example
        return
    height, width = camera.height // parts, camera.width // parts
    pixels = example.pixels
    for top in range(0, camera.height, height):
        for left in range(0, camera.width, width):
            part = np.ascontiguousarray(pixels[top : top + height, left : left + width])
            yield replace(example, image=part, camera=_tile_of(camera, left, top, width, height))


def _tile_of(camera: Camera, left: int, top: int, width: int, height: int) -> Camera:
    """The camera that sees a tile alone."""
    return replace(camera, cx=camera.cx - left, cy=camera.cy - top, width=width, height=height)


@one_torch_thread()
def row(source: Source, data: TrainingData, way: Way, seconds: float) -> list[str]:
    """Of the table."""
    examples = [tile for example in data.examples for tile in tiles(example, way.parts)]
    learnt = replace(data, examples=examples)
    each = _seconds_of_step(source, learnt, way)
    steps, begun = max(1, round(seconds / each)), time.process_time()
    run = _begun(source, learnt, way, steps)
    run.finish()
    spent, camera = time.process_time() - begun, data.examples[0].camera
    pixels = round(way.share * camera.width * camera.height)
    quality = run.validate()
    assert quality is not None  # `rows` has looked
    return [str(way), f"{steps:,}", f"{1e3 * each:.1f}", f"{pixels:,}", f"{spent:.0f}", f"{quality:.2f}"]


def _seconds_of_step(source: Source, data: TrainingData, way: Way) -> float:
    """The mean over the sizes of pictures in a training, by their shares of its steps."""
    return sum(
        share * median_step(_begun(source, data, replace(way, downsampling=factor), 2 * TIMED_STEPS), TIMED_STEPS)[0]
        for factor, share in shares(way.downsampling)
    )


def _begun(source: Source, data: TrainingData, way: Way, steps: int) -> StageRun:
    settings = replace(
        source.settings,
        batch=way.batch,
        early_downsampling=way.downsampling,
        canonical_steps=0,
        deformation_steps=steps,
    )
    return deformation_run(source, data, settings)


def rows(catalog: Path, settings: TrainingSettings, seconds: float, ways: Sequence[Way]) -> Iterator[list[str]]:
    """Of the table, one for each way; raises ValueError where the catalog has no validation images."""
    source = Source(settings, Catalog.open(catalog))
    data = source.data()
    if not data.validation:
        raise ValueError(f"catalog {catalog} holds no validation images to judge by")
    for way in ways:
        yield row(source, data, way, seconds)


def main() -> None:
    """Train, judge, print."""
    parser, say = command_line("training.step_pixels", __doc__), stopwatch()
    parser.add_argument("catalog", type=Path, metavar="CATALOG")
    parser.add_argument("settings", nargs="*", metavar="KEY=VALUE")
    parser.add_argument("--seconds", type=float, default=200.0, help="Processor time of each training.")
    parser.add_argument("--gaussians", type=int, default=40_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="into docs/results/training.md")
    given, cells = parser.parse_intermixed_args(), list[list[str]]()
    try:
        asked = values_of_words(given.settings) | {"gaussians": given.gaussians, "seed": given.seed}
        settings = TrainingSettings.from_table(asked)
        for each in rows(given.catalog, settings, given.seconds, WAYS):
            say(" | ".join(each))
            cells.append(each)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    words = f"{given.catalog} --seconds {given.seconds:g} --gaussians {given.gaussians} --seed {given.seed}"
    command = " ".join(["training.step_pixels", words, *given.settings])
    publish(f"{table(HEADER, cells)}\n<sub>{made_by(command)}</sub>", PAGE, PART, write=given.write)


if __name__ == "__main__":
    main()
