"""Shares of the processor time of one member: drawing, reading back, encoding, summaries, coarse field, the first member's pilot.

    LP_NUM_THREADS=0 python -m research.benchmarks.hook.shares [--sizes 64,128,256] [--pixels 256,512] [--backends vtk,cpu]
        [--step 0.5] [--lit]

Draws few views of the field of `insitu estimate --samples` by each backend, in one thread, and with light on request.  Samples
along rays are --step spacings apart, by default as a catalog chooses for 50 dB.  The member of 252 views is extrapolated from
them: what is done once, and 252 times what a view takes.  Medians of processor milliseconds.
"""

from __future__ import annotations

import os
import statistics
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click
from numpy.typing import NDArray

from catalogs.files.images import write_image
from catalogs.store.coarse import coarse_bytes
from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from insitu.ensembles.estimate import SHEETS, waves
from insitu.fields.member_fields import Fields, as_fields
from insitu.members.planning import PlanOptions, measure_pilot, plan_catalog
from render import casting
from render.datasets import to_grid
from render.quality import spread
from render.window import Window
from research.benchmarks.page import table
from research.benchmarks.timing import digits, processor_seconds

MEMBER_VIEWS, VIEWS = 252, 6


@dataclass(frozen=True)
class Shares:
    """Processor milliseconds: of a view, of what is done once for a member, and of the pilot of a catalog's first member."""

    draw: float
    read_back: float
    encode: float
    take: float
    prepare: float
    summary: float
    coarse: float
    pilot: float
    step: float

    @property
    def view(self) -> float:
        return self.draw + self.read_back + self.encode

    @property
    def member(self) -> float:
        return MEMBER_VIEWS * self.view + self.take + self.prepare + self.summary + self.coarse


def measure(size: int, pixels: int, backend: str, step: float | None, lit: bool) -> Shares:
    """Of one field, drawn by one backend."""
    spacing, values = 2.0 / (size - 1), waves(size, 1.0)
    space = ParameterSpace((Parameter("phase", 0.0, 10.0),))
    views = ViewPlan(width=pixels, height=pixels)
    look = replace(SHEETS, shaded=lit)
    options = PlanOptions(space, (look,), views, backend=backend, sample_distance=step and step * spacing)
    grids = []
    take = processor_seconds(lambda: grids.append(to_grid(values, spacing=spacing, origin=(-1.0,) * 3)))
    fields = as_fields(grids[0], (look,))
    pilots = []
    pilot = processor_seconds(lambda: pilots.append(measure_pilot(fields, options)))
    plan = plan_catalog(pilots[0], options)
    distance = plan.provenance["sample_distances"][look.name]
    first, later, read_back, encode = pictures(fields, plan, distance, backend)
    summary = processor_seconds(lambda: fields.summaries([""], plan))
    coarse = processor_seconds(lambda: coarse_bytes(fields.coarse([""])))
    draw = later - read_back
    seconds = [draw, read_back, encode, take, max(0.0, first - later), summary, coarse, pilot]
    return Shares(*(1e3 * s for s in seconds), distance / spacing)


def pictures(fields: Fields, plan: CatalogPlan, distance: float, backend: str) -> tuple[float, float, float, float]:
    """Seconds of the first picture, of a later one, of its reading back, and of encoding and writing it."""
    drawing, encoding, read_backs = [], [], list[float]()
    cameras = spread(plan.cameras, VIEWS)
    with tempfile.TemporaryDirectory() as folder, read_back_of(backend, read_backs):
        (look,) = plan.appearances
        made = iter(fields.drawable(look, backend).pictures(look, cameras, distance, float_output=False))
        for view in range(VIEWS):
            picture: list[NDArray[Any]] = []
            drawing.append(processor_seconds(lambda picture=picture: picture.append(next(made))))
            encoding.append(processor_seconds(partial(write_image, Path(folder) / f"{view}.png", picture[0])))
    return drawing[0], statistics.median(drawing[1:]), statistics.median(read_backs), statistics.median(encoding)


@contextmanager
def read_back_of(backend: str, seconds: list[float]) -> Iterator[None]:
    """Add the seconds of what follows the drawing of a picture: OpenGL's copy of its pixels, or rounding to bytes."""
    owner, name = (Window, "_read_bytes") if backend == "vtk" else (casting, "to_bytes")
    own: Callable[..., Any] = getattr(owner, name)

    def timed(*arguments: Any) -> Any:
        if backend == "vtk":
            arguments[0]._window.WaitForCompletion()
        results: list[Any] = []
        seconds.append(processor_seconds(lambda: results.append(own(*arguments))))
        return results[0]

    setattr(owner, name, timed)
    try:
        yield
    finally:
        setattr(owner, name, own)


def row(size: int, pixels: int, backend: str, shares: Shares) -> list[str]:
    by_view = [shares.draw, shares.read_back, shares.encode, shares.view]
    once = [shares.take + shares.prepare, shares.summary, shares.coarse, shares.pilot]
    ratio = shares.pilot / shares.member
    return [
        f"{size}³",
        f"{pixels}²",
        backend,
        f"{shares.step:.3g}",
        *map(digits, [*by_view, *once]),
        f"{digits(shares.member / 1e3)} s",
        f"{digits(100 * MEMBER_VIEWS * shares.draw / shares.member)} %",
        digits(ratio),
    ]


def whole_numbers(_: click.Context, __: click.Parameter, text: str) -> list[int]:
    return [int(number) for number in text.split(",")]


@click.command(help=__doc__)
@click.option("--sizes", default="64,128,256", callback=whole_numbers, help="Samples along each axis.")
@click.option("--pixels", default="256,512", callback=whole_numbers, help="Of a picture's side.")
@click.option("--backends", default="vtk,cpu")
@click.option("--step", type=float, help="Smallest spacings between samples.")
@click.option("--lit", is_flag=True, help="With shading.")
def main(sizes: Sequence[int], pixels: Sequence[int], backends: str, step: float | None, lit: bool) -> None:
    os.environ["LP_NUM_THREADS"] = "0"
    columns = ["field", "pictures", "backend", "step, spacings", "draw, ms a view", "read back", "encode", "view"]
    columns += ["take and prepare, ms", "summary", "coarse", "pilot", "252 views", "drawing", "pilot, members"]
    rows = [
        row(size, side, backend, measure(size, side, backend, step, lit))
        for size in sizes
        for side in pixels
        for backend in backends.split(",")
    ]
    print(table(columns, rows))


if __name__ == "__main__":
    main()
