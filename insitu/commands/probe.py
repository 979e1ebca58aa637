"""`insitu probe`: what is in a field, and how it may be shown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from catalogs.vocabulary.words import joined_names
from insitu.commands import shell
from insitu.commands.reading import NAMES, PARAMETERS, ReadingOptions, code_options, is_ensemble, pilots, suggested
from insitu.commands.shell import command


@click.command()
@click.argument("sources", nargs=-1, required=True, type=shell.PATH)
@click.option("--members", "count", default=5, show_default=True, help="Pilot members of an ensemble to look at.")
@click.option("--alpha", default=0.5, show_default=True, help="Mean alpha that the foreground should have.")
@click.option(
    "--array",
    "arrays",
    multiple=True,
    help="Which of several fields: an array of VTK files, a data set of HDF5, a field of a scene; several, one by one.",
)
@PARAMETERS
@NAMES
@click.option("--spacing", type=float, nargs=3, help="Distance between values, x y z, of .npy files.")
@code_options
@shell.NAN
@click.option("--preview", type=shell.PATH, help="Write a picture of the suggestion (PNG).")
def probe(
    sources: tuple[Path, ...],
    count: int,
    alpha: float,
    arrays: tuple[str, ...],
    parameters: str | None,
    names: str | None,
    spacing: tuple[float, float, float] | None,
    nan: str | None,
    preview: Path | None,
    **codes: Any,
) -> None:
    """Look at pilot members and suggest a transfer function.

    SOURCES: a scene's TOML file (its simulation is run, or its file read), or an ensemble, as `insitu ensemble` takes it.  One file
    per member will do, too: .npy, .npz, HDF5, netCDF, Zarr, any that pyvista reads, or a dump of a code that --reader lists.
    The output is a file for --appearance, with all measurements as comments.
    """
    with command():
        reading = ReadingOptions(arrays=arrays, parameters=parameters, names=names, spacing=spacing or None, **codes)
        fields = _read(sources, count, reading, nan or "refuse")
        for name, (measured, suggestion) in suggested(fields, alpha).items():
            alphas = ", ".join(f"{alpha:.2f}" for alpha in suggestion.alphas)
            remarks = [f"field {name}"] * (len(fields) > 1) + str(measured).splitlines()
            for line in (*remarks, f"mean foreground alpha by member: {alphas}"):
                click.echo(f"# {line}".rstrip())
            click.echo(f"\n{suggestion.toml()}")
            if preview is not None:
                _preview(preview, fields[name], suggestion.appearance, name if len(fields) > 1 else "")


def _preview(path: Path, grids: dict[str, Any], appearance: Any, field: str) -> None:
    """A picture of the suggestion; of one of several fields beside `path`, with the appearance in its name."""
    from catalogs.files.images import write_image
    from insitu.ensembles.suggestion import contact_sheet

    path = path.with_stem(f"{path.stem}-{appearance.name}") if field else path
    write_image(path, contact_sheet(list(grids.values()), appearance))
    click.echo(f"# {path}: one member per row")


def _read(sources: tuple[Path, ...], count: int, reading: ReadingOptions, nan: str) -> dict[str, dict[str, Any]]:
    """Grids by field and member of what is to be looked at."""
    first, arrays = sources[0], reading.arrays
    if len(sources) == 1 and first.suffix == ".toml":
        from catalogs.vocabulary.scene import Scene
        from insitu.ensembles.sources import ensemble_of

        ensemble = ensemble_of(Scene.load(first))
        return _chosen(pilots(ensemble.source, ensemble.members, count, nan, ensemble.space), arrays)
    from insitu.readers.files import read_field

    if len(sources) == 1 and is_ensemble(first):
        source = reading.open([str(first)])
        return pilots(source, source.members(), count, nan)
    place = reading.location
    how: dict[str, Any] = {"spacing": place.spacing, "origin": place.origin, "dims": place.dims, "nan": nan}
    how |= {"reader": reading.reader, "sampling": reading.sampling}
    alike = len({path.name for path in sources}) < len(sources)  # as run_1/dump.vti, run_2/dump.vti
    return {
        array or "": {str(path) if alike else path.name: read_field(path, array=array, **how) for path in sources}
        for array in arrays or (None,)
    }


def _chosen(fields: dict[str, dict[str, Any]], names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """The fields asked for by name, all by default."""
    unknown = [name for name in names if name not in fields]
    if unknown:
        raise ValueError(
            f"--array: the scene's fields are {joined_names(fields)}, got {joined_names(unknown)}: name more in source.fields"
        )
    return {name: fields[name] for name in names} or fields
