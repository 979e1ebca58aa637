"""Cost of rendering one member by the size of its field: processor time, memory and disk.

    python -m research.benchmarks.hook.member_cost [--sizes 64 128 256, ascending] [--pixels 256] [--members 3]
    [--for 10000] [--cores 200]

Renders members of an analytic field from 252 viewpoints into a temporary folder, in one process with one thread, and
prints a table. It also extrapolates to an ensemble on many cores at the same cost per member. A second table has the
share of the coarse fields in that. Takes minutes.
"""

from __future__ import annotations

import os
import resource
import statistics
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.coarse import CoarseField, coarse_bytes
from catalogs.vocabulary.scene import ViewPlan
from insitu.ensembles.estimate import SHEETS, waves
from insitu.fields.member_fields import Fields
from insitu.hook.session import Session
from render.datasets import to_grid
from research.benchmarks.page import command_line, table
from research.benchmarks.timing import digits, processor_seconds

DAY = 86400.0  # seconds


@dataclass(frozen=True)
class Cost:
    """Cost of a member: processor seconds, bytes and files on disk, and the bytes of its coarse field among them."""

    seconds: float
    bytes: int
    files: int
    field_bytes: int


@dataclass(frozen=True)
class CoarseCost:
    """Cost of a member's coarse field: its samples, and seconds of processor time to average and to encode them."""

    shape: tuple[int, ...]
    averaging: float
    encoding: float


def measure(size: int, pixels: int, members: int, folder: Path) -> Cost:
    """Medians over `members` members after a first one, which also plans the catalog."""
    views = ViewPlan(width=pixels, height=pixels)
    costs = []
    with Session(folder, space={"phase": (0.0, 10.0)}, appearances=SHEETS, views=views) as session:
        for number in range(members + 1):
            field, results = waves(size, number), []

            def render(
                field: NDArray[np.float32] = field, number: int = number, results: list[object] = results
            ) -> None:
                spacing = (2.0 / (size - 1),) * 3
                results.append(session.render_member(field, {"phase": number}, spacing=spacing, origin=(-1.0,) * 3))

            seconds, (result,) = processor_seconds(render), session.results[-1:]
            files = [path for path in result.path.rglob("*") if path.is_file()]
            costs.append(Cost(seconds, sum(f.stat().st_size for f in files), len(files), result.sizes.fields))
    return Cost(*(statistics.median(getattr(cost, name) for cost in costs[1:]) for name in Cost.__annotations__))


def measure_coarse(size: int, members: int) -> CoarseCost:
    """Medians over `members` fields after a first one."""
    costs = []
    for number in range(members + 1):
        fields, coarse = Fields({"": to_grid(waves(size, number), spacing=2.0 / (size - 1))}), dict[str, CoarseField]()
        averaging = processor_seconds(partial(lambda f, c: c.update(f.coarse([""])), fields, coarse))
        costs.append((averaging, processor_seconds(partial(coarse_bytes, coarse))))
    averaging, encoding = (statistics.median(column) for column in zip(*costs[1:], strict=True))
    return CoarseCost(coarse[""].values.shape, averaging, encoding)


def main() -> None:
    parser = command_line("hook.member_cost", __doc__)
    parser.add_argument("--sizes", nargs="+", type=int, default=[64, 128, 256], help="samples along each axis")
    parser.add_argument("--pixels", type=int, default=256)
    parser.add_argument("--members", type=int, default=3, help="how many are measured of each size (default: 3)")
    parser.add_argument("--for", dest="ensemble", type=int, default=10_000, help="members to extrapolate to")
    parser.add_argument("--cores", type=int, default=200, help="cores to extrapolate to")
    arguments = parser.parse_args()
    os.environ["LP_NUM_THREADS"] = "1"
    rows, coarse_rows = [], []
    for size in arguments.sizes:
        with tempfile.TemporaryDirectory() as scratch:
            cost = measure(size, arguments.pixels, arguments.members, Path(scratch) / "a.cdb")
        coarse = measure_coarse(size, arguments.members)
        seconds = coarse.averaging + coarse.encoding
        coarse_rows.append(
            [
                f"{size}³",
                " x ".join(map(str, coarse.shape[::-1])),
                f"{digits(1e3 * coarse.averaging)} ms",
                f"{digits(1e3 * coarse.encoding)} ms",
                f"{digits(100 * seconds / cost.seconds)} %",
                f"{digits(cost.field_bytes / 1e6)} MB",
                f"{digits((cost.bytes - cost.field_bytes) / 1e6)} MB",
            ]
        )
        total = arguments.ensemble * cost.seconds
        rows.append(
            [
                f"{size}³",
                f"{digits(cost.seconds)} s",
                f"{digits(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)} MB",
                f"{digits(cost.bytes / 1e6)} MB",
                str(int(cost.files)),
                f"{digits(total / 3600)} h",
                f"{digits(total / 3600 / arguments.cores)} h",
                f"{digits(arguments.ensemble * cost.bytes / 1e9)} GB",
                f"{arguments.ensemble * int(cost.files):,}",
            ]
        )
    ensemble = f"{arguments.ensemble:,} members"
    head = ["samples", "processor time", "memory of the process", "disk", "files", f"{ensemble}: processor time"]
    print(table([*head, f"on {arguments.cores} cores", "disk", "files"], rows))
    head = [
        "samples",
        "coarse field",
        "averaging",
        "encoding",
        "share of the member's time",
        "its bytes",
        "all others'",
    ]
    print(table(head, coarse_rows))


if __name__ == "__main__":
    main()
