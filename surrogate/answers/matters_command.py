"""`surrogate ask matters`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from catalogs.commands import one_line_errors
from surrogate.answers.next_command import AS_JSON
from surrogate.answers.sure_command import camera_of, parameters_of
from surrogate.answers.which_command import region_of
from surrogate.command_line import RUNS, SCENE, OpenRun, load_surrogate

OF = click.Choice(("picture", "colour", "opacity", "mean", "minimum", "maximum", "share_above"))


@click.command("matters")
@SCENE
@RUNS
@click.option("-p", "named", multiple=True, metavar="NAME=VALUE", help="A parameter; all of the simulation, or none.")
@click.option("--view", type=click.IntRange(min=0), default=0, show_default=True, help="Stored camera.")
@click.option("--region", metavar="X0,Y0,X1,Y1", help="Pixels to look at.")
@click.option("--of", type=OF, help="Whose variance: of the picture, or a number of the field.  [default: picture]")
@click.option("--above", type=float, metavar="LEVEL", help="Level of --of share_above.")
@click.option("--as-members", is_flag=True, help="Parameters are distributed as the members', not evenly.")
@click.option("-n", "--samples", type=int, help="Base sample, a power of two.  [default: 512]")
@click.option("-o", "output", type=click.Path(dir_okay=False, path_type=Path), help="Draw a figure there.")
@AS_JSON
def matters(
    scene: Path,
    runs: Path,
    named: tuple[str, ...],
    view: int,
    region: str | None,
    of: str | None,
    above: float | None,
    samples: int | None,
    output: Path | None,
    *,
    as_members: bool,
    as_json: bool,
) -> None:
    """Say which parameters matter, to the surrogate of a SCENE or a RUN.

    With parameters: how each changes the picture there, pixel by pixel. Without: first and total Sobol indices over all
    parameters, which takes about 15 seconds.
    """
    opened = OpenRun.open(scene, runs)
    surrogate, catalog = load_surrogate(opened.model), opened.catalog
    from surrogate.answers.sensitivity import Sensitivity, sensitivity
    from surrogate.answers.sobol import SAMPLES, Distribution, SobolIndices, response_of, sobol_indices

    answer: Sensitivity | SobolIndices
    with one_line_errors():
        camera, background = camera_of(catalog, view), catalog.plan.background
        box = None if region is None else region_of(region)
        if named:
            if as_members or (of, above, samples) != (None, None, None):
                raise ValueError("--of, --above, --as-members and -n ask about all parameters: leave out -p")
            parameters = parameters_of(named, [*surrogate.space.names, *surrogate.visualization_names])
            answer = sensitivity(surrogate, parameters, camera, background=background, region=box)
        else:
            response = response_of(surrogate, camera, of or "picture", region=box, level=above, background=background)
            distribution = Distribution.of_members(surrogate.space, catalog) if as_members else None
            answer = sobol_indices(
                surrogate.space, response, distribution, samples=SAMPLES if samples is None else samples
            )
        if output is not None:
            from surrogate.answers.sensitivity_figures import save_indices, save_sensitivity

            if isinstance(answer, SobolIndices):
                save_indices(answer, output)
            else:
                save_sensitivity(answer, output)
    click.echo(json.dumps(answer.to_json(), indent=1) if as_json else "\n".join(answer.sentences))
    if output is not None:
        click.echo(f"-> {output}", err=as_json)
