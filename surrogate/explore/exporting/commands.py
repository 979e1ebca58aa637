"""The explorer's exports on the command line: `surrogate export` and `surrogate sweep`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from catalogs.commands import one_line_errors
from catalogs.progress import ProgressLine
from surrogate.command_line import RUN
from surrogate.explore.exporting.kinds import (
    FILM_STEPS,
    FRAMES_PER_SECOND,
    GAUSSIAN_KINDS,
    KINDS,
    REFIT_STEPS,
    ROW_STEPS,
    SHEET_STEPS,
    SITE,
)

PARAMETERS = click.option(
    "-p",
    "--parameters",
    multiple=True,
    metavar="NAME=VALUE",
    help="Of the simulation or how it is shown, e.g. -p Re=1800 -p isovalue=12 -p c2_opacity=0.4; those of the simulation that "
    "are left out stand in the middle of their bounds, control points of the transfer function where they were.",
)
COLOR_MAP = click.option(
    "--color-map", default="", metavar="NAME", help="Such as viridis, instead of the base's colours."
)
FUNCTION = click.option(
    "--function",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A transfer function in JSON, as the explorer copies it, instead of the base.",
)
ANNOTATE = click.option(
    "--annotate", is_flag=True, help="Write title, settings, legend, box with ticks and axes into a PNG, GIF or MP4."
)
USING = click.option(
    "--using",
    default="",
    metavar="NAME",
    help="Draw by the gaussians, the field or both.  [default: what did best on validation images]",
)
CLIP = click.option(
    "--clip",
    default="",
    metavar="X0,Y0,Z0,X1,Y1,Z1",
    help="Draw what lies in this box alone (world units), by the field.",
)
SLICE = click.option(
    "--slice", default="", metavar="AXIS=PLACE", help="Draw this plane of the field alone, such as z=0.5 (world units)."
)
VIEW = click.option("--view", default=0, show_default=True, help="Number of a viewpoint of the catalog.")
SIZE = click.option(
    "--size", default="", metavar="WxH", help="Pixels of a picture, or such as 2x.  [default: the catalog's]"
)


@click.command()
@RUN
@PARAMETERS
@COLOR_MAP
@FUNCTION
@ANNOTATE
@USING
@CLIP
@SLICE
@VIEW
@SIZE
@click.option("--background", default="", metavar="R,G,B", help="Colour in [0, 1] behind it; else transparent.")
@click.option(
    "--like",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A PNG or EXR of the explorer: shows what it shows, as far as nothing else is asked for.",
)
@click.option(
    "--compare",
    multiple=True,
    metavar="NAME=VALUE",
    help="Of a second picture, elsewhere like the first: a PNG of both and their difference; 'stored' takes the catalog's picture.",
)
@click.option(
    "-a",
    "--appearance",
    multiple=True,
    metavar="NAME",
    help="Write this field, or the one that this appearance shows; repeatable.  [default: all fields]",
)
@click.option(
    "--field-modes",
    type=int,
    help="Modes of the emulated field in a page; 0 leaves it out.  [default: all, where it draws best]",
)
@click.option(
    "--refit",
    default=REFIT_STEPS,
    show_default=True,
    metavar="STEPS",
    type=click.IntRange(min=0),
    help="By which the Gaussians of .glb, .ply or .spz are fitted to our pictures as other viewers draw them; 0: as trained.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="FILE.png, .exr, .html, .glb, .ply, .spz or .vti; a folder names a picture; FOLDER.site is a page for a web host.",
)
def export(run: Path, output: Path, **options: Any) -> None:
    """Write what the surrogate in RUN (such as runs/tgv) shows: a picture, its Gaussians, or its emulated fields as VTI.

    PNG has 8 bits and straight alpha, EXR 32 and premultiplied alpha; both keep how they were made, and what error to expect, if
    the explorer has measured it.  Gaussians for other viewers are glTF (KHR_gaussian_splatting), PLY or SPZ.  HTML is the explorer
    in one file, which a browser opens and draws without a program; a folder FOLDER.site is the same for a web host.  VTI, which
    ParaView opens, has the fields' units and standard deviations.
    """
    _write(run, output, ("png", "exr", "html", SITE, *GAUSSIAN_KINDS, "vti"), options)


@click.command()
@RUN
@click.option("--over", required=True, metavar="NAME", help="The parameter that varies, such as Re or isovalue.")
@click.option("--from", "low", type=float, help="Its first value.  [default: its lower bound]")
@click.option("--to", "high", type=float, help="Its last value.  [default: its upper bound]")
@click.option(
    "--steps",
    type=int,
    help=f"How many pictures.  [default: {SHEET_STEPS}, {ROW_STEPS} of a grid, {FILM_STEPS} of a film]",
)
@click.option("--rows", "down", default="", metavar="NAME", help="A second parameter, which makes a PNG a grid.")
@click.option("--rows-from", type=float, help="Its first value.  [default: its lower bound]")
@click.option("--rows-to", type=float, help="Its last value.  [default: its upper bound]")
@click.option("--rows-steps", default=ROW_STEPS, show_default=True, help="How many rows.")
@PARAMETERS
@COLOR_MAP
@FUNCTION
@ANNOTATE
@USING
@CLIP
@SLICE
@VIEW
@SIZE
@click.option("--background", default="", metavar="R,G,B", help="Colour in [0, 1] behind it.  [default: white]")
@click.option("--fps", default=FRAMES_PER_SECOND, show_default=True, help="Pictures a second of a film.")
@click.option("--there-and-back", is_flag=True, help="Let a film run backwards to where it began.")
@click.option("--caption/--no-caption", default=True, show_default=True, help="Whether a film shows the value.")
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="FILE.png, .gif or .mp4; a folder names it."
)
def sweep(run: Path, output: Path, **options: Any) -> None:
    """Draw what the surrogate in RUN shows over one parameter: a labelled strip, a grid over two, or a film."""
    _write(run, output, ("sheet", "gif", "mp4"), options)


def _write(folder: Path, output: Path, kinds: Sequence[str], options: Mapping[str, Any]) -> None:
    """Write what the options ask for, and say what it is."""
    with one_line_errors():
        endings = {f".{SITE if kind == SITE else KINDS[kind][0]}": kind for kind in kinds}
        is_site = SITE in kinds and output.suffix.lower() == f".{SITE}"
        is_folder = not is_site and (output.is_dir() or (not output.suffix and not output.exists()))
        kind = kinds[0] if is_folder else endings.get(output.suffix.lower())
        if kind is None:
            raise ValueError(f"the file must end with one of {', '.join(endings)}, got {output.name}")
        if options.get("appearance") and kind != "vti":
            raise ValueError(
                f"-a names fields of a .vti file, got {output.name}: -p appearance=NAME draws another appearance"
            )
        if options.get("field_modes") is not None and kind not in ("html", SITE):
            raise ValueError(f"--field-modes is of a page, a .html file or a .site, got {output.name}")
        if options.get("compare") and kind != "png":
            raise ValueError(f"a comparison is a PNG, got {output.name}")
        if is_site and output.exists():
            raise ValueError(f"{output} exists: remove it first, or name another folder")
        if not output.parent.is_dir():
            raise ValueError(f"{output.parent} is not a folder: make it first")
        from catalogs.files import durable
        from surrogate.answers.doubt import Doubt
        from surrogate.explore.exporting.naming import file_name
        from surrogate.explore.exporting.options import extrapolations, from_options
        from surrogate.explore.run import Run

        run = Run.open(folder)
        request: Any = from_options(options, kind, run)
        doubt = None if run.catalog is None else Doubt.stored(run.surrogate, run.catalog, run.folder)
        durable.make_folder(output.parent)
        durable.require_writable(output.parent)
        for sentence in extrapolations(request, run):
            click.echo(sentence, err=True)
        with ProgressLine() as line:
            stage = "fitting" if kind in GAUSSIAN_KINDS else "drawing"
            progress = partial(_count, line, stage)
            content = request.files(run, progress, doubt) if is_site else request.content(run, progress, doubt)
        if is_folder:
            output.mkdir(exist_ok=True)
            output /= f"{file_name(run, request)}.{KINDS[kind][0]}"
        (durable.write_folder if is_site else durable.replace)(output, content)
        size = sum(map(len, content.values() if is_site else [content])) / 1e6
        click.echo(f"{output}: {request.summary(run)}" + (f", {size:.1f} MB" if kind in ("html", SITE) else ""))
        expected = request.expected(run, doubt) if hasattr(request, "expected") else None
        if expected is not None:
            click.echo(expected.sentence)


def _count(line: ProgressLine, stage: str, *counts: Any) -> None:
    if counts:  # of nothing before a picture of a film
        line.count(stage, *counts)
