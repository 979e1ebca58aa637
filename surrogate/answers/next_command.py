"""`surrogate ask next`: the runs to simulate next."""

from __future__ import annotations

import json
from pathlib import Path

import click

from catalogs.commands import one_line_errors
from catalogs.files import durable
from surrogate.command_line import RUNS, SCENE, OpenRun, load_surrogate

AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@click.command("next")
@SCENE
@RUNS
@click.option("-n", "--count", type=click.IntRange(min=1, max=256), default=8, show_default=True, help="Runs.")
@click.option("-o", "output", type=click.Path(dir_okay=False, path_type=Path), help="Write the runs there (CSV).")
@click.option("--figure", type=click.Path(dir_okay=False, path_type=Path), help="Draw the learning curve there.")
@click.option("--seed", type=int, default=0, show_default=True)
@AS_JSON
def suggest(
    scene: Path, runs: Path, count: int, output: Path | None, figure: Path | None, seed: int, *, as_json: bool
) -> None:
    """Suggest the next runs of a SCENE or a RUN, and say what they would be worth.

    The table has a row of parameters for each: for a loop, a job array, or the rows of `insitu ensemble`.
    """
    opened = OpenRun.open(scene, runs)
    from surrogate.answers.next_runs import next_runs

    surrogate = load_surrogate(opened.model)
    field = surrogate.field
    with one_line_errors():
        emulators, splits = (None, ()) if field is None else (field.emulators, field.splits)
        suggested = next_runs(opened.catalog, emulators, count, splits=splits, seed=seed)
        if output is not None:
            durable.replace(output, suggested.table().encode())
        if figure is not None:
            from surrogate.answers.figures import save_next_runs

            save_next_runs(suggested, figure)
    if as_json:
        click.echo(json.dumps(suggested.to_json(), indent=1))
        return
    if output is None:
        click.echo(suggested.table(), nl=False)
    for sentence in suggested.sentences():
        click.echo(sentence, err=output is None)
    for path in filter(None, (output, figure)):
        click.echo(f"-> {path}")
