"""`insitu estimate`: the size of a scene's data set."""

from __future__ import annotations

from pathlib import Path

import click

from insitu.commands.shell import NAMED_FILE, command


@click.command()
@click.argument("scene", type=NAMED_FILE)
def estimate(scene: Path) -> None:
    """Estimate the size of the data set of SCENE (a TOML file).

    Makes the fields of a few members, of one where they are simulated, and draws 12 views of each in a temporary folder.  Images
    and fields stand side by side.
    """
    with command() as line:
        from catalogs.vocabulary.scene import Scene
        from insitu.ensembles.estimate import estimate

        result = estimate(Scene.load(scene))
        line.close()
        click.echo(str(result))
