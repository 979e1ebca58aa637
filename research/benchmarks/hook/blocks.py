"""Images of a field in blocks: every rank renders its own block, or one rank gathers and renders the field.

    python -m research.benchmarks.hook.blocks [--sizes 64 128] [--ranks 1 2 4 8] [--views 12] [--pixels 256]

Prints a table of seconds and bytes, and the worst view's error against one rank. Ranks that share cores wait for each
other busily: seconds are meaningful for as many ranks as there are idle cores. Needs mpi4py and mpiexec.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from render.quality import psnr
from research.benchmarks.timing import digits

FUNCTION = TransferFunction(((-1.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.1, 0.0)), ((-1.0, 0.0), (0.0, 0.1), (1.0, 0.8)), 0.4)
SHOWN: dict[str, Appearance] = {
    "volume": VolumeRendering("volume", FUNCTION),
    "shaded": VolumeRendering("shaded", FUNCTION, shaded=True),
    "isosurface": Isosurface("isosurface", 0.3),
}
COLUMNS = (
    "| samples | ranks | shown as | seconds, blocks | seconds, gathered | MB sent by all ranks a view, blocks | "
    "MB sent by all ranks once, gathered | PSNR against one rank |"
)


def gyroid(size: int) -> NDArray[np.float32]:
    """(size, size, size) over a cube of side 2."""
    z, y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, size, dtype=np.float32)] * 3, indexing="ij")
    a, b, c = 5 * x, 6 * y, 4 * z
    return (np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)) / np.float32(1.5)


def cameras(views: int, pixels: int) -> list[Camera]:
    """`views` of the 252 cameras, evenly spread."""
    every = orbit((0.0, 0.0, 0.0), 3.0**0.5, width=pixels, height=pixels)
    return [every[int((i + 0.5) * len(every) / views)] for i in range(views)]


class CountedRanks:
    """Ranks that count the bytes they send to others."""

    def __init__(self, ranks: Any) -> None:
        self.ranks, self.number, self.size, self.bytes = ranks, ranks.number, ranks.size, 0

    def gather(self, value: Any) -> list[Any]:
        """See `insitu.mpi.ranks.Ranks`."""
        gathered: list[Any] = self.ranks.gather(value)
        return gathered

    def fail(self, error: Exception) -> None:
        """See `insitu.mpi.ranks.Ranks`."""
        self.ranks.fail(error)

    def send(self, parts: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """See `insitu.mpi.ranks.Ranks`."""
        self.bytes += sum(part.size for rank, part in enumerate(parts) if rank != self.number)
        received: list[NDArray[np.uint8]] = self.ranks.send(parts)
        return received


def in_blocks(ranks: CountedRanks, size: int, appearance: Appearance, views: Sequence[Camera]) -> dict[str, Any]:
    """Cost and images of rendering in blocks, on rank 0."""
    from insitu.fields.blocks import Blocks
    from insitu.fields.location import FieldLocation
    from insitu.fields.member_fields import LocalField
    from insitu.mpi.ranks import run_on_root
    from insitu.mpi.resampling import even_layout
    from render.blocks import Lattice

    whole = Lattice((size,) * 3, (2 / (size - 1),) * 3, (-1.0,) * 3)
    piece = even_layout(whole, ranks.size).owned[ranks.number]
    assert piece is not None
    block = np.ascontiguousarray(gyroid(size)[tuple(map(slice, piece.start, piece.stop))])
    with Blocks(ranks, LocalField(block, FieldLocation(whole.spacing, whole.place(piece.start)))) as blocks:

        def work() -> dict[str, Any]:
            started = time.perf_counter()
            fields = blocks.take((appearance,), (appearance,))
            pictures = list(fields.drawable(appearance, "vtk").pictures(appearance, views, None, float_output=True))
            seconds = time.perf_counter() - started
            return {"seconds": seconds, "pictures": pictures}

        result: dict[str, Any] = run_on_root(ranks, work, blocks.commands)  # type: ignore[arg-type]
    sent = sum(ranks.gather(ranks.bytes))
    ranks.bytes = 0
    return {**result, "sent": sent}


def gathered(
    ranks: CountedRanks, comm: Any, size: int, appearance: Appearance, views: Sequence[Camera]
) -> dict[str, Any]:
    """Cost and images where rank 0 receives the whole field."""
    from insitu.mpi.resampling import even_layout
    from render import render_views
    from render.blocks import Lattice
    from render.grids import Grid

    whole = Lattice((size,) * 3, (2 / (size - 1),) * 3, (-1.0,) * 3)
    owned = even_layout(whole, ranks.size).owned
    piece = owned[ranks.number]
    assert piece is not None
    block = np.ascontiguousarray(gyroid(size)[tuple(map(slice, piece.start, piece.stop))])
    comm.Barrier()
    started = time.perf_counter()
    parts = ranks.send([block.reshape(-1).view(np.uint8), *[np.empty(0, dtype=np.uint8)] * (ranks.size - 1)])
    pictures: list[Any] = []
    if ranks.number == 0:
        field = np.empty(whole.shape, dtype=np.float32)
        for part, other in zip(parts, owned, strict=True):
            assert other is not None
            box = tuple(map(slice, other.start, other.stop))
            field[box] = part.view(np.float32).reshape(field[box].shape)
        grid = Grid(field, whole.spacing, whole.origin)
        pictures = list(render_views(grid, appearance, views, float_output=True))
    seconds = time.perf_counter() - started
    comm.Barrier()
    sent = sum(ranks.gather(ranks.bytes))
    ranks.bytes = 0
    return {"seconds": seconds, "pictures": pictures, "sent": sent}


def measure(sizes: Sequence[int], views: int, pixels: int, result: Path) -> None:
    """The work of every rank under mpiexec; rank 0 writes JSON, and the images beside it."""
    from mpi4py import MPI

    from insitu.mpi.ranks import Communicator

    comm = MPI.COMM_WORLD
    ranks, rows = CountedRanks(Communicator(comm)), []
    for size in sizes:
        for name, appearance in SHOWN.items():
            shown = cameras(views, pixels)
            in_blocks(ranks, 16, appearance, shown[:1])  # the first image of a process takes seconds
            blocks = in_blocks(ranks, size, appearance, shown)
            whole = gathered(ranks, comm, size, appearance, shown)
            if comm.rank == 0:
                np.save(result.with_name(f"{comm.size}-{size}-{name}.npy"), np.stack(blocks["pictures"]))
                row = {
                    key: {k: v for k, v in of.items() if k != "pictures"}
                    for key, of in (("blocks", blocks), ("whole", whole))
                }
                rows.append({"size": size, "shown": name, **row})
    if comm.rank == 0:
        result.write_text(json.dumps(rows))


def table(folder: Path, ranks: Sequence[int], views: int) -> list[str]:
    """The lines of the table."""
    lines = [COLUMNS, "|" + " --- |" * COLUMNS.count(" |")]
    for count in ranks:
        for row in json.loads((folder / f"{count}.json").read_text()):
            name = f"{row['size']}-{row['shown']}.npy"
            one, these = np.load(folder / f"{ranks[0]}-{name}"), np.load(folder / f"{count}-{name}")
            worst = min(psnr(a, b) for a, b in zip(these, one, strict=True))
            blocks, whole = row["blocks"], row["whole"]
            cells = [
                f"{row['size']}³",
                str(count),
                row["shown"],
                digits(blocks["seconds"]),
                digits(whole["seconds"]),
                digits(blocks["sent"] / views / 1e6),
                digits(whole["sent"] / 1e6),
                "the same" if np.isinf(worst) else f"{worst:.0f} dB",
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


@click.command()
@click.option("--sizes", multiple=True, type=int, default=(64, 128), help="Samples along each axis.")
@click.option("--ranks", multiple=True, type=int, default=(1, 2, 4, 8))
@click.option("--views", type=int, default=12)
@click.option("--pixels", type=int, default=256)
@click.option("--result", type=click.Path(path_type=Path), hidden=True)
def main(sizes: tuple[int, ...], ranks: tuple[int, ...], views: int, pixels: int, result: Path | None) -> None:
    """Print the table."""
    if result is not None:
        measure(sizes, views, pixels, result)
        return
    beside = Path(sys.executable).parent / "mpiexec"
    mpiexec = str(beside) if beside.is_file() else shutil.which("mpiexec")
    if mpiexec is None:
        raise click.ClickException("no mpiexec is found: pip install mpi4py mpich")
    with tempfile.TemporaryDirectory() as scratch:
        for count in ranks:
            options = [f"--sizes={size}" for size in sizes] + [f"--views={views}", f"--pixels={pixels}"]
            program = [
                sys.executable,
                "-m",
                "research.benchmarks.hook.blocks",
                *options,
                f"--result={scratch}/{count}.json",
            ]
            environment = {**os.environ, "LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
            subprocess.run([mpiexec, "-n", str(count), *program], check=True, env=environment)
        click.echo("\n".join(table(Path(scratch), ranks, views)))


if __name__ == "__main__":
    main()
