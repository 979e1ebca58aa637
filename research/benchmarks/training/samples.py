"""Value of several samples per pixel on lit surfaces: one isovalue of one unseen member, fitted alone.

    taskset -c 0 python -m research.benchmarks.training.samples runs/tgv-iso/catalog.cdb runs/tgv-iso/comparison/catalog.cdb

Each row fits the same Gaussians for as many steps, and scores images at the training views and at others. It fills its
part of docs/results/splatting.md, or of a copy in the folder `--output`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from catalogs.store.catalog import Catalog
from research.benchmarks.page import RESULTS, command_line, made_by, page_in, stopwatch, table, write_parts
from research.studies.upper_bound import fitted_alone, means_of, subjects
from surrogate.settings import TrainingSettings
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.source import Source
from surrogate.training.visualizations import lighting_of

COLUMNS = (
    "pixels a side",
    "samples a pixel",
    "seen views, dB",
    "other views, dB",
    "a step, ms of processor time",
)


def rows(
    catalog: Path, samples: Sequence[int], gaussians: int, steps: int, say: Callable[[str], None]
) -> list[list[str]]:
    """A row for each number of samples along a pixel's side; raises ValueError for a catalog without lit surfaces."""
    opened = Catalog.open(catalog)
    source = Source(TrainingSettings(gaussians=gaussians, visualization_steps=1), opened)
    shown = [s for s in subjects(source) if s.variation is not None and lighting_of(s.variation, source) is not None]
    if not shown:
        raise ValueError(f"{catalog} has no test member with isosurfaces whose light it knows")
    table_rows = list[list[str]]()
    for number in samples:
        form = source.settings.changed(
            canonical_steps=steps, deformation_steps=0, visualization_steps=0, color_degree=0, surface_samples=number
        )
        begun = time.process_time()
        still = fitted_alone(form, source, shown[0])
        taken = time.process_time() - begun
        width = shown[0].member.cameras[0].width
        of_views = [
            means_of(lambda _, still=still: still, opened, shown[0].cases(split)) for split in ("train", "test")
        ]
        decibels = [f"{means['psnr']:.2f}" for means in of_views]
        table_rows.append([f"{width}", f"{number**2}", *decibels, f"{1e3 * taken / steps:.1f}"])
        say(", ".join(table_rows[-1]))
    return table_rows


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    """Fill the part "samples" of the page."""
    parser = command_line("training.samples", __doc__)
    parser.add_argument("catalogs", nargs="+", type=Path)
    parser.add_argument("--samples", type=int, nargs="+", default=[1, 2, 3], help="along the side of a pixel")
    parser.add_argument("--gaussians", type=int, default=18_000)
    parser.add_argument("--steps", type=int, default=6_000)
    parser.add_argument("--output", type=Path, default=RESULTS)
    given = parser.parse_args(arguments)
    say = stopwatch()

    def measured() -> str:
        each = (rows(path, given.samples, given.gaussians, given.steps, say) for path in given.catalogs)
        return table(COLUMNS, [row for of in each for row in of])

    made = made_by(f"training.samples {' '.join(map(str, given.catalogs))}")
    if write_parts(page_in(given.output, "splatting.md"), {"samples": measured}, made, say):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
