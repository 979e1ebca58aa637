"""`surrogate ask which`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from catalogs.commands import one_line_errors
from surrogate.answers.next_command import AS_JSON
from surrogate.command_line import RUNS, SCENE, OpenRun, load_surrogate


@click.command("which")
@SCENE
@click.argument("pictures", metavar="PICTURE...", nargs=-1)
@RUNS
@click.option(
    "--camera", metavar="VIEW|search", help="Camera of files that do not keep theirs: a stored one, or searched."
)
@click.option(
    "--value",
    "values",
    multiple=True,
    metavar="NUMBER",
    help="In place of pictures, of the field: mean=0.5, minimum=0, maximum=2, share_above:LEVEL=0.1 or histogram:0,1,2=0.7,0.3.",
)
@click.option("--box", metavar="X0,Y0,Z0,X1,Y1,Z1", help="World corners of the part that --value is about.")
@click.option("--region", metavar="X0,Y0,X1,Y1", help="Only these pixels count.")
@click.option("-o", "output", type=click.Path(dir_okay=False, path_type=Path), help="Draw a figure there.")
@AS_JSON
def which(
    scene: Path,
    pictures: tuple[str, ...],
    runs: Path,
    camera: str | None,
    values: tuple[str, ...],
    box: str | None,
    region: str | None,
    output: Path | None,
    *,
    as_json: bool,
) -> None:
    """Say which parameters draw the PICTUREs, with 90 % intervals.

    A PICTURE is MEMBER:VIEW of the catalog, or an image file; one that was exported knows its camera. The first question of a
    run takes longer: validation members calibrate the intervals.
    """
    opened = OpenRun.open(scene, runs)
    surrogate, catalog = load_surrogate(opened.model), opened.catalog
    from surrogate.answers.number_targets import Wanted
    from surrogate.answers.posterior import invert, invert_numbers
    from surrogate.answers.targets import target_of

    with one_line_errors():
        if bool(pictures) == bool(values):
            raise ValueError("say PICTUREs, or values by --value: one of both")
        targets = [target_of(catalog, picture, camera) for picture in pictures]
        if region is not None:
            pixels = region_of(region)
            targets = [target.region(pixels) for target in targets]
        if values:
            corners = None if box is None else box_of(box)
            answer = invert_numbers(surrogate, [*map(Wanted.of_text, values)], catalog, box=corners)
        else:
            answer = invert(surrogate, targets, catalog, opened.folder)
        if output is not None:
            from surrogate.answers.inverse_figures import save_inverse

            save_inverse(answer, surrogate, targets, catalog.plan.background, output)
    click.echo(json.dumps(answer.to_json(), indent=1) if as_json else "\n".join(answer.sentences))
    if output is not None:
        click.echo(f"-> {output}", err=as_json)


def region_of(text: str) -> tuple[int, int, int, int]:
    """Four whole numbers of "X0,Y0,X1,Y1"; raises ValueError for another text."""
    try:
        x0, y0, x1, y1 = map(int, text.split(","))
    except ValueError:
        raise ValueError(f"--region takes X0,Y0,X1,Y1 in pixels, got {text!r}") from None
    return x0, y0, x1, y1


def box_of(text: str) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Two corners of "X0,Y0,Z0,X1,Y1,Z1"; raises ValueError for another text."""
    try:
        x0, y0, z0, x1, y1, z1 = map(float, text.split(","))
    except ValueError:
        raise ValueError(f"--box takes X0,Y0,Z0,X1,Y1,Z1 in world units, got {text!r}") from None
    return (x0, y0, z0), (x1, y1, z1)
