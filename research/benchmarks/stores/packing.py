"""Cost of a packed catalog beside the original: files, bytes, loading of images, steps of training.

    python -m research.benchmarks.stores.packing runs/tgv/catalog.cdb [--rounds 5] [--steps 100] [--folder DIR]

Loading is the work of training before its first step: all training images of one appearance are decoded into memory.
The layouts take turns, round by round, and times are medians (lowest to highest). A first, untimed round brings both
into the page cache. Training runs once in each layout, from the same seed, and its surrogates must be the same bytes.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import click

from catalogs.store.catalog import Catalog
from catalogs.tools.packing import pack, unpack
from catalogs.version import commit
from research.benchmarks.timing import MeasuredTime, digits, timed
from surrogate import TrainingSettings, train
from surrogate.gaussians import Normalization
from surrogate.storage.checkpoints import fingerprint
from surrogate.training.data import load_examples, training_rows


def load(catalog: Catalog) -> None:
    """Decode all training images of the first appearance."""
    rows = training_rows(catalog, catalog.appearance_names[:1])
    load_examples(catalog, rows, Normalization.of_box(catalog.plan.bounds))


def in_turns(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, MeasuredTime]:
    """Times of several calls in turn."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(rounds + 1):
        for name, call in calls.items():
            milliseconds = timed(call)
            if number:
                taken[name].append(milliseconds)
    return {name: MeasuredTime.of(times) for name, times in taken.items()}


def megabytes(path: Path) -> tuple[int, float]:
    """Number of files, and their megabytes."""
    sizes = [file.stat().st_size for file in path.rglob("*") if file.is_file()]
    return len(sizes), sum(sizes) / 1e6


@click.command()
@click.argument("path", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--rounds", default=5, show_default=True, help="Rounds of loading.")
@click.option("--steps", default=100, show_default=True, help="Training steps of either stage; 0 for none.")
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="Where to write; a temporary folder by default."
)
def main(path: Path, rounds: int, steps: int, folder: Path | None) -> None:
    """Print a table of both layouts."""
    place = Path(tempfile.mkdtemp(dir=folder))
    try:
        seconds = {
            "made": timed(lambda: pack(path, place / "packed.cdb")) / 1e3,
            "unpacked": timed(lambda: unpack(place / "packed.cdb", place / "again.cdb")) / 1e3,
        }
        catalogs = {"folder": Catalog.open(place / "again.cdb"), "packed": Catalog.open(place / "packed.cdb")}
        click.echo(f"{path}: {len(catalogs['folder'].members)} members, commit {commit()}")
        click.echo(f"packing {digits(seconds['made'])} s, unpacking {digits(seconds['unpacked'])} s")
        loading = in_turns({name: lambda of=of: load(of) for name, of in catalogs.items()}, rounds)
        settings = TrainingSettings(canonical_steps=steps, deformation_steps=steps, seed=0)
        marks = in_turns({name: lambda of=of: fingerprint(settings, of) for name, of in catalogs.items()}, rounds)
        training = {
            name: timed(lambda of=of, name=name: train(settings, of, place / name)) if steps else 0.0  # type: ignore[misc]
            for name, of in catalogs.items()
        }
        for name, of in catalogs.items():
            files, size = megabytes(of.path)
            click.echo(
                f"{name:>8}: {files:,} files, {digits(size)} MB; loading {loading[name]} ms; fingerprint {marks[name]} ms; "
                f"{2 * steps} steps and loading {digits(training[name] / 1e3)} s"
            )
        same = {fingerprint(settings, of) for of in catalogs.values()}
        models = {(place / name / "model.safetensors").read_bytes() for name in catalogs} if steps else {b""}
        click.echo(f"the same fingerprint: {len(same) == 1}; the same surrogate: {len(models) == 1}")
    finally:
        shutil.rmtree(place, ignore_errors=True)


if __name__ == "__main__":
    main()
