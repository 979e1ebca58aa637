"""Cost for Cinema clients to read tables of few and of many rows: seconds, and the process's peak memory.

    python -m research.benchmarks.stores.clients [--rows 100000,1000000] [--folder DIR]

Each table has the columns of catalogs, and names images that do not exist: only the table is read. The clients are
pycinema's `CinemaDatabaseReader` and cinemasci, each in its own environment (`make clients`) and process, once. Clients
that are not installed are reported.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import click

from catalogs.files import cinema
from catalogs.version import commit
from research.benchmarks.timing import digits

PROJECT = Path(__file__).resolve().parents[3]
HEADER = ["Re", "time", "appearance", "member", "view", "phi", "theta", "split", "member_split", "view_split", "FILE"]
VIEWS = 252
MEASURED = """
import json, resource, sys, time
started = time.perf_counter()
{read}
seconds = time.perf_counter() - started
print(json.dumps([rows, seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]))
"""
READERS = {
    "pycinema": """
from pycinema.filters import CinemaDatabaseReader
started = time.perf_counter()
reader = CinemaDatabaseReader()
reader.inputs.path.set(sys.argv[1], False)
reader.update()
rows = len(reader.outputs.table.get()) - 1
""",
    "cinemasci": """
import cinemasci
started = time.perf_counter()
database = cinemasci.new("cdb", {"path": sys.argv[1]})
database.read_data_from_file()
rows = database.con.execute("SELECT COUNT(*) FROM CINEMA").fetchone()[0]
""",
}


def write_table(path: Path, rows: int) -> None:
    """A database of `rows` rows, without its images."""
    path.mkdir()
    with (path / "data.csv").open("w", newline="") as stream:
        stream.write(cinema.format_rows([HEADER]))
        for first in range(0, rows, VIEWS):
            number = first // VIEWS
            name, at = f"m{number:06d}", (1000.0 + 0.1 * number, 0.5 * (number % 7))
            stream.write(
                cinema.format_rows(
                    [
                        *at,
                        "dvr",
                        name,
                        view,
                        1.5 * view,
                        0.7 * view,
                        "train",
                        "train",
                        "train",
                        f"members/{name}/dvr/{view:03d}.png",
                    ]
                    for view in range(min(VIEWS, rows - first))
                )
            )


def read(client: str, path: Path) -> tuple[int, float, float] | None:
    """Rows, seconds and MB of a client's reading; None where the client is not installed. The import is not timed."""
    python = PROJECT / f".venv-{client}" / "bin" / "python"
    if not python.exists():
        return None
    program = MEASURED.format(read=READERS[client])
    done = subprocess.run([python, "-c", program, path], capture_output=True, text=True, check=True)
    rows, seconds, megabytes = json.loads(done.stdout.strip().splitlines()[-1])
    return rows, seconds, megabytes


@click.command()
@click.option("--rows", default="100000,1000000", show_default=True, help="How many, with commas between.")
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="Where to write; a temporary folder by default."
)
def main(rows: str, folder: Path | None) -> None:
    """Print a line for each client and table."""
    place = Path(tempfile.mkdtemp(dir=folder))
    try:
        click.echo(f"commit {commit()}")
        for count in [int(part) for part in rows.split(",")]:
            path = place / f"{count}.cdb"
            write_table(path, count)
            for client in READERS:
                reading = read(client, path)
                if reading is None:
                    click.echo(f"{client} is not installed: `make clients` does it")
                    continue
                if reading[0] != count:
                    raise click.ClickException(f"{client} read {reading[0]} of {count} rows")
                click.echo(f"{count:>11,} rows: {client} {digits(reading[1])} s, {reading[2]:,.0f} MB")
            shutil.rmtree(path)
    finally:
        shutil.rmtree(place, ignore_errors=True)


if __name__ == "__main__":
    main()
