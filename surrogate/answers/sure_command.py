"""`surrogate ask sure`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from catalogs.commands import one_line_errors
from surrogate.answers.next_command import AS_JSON
from surrogate.command_line import RUNS, SCENE, OpenRun, assignment, load_surrogate

if TYPE_CHECKING:  # --help loads nothing heavy
    from catalogs.store.catalog import Catalog
    from catalogs.vocabulary.cameras import Camera


@click.command("sure")
@SCENE
@RUNS
@click.option("-p", "named", multiple=True, metavar="NAME=VALUE", help="A parameter; all of the simulation.")
@click.option("--view", type=click.IntRange(min=0), default=0, show_default=True, help="Stored camera.")
@click.option(
    "-o",
    "output",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Draw picture and error map there.",
)
@AS_JSON
def sure(scene: Path, runs: Path, named: tuple[str, ...], view: int, output: Path | None, *, as_json: bool) -> None:
    """Say how sure the surrogate of a SCENE or a RUN is of a picture.

    It takes a minute the first time: members are predicted by emulators that did not learn from them.
    """
    opened = OpenRun.open(scene, runs)
    surrogate, catalog = load_surrogate(opened.model), opened.catalog
    from surrogate.answers.doubt import Doubt
    from surrogate.answers.figures import save_sure
    from surrogate.answers.maps import error_map
    from surrogate.evaluation.metrics import WHITE, composite

    with one_line_errors():
        camera = camera_of(catalog, view)
        names = [*surrogate.space.names, *surrogate.visualization_names]
        parameters = parameters_of(named, names)
        surrogate.at(parameters, outside="allow")  # complains before anything is measured
        doubt = Doubt.of(surrogate, catalog, opened.folder)
        interval = doubt.interval(parameters, camera)
        if output is not None:
            picture = composite(surrogate.at(parameters, outside="allow").render(camera), doubt.background or WHITE)
            errors = error_map(doubt, parameters, camera)
            save_sure(picture, errors, interval.sentence, parameters, output)
    click.echo(json.dumps(interval.to_json(), indent=1) if as_json else interval.sentence)
    if output is not None:
        click.echo(f"-> {output}", err=as_json)


def camera_of(catalog: Catalog, view: int) -> Camera:
    """The stored camera of a number from 0 on; raises ValueError for one beyond the last."""
    from surrogate.answers.targets import views_of

    cameras = views_of(catalog)
    if view >= len(cameras):
        raise ValueError(f"--view must be below {len(cameras)}, the number of stored cameras, got {view}")
    return cameras[view]


def parameters_of(named: tuple[str, ...], names: Sequence[str]) -> dict[str, float | str]:
    """Values by name of arguments NAME=VALUE, for parameters of some `names`; raises ValueError for another form."""
    values: dict[str, float | str] = {}
    for argument in named:
        name, text = assignment(argument, names)
        if not (name and text):
            raise ValueError(f"-p takes NAME=VALUE, got {argument!r}")
        try:
            values[name] = float(text)
        except ValueError:
            values[name] = text
    return values
