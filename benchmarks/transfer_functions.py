"""Any transfer function, also in colours that no training picture showed: the surrogate against the field itself.

    python -m benchmarks.transfer_functions [--quick]

Needs the trained scene tgv-tf (`make train SCENE=tgv-tf`).  Simulates its middle test member anew, since the catalog holds no such
pictures, renders it under functions that were never trained, and writes docs/transfer_functions.md and .png.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.page import DOCS, PROJECT, command_line, made_by, table, write_parts
from catalogs.appearance import TransferFunction, VolumeRendering
from catalogs.catalog import Catalog
from catalogs.images import write_image
from insitu.simulations import simulation
from render import render_views
from render.datasets import to_grid
from surrogate import Surrogate
from surrogate.evaluation.metrics import composite, score

RUN = PROJECT / "runs" / "tgv-tf"
OTHER_COLORS = (  # dark blue to green to yellow
    (-20.0, 0.27, 0.0, 0.33),
    (0.0, 0.23, 0.32, 0.55),
    (10.0, 0.13, 0.57, 0.55),
    (30.0, 0.37, 0.79, 0.38),
    (60.0, 0.99, 0.91, 0.14),
)
TWO_PEAKS = ((-20.0, 0.0), (5.0, 0.0), (8.0, 0.5), (12.0, 0.05), (25.0, 0.05), (35.0, 0.8), (60.0, 0.8))
STRAIN = ((-20.0, 0.8), (-5.0, 0.5), (-1.0, 0.0), (60.0, 0.0))
MEMBER, RESOLUTION, TIME = "test-001", 64, 5.0  # as in scenes/tgv-tf.toml
SHOWN = 2  # which of the views is drawn


def functions(base: TransferFunction) -> dict[str, TransferFunction]:
    """What is asked for, by name."""
    unit = base.opacity_unit_distance
    return {
        "the base function": base,
        "twice as dense": TransferFunction(base.color_points, base.opacity_points, unit / 2.0),
        "other colours": TransferFunction(OTHER_COLORS, base.opacity_points, unit),
        "two peaks of opacity": TransferFunction(base.color_points, TWO_PEAKS, unit),
        "two peaks, other colours": TransferFunction(OTHER_COLORS, TWO_PEAKS, unit),
        "only strain (Q < 0), which training hardly showed": TransferFunction(base.color_points, STRAIN, unit),
    }


def measured(step: int) -> tuple[str, NDArray[np.float32]]:
    """The table, and truth above prediction for every function, (2 H, K W, 3); every `step`-th test view is drawn."""
    catalog, surrogate = Catalog.open(RUN / "catalog.cdb"), Surrogate.load(RUN / "surrogate")
    base, member = catalog.plan.plain_appearances[0], catalog.member(MEMBER)
    if not isinstance(base, VolumeRendering):
        raise ValueError(f"{RUN} must begin with a volume rendering, got {base.name}")
    cameras = [c for c, split in zip(member.cameras, member.view_splits, strict=True) if split == "test"][::step]
    field = simulation("taylor_green").run(
        dict(member.parameters), resolution=RESOLUTION, time=TIME, progress=lambda _: None
    )
    distance, grid = catalog.plan.provenance["sample_distances"][base.name], to_grid(field)
    before = surrogate.at(**member.parameters)
    rows, columns = [], []
    for name, function in functions(base.transfer_function).items():
        appearance = VolumeRendering("asked", function)
        truths = list(render_views(grid, appearance, cameras, sample_distance=distance))
        deformed = surrogate.under(function, **member.parameters)
        pictures = [deformed.render(camera) for camera in cameras]
        found = [score(truth, picture, None) for truth, picture in zip(truths, pictures, strict=True)]
        without = [score(t, before.render(c), None) for t, c in zip(truths, cameras, strict=True)]
        psnr, base_psnr = (np.mean([s.psnr for s in scores]) for scores in (found, without))
        rows.append([name, f"{psnr:.2f}", f"{np.mean([s.ssim for s in found]):.3f}", f"{base_psnr:.2f}"])
        pair = (truths[SHOWN % len(truths)], pictures[SHOWN % len(pictures)])
        columns.append(np.concatenate([composite(picture, (1.0, 1.0, 1.0)) for picture in pair]))
    header = ["transfer function", "PSNR, dB", "SSIM", "the base picture instead, dB"]
    size = f"{cameras[0].width}x{cameras[0].height}"
    described = f"{len(cameras)} test views of {size} of the test member Re = 1890, on white."
    return f"{described}\n\n{table(header, rows)}", np.concatenate(columns, axis=1)


def main() -> None:
    """Write the page and its picture."""
    options = command_line("transfer_functions", __doc__)
    options.add_argument("--quick", action="store_true", help="few views: does it run?")
    options.add_argument("--output", type=Path, default=DOCS, help="folder that holds transfer_functions.md")
    given = options.parse_args()
    body, sheet = measured(16 if given.quick else 2)
    made = f"{made_by('transfer_functions', 'surrogate', 'native', 'scenes', 'benchmarks')}, seed 0."
    opaque = np.concatenate([sheet, np.ones_like(sheet[..., :1])], axis=2)  # [2 H, K W, 4]
    write_image(given.output / "transfer_functions.png", (255.0 * opaque).round().astype(np.uint8))
    failed = write_parts(given.output / "transfer_functions.md", {"any": lambda: body}, made, print)
    raise SystemExit(bool(failed))


if __name__ == "__main__":
    main()
