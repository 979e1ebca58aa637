"""`surrogate train` and `surrogate show`."""

from __future__ import annotations

from pathlib import Path

import click

from catalogs.progress import ProgressLine
from surrogate.command_line import RUN, RUNS, SCENE, OpenScene, load_surrogate, one_line_errors


@click.command()
@SCENE
@RUNS
def train(scene: Path, runs: Path) -> None:
    """Train the surrogate of SCENE (a TOML file) from its catalog; goes on where it was interrupted."""
    opened = OpenScene.open(scene, runs)
    from surrogate.model import Surrogate
    from surrogate.training.run import train as run

    finished = Surrogate.exists(opened.model)
    with one_line_errors(RuntimeError), ProgressLine() as line:
        surrogate = run(opened.settings, opened.catalog, opened.model, progress=line)
    done = f"{surrogate!r} after {surrogate.training['seconds']:.0f} s -> {opened.model}"
    click.echo(f"{opened.model}: nothing to do" if finished else done)


@click.command()
@RUN
def show(run: Path) -> None:
    """Say what the surrogate in RUN is and how it was trained."""
    surrogate = load_surrogate(run / "surrogate")
    click.echo(repr(surrogate))
    for name, value in surrogate.training["settings"].items():
        click.echo(f"  {name:<22} {value}")
    for choice in surrogate.training.get("choices", ()):
        click.echo(f"  needed: {choice['name']:<22} {choice['kept']}")
    click.echo(f"  trained in {surrogate.training['seconds']:.0f} s, {surrogate.training['steps']} steps")
