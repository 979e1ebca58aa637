"""`insitu estimate`: the time and the size of a scene's data set, or of any."""

from __future__ import annotations

from pathlib import Path

import click

from insitu.commands.shell import NAMED_FILE, command


@click.command()
@click.argument("scene", required=False, type=NAMED_FILE)
@click.option(
    "--samples", type=click.IntRange(min=8), help="Samples along each side of a field, where there is no scene."
)
@click.option("--size", type=click.IntRange(min=1), help="Width and height of images then, in pixels.  [default: 256]")
@click.option("--frequency", type=click.IntRange(min=1), help="Of the views then: 10 F² + 2.  [default: 5]")
@click.option("--members", type=click.IntRange(min=1), help="Members then.  [default: 100]")
@click.option("--cores", type=click.IntRange(min=1), help="Cores that share the members.  [default: this machine's]")
def estimate(
    scene: Path | None,
    samples: int | None,
    size: int | None,
    frequency: int | None,
    members: int | None,
    cores: int | None,
) -> None:
    """Estimate time and size of the data set of SCENE (a TOML file), or of fields of --samples.

    Draws 12 views of a few members in a temporary folder, and extrapolates.  Fields of a scene are made: five, one where they are
    simulated.  Without a scene they are smooth waves in a volume rendering.  Times are of the processor.
    """
    with command() as line:
        if (scene is None) == (samples is None):
            raise click.UsageError("give a SCENE, or --samples")
        if scene is not None and (size, frequency, members) != (None, None, None):
            raise click.UsageError("--size, --frequency and --members are the scene's own")
        from catalogs.vocabulary.scene import Scene
        from insitu.ensembles.ensemble import available_cores
        from insitu.ensembles.estimate import estimate, estimate_of_waves

        if scene is not None:
            result = estimate(Scene.load(scene))
        else:
            result = estimate_of_waves(samples or 0, size or 256, frequency or 5, members or 100)
        line.close()
        click.echo(result.on(cores or available_cores()))
