"""The `surrogate` command: train, evaluate, look at what came out."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from catalogs.progress import ProgressLine
from surrogate.explore.exporting.commands import export, sweep

if TYPE_CHECKING:
    from catalogs.catalog import Catalog
    from catalogs.scene import Scene
    from surrogate.model import Surrogate

SCENE = click.argument("scene", type=click.Path(dir_okay=False, path_type=Path))
RUNS = click.option(
    "--runs", default="runs", show_default=True, help="Folder of all results.", type=click.Path(path_type=Path)
)


class _Failure(click.ClickException):
    """What the user can mend, in one line."""


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Fit Gaussians to a Cinema catalog and see the ensemble at any view and parameter."""


main.add_command(export)
main.add_command(sweep)


@main.command()
@SCENE
@RUNS
def train(scene: Path, runs: Path) -> None:
    """Train the surrogate of SCENE (a TOML file) from its catalog; goes on where it was interrupted."""
    loaded, catalog = _open(scene, runs)
    from surrogate.model import Surrogate
    from surrogate.training.run import train as run

    directory = loaded.run_directory(runs) / "surrogate"
    finished = Surrogate.exists(directory)
    try:
        with ProgressLine() as line:
            surrogate = run(_settings(loaded), catalog, directory, progress=line)
    except (ValueError, RuntimeError, OSError) as error:
        raise _Failure(str(error)) from error
    seconds = surrogate.training["seconds"]
    click.echo(f"{directory}: nothing to do" if finished else f"{surrogate!r} after {seconds:.0f} s -> {directory}")


@main.command()
@SCENE
@RUNS
def evaluate(scene: Path, runs: Path) -> None:
    """Write the report of SCENE's surrogate: tables, pictures, report.json."""
    loaded, catalog = _open(scene, runs)
    from surrogate.report.report import is_current, write_report

    folder = loaded.run_directory(runs)
    surrogate = _load(folder / "surrogate")
    if is_current(folder / "report", surrogate):
        click.echo(f"{folder / 'report' / 'report.md'}: nothing to do")
        return
    from surrogate.evaluation.evaluate import evaluate as run

    started = time.perf_counter()
    try:
        with ProgressLine() as line:
            evaluation = run(surrogate, catalog, progress=line.count)
        record = write_report(
            folder / "report", loaded.name, surrogate, catalog, evaluation, dataset_seconds=_dataset_seconds(folder)
        )
    except (ValueError, OSError) as error:
        raise _Failure(str(error)) from error
    _summarize(record)
    click.echo(f"{folder / 'report' / 'report.md'} ({time.perf_counter() - started:.0f} s)")


@main.command()
@click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
def show(run: Path) -> None:
    """Say what the surrogate in RUN is and how it was trained."""
    surrogate = _load(run / "surrogate")
    click.echo(repr(surrogate))
    for name, value in surrogate.training["settings"].items():
        click.echo(f"  {name:<22} {value}")
    for choice in surrogate.training.get("choices", ()):
        click.echo(f"  needed: {choice['name']:<22} {choice['kept']}")
    click.echo(f"  trained in {surrogate.training['seconds']:.0f} s, {surrogate.training['steps']} steps")


@main.command()
@click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen on; others need the printed token."
)
@click.option("--port", default=0, help="Port to listen on.  [default: any that is free]")
@click.option("--open/--no-open", "open_page", default=False, help="Open the page in this machine's browser.")
def explore(run: Path, host: str, port: int, open_page: bool) -> None:
    """Fly through the surrogate in RUN (such as runs/tgv-dvr) in a browser, until Ctrl-C."""
    from catalogs.catalog import CatalogError

    try:
        from surrogate.explore.application import explore as serve
        from surrogate.explore.run import Run

        serve(Run.open(run), host=host, port=port, open_page=open_page, announce=click.echo)
    except ModuleNotFoundError as error:
        raise _Failure(f"the explorer needs the package {error.name}: pip install 'gs-surrogate[explore]'") from error
    except (CatalogError, ValueError, OSError) as error:
        raise _Failure(str(error)) from error


@main.command()
@SCENE
@RUNS
@click.option("--seeds", default=3, show_default=True, help="How many seeds, the scene's own the first of them.")
def repeat(scene: Path, runs: Path, seeds: int) -> None:
    """Train SCENE with several seeds, and say how much its figures vary; goes on where it was interrupted.

    The scene's own seed is the model that `surrogate train` makes, or has made; the others lie in RUNS/<scene>/seeds.
    """
    loaded, catalog = _open(scene, runs)
    from surrogate.studies.repeats.records import Scores
    from surrogate.studies.repeats.run import repeat as run
    from surrogate.studies.repeats.spread import summarize_repeats
    from surrogate.studies.repeats.table import terminal_lines, write_page

    folder, line = loaded.run_directory(runs), ProgressLine()

    def tell(scores: Scores) -> None:
        line.close()
        psnr = scores.cells["psnr"]["unseen_views"]["unseen_parameters"]
        reached = "" if psnr is None else f"{psnr:.2f} dB at unseen views and parameters, "
        click.echo(f"seed {scores.seed}: {reached}trained in {scores.seconds:.0f} s")

    try:
        with line:
            found = run(_settings(loaded), catalog, folder, seeds=seeds, progress=line, tell=tell)
    except (ValueError, RuntimeError, OSError) as error:
        raise _Failure(str(error)) from error
    except KeyboardInterrupt:
        click.echo("interrupted: what is trained and scored is kept, and the same command goes on", err=True)
        raise
    record = summarize_repeats(found)
    if record is not None:
        click.echo(f"mean ± standard deviation over {len(found)} seeds")
        for text in terminal_lines(record):
            click.echo(f"  {text}")
    click.echo(write_page(folder, loaded.name, found))


@main.command()
@SCENE
@RUNS
@click.option("--seconds", default=180.0, show_default=True, help="Processor time of each fit.")
@click.option("--seeds", default=3, show_default=True, help="Fits of each variant.")
@click.option("--only", multiple=True, metavar="NAME[,NAME...]", help="Variants; the default is always among them.")
@click.option(
    "--longest", type=float, help="Seconds that a fit of given steps may take.  [default: ten times --seconds]"
)
@click.option("--again", is_flag=True, help="Repeat fits that took 15 % more or less than --seconds.")
@click.option("--visualization", is_flag=True, help="Train F_vis alone, on the scene's finished surrogate.")
def ablate(scene: Path, runs: Path, only: tuple[str, ...], visualization: bool, **options: Any) -> None:
    """Train SCENE in many ways for the same time each and compare them on validation images; goes on where it was interrupted.

    Started several times it shares the fits out: with `taskset` one for each core.  What else the machine does changes little.
    """
    loaded, catalog = _open(scene, runs)
    from surrogate.studies.ablation.fits import BASE_FOLDER, VISUALIZATION_FOLDER, BaseFits, Fits, VisualizationFits
    from surrogate.studies.ablation.records import Result
    from surrogate.studies.ablation.run import ablate as run
    from surrogate.studies.ablation.table import PAGE, verdict

    directory, line = loaded.run_directory(runs), ProgressLine()
    folder = directory / (VISUALIZATION_FOLDER if visualization else BASE_FOLDER)
    names = [name.strip() for given in only for name in given.split(",")]

    def tell(result: Result) -> None:
        line.close()
        done = f"{result.psnr:.2f} dB after {result.steps:,} steps in {result.seconds:.0f} s"
        click.echo(f"{result.variant}, seed {result.seed}: {result.error or done}")

    try:
        settings = _settings(loaded)
        fits: Fits = (
            VisualizationFits(settings, catalog, _load(directory / "surrogate"))
            if visualization
            else BaseFits(settings, catalog)
        )
        with line:
            rows = run(loaded.name, fits, folder, progress=line, tell=tell, only=names, **options)
    except (ValueError, RuntimeError, OSError) as error:
        raise _Failure(str(error)) from error
    except KeyboardInterrupt:
        click.echo("interrupted: finished fits are kept, and the same command goes on with the others", err=True)
        raise
    click.echo(verdict(rows))
    click.echo(folder / PAGE)


@main.command()
@SCENE
@RUNS
def ceiling(scene: Path, runs: Path) -> None:
    """Fit SCENE's Gaussians to one unseen member alone: what they could reach at all, beside what the surrogate reaches."""
    loaded, catalog = _open(scene, runs)
    from surrogate.model import Surrogate
    from surrogate.studies.ceiling import FOLDER, line, measure_ceiling

    folder = loaded.run_directory(runs)
    surrogate = _load(folder / "surrogate") if Surrogate.exists(folder / "surrogate") else None
    try:
        with ProgressLine() as shown:
            entries = measure_ceiling(_settings(loaded), catalog, folder, surrogate, progress=shown)
    except (ValueError, OSError) as error:
        raise _Failure(str(error)) from error
    for entry in entries:
        click.echo(line(entry))
    click.echo(folder / FOLDER)


@main.command()
@click.option("--backend", default="cpu", show_default=True, help="Of surrogate.splatting.render.")
@click.option(
    "--drift/--no-drift", default=True, show_default=True, help="Whether training is tried in both precisions."
)
@click.option(
    "-o", "--output", default="stress", show_default=True, help="Folder of the page.", type=click.Path(path_type=Path)
)
def stress(backend: str, drift: bool, output: Path) -> None:
    """Hold the splatting engine to a table of hard cases; writes stress.md and stress.png, and fails where a row does."""
    import native
    from surrogate.splatting import BACKENDS
    from surrogate.splatting.threads import one_torch_thread
    from surrogate.studies.stress.check import Outcome
    from surrogate.studies.stress.drift import measure_drift
    from surrogate.studies.stress.report import PAGE, write
    from surrogate.studies.stress.table import table

    if backend not in BACKENDS:
        raise _Failure(f"--backend must be one of {sorted(BACKENDS)}, got {backend!r}")
    sets = native.instruction_sets() if backend == "cpu" else [""]
    options = {
        f"{backend} {name}".strip(): {"backend": backend} | ({"instruction_set": name} if name else {}) for name in sets
    }

    def tell(name: str, outcome: Outcome) -> None:
        click.echo(
            f"{'holds ' if outcome.passed else 'MISSED'}  {name}  {outcome.case.name}  {'; '.join(outcome.complaints)}"
        )

    with one_torch_thread():
        tables = {name: table(chosen, lambda o, n=name: tell(n, o)) for name, chosen in options.items()}  # type: ignore[misc]
        drifted = measure_drift(backend) if drift else None
    write(output, tables, drifted)
    missed = [o.case.name for rows in tables.values() for o in rows if not o.passed] + list(
        drifted.complaints if drifted else ()
    )
    click.echo(f"{output / PAGE}: {'all rows hold' if not missed else f'{len(missed)} rows are missed'}")
    if missed:
        raise _Failure("; ".join(missed))


def _open(path: Path, runs: Path) -> tuple[Scene, Catalog]:
    from catalogs.catalog import Catalog, CatalogError
    from catalogs.scene import Scene

    try:
        scene = Scene.load(path)
        folder = scene.run_directory(runs) / "catalog.cdb"
        if not folder.is_dir():
            raise FileNotFoundError(f"{folder} does not exist yet: make it with `make dataset SCENE={scene.name}`")
        return scene, Catalog.open(folder)
    except (CatalogError, ValueError, FileNotFoundError) as error:
        raise _Failure(str(error)) from error


def _settings(scene: Scene) -> Any:
    from surrogate.settings import TrainingSettings

    try:
        return TrainingSettings(**scene.training)
    except ValueError as error:
        raise _Failure(f"scene {scene.path}: {error}") from error


def _load(directory: Path) -> Surrogate:
    from surrogate.model import Surrogate

    try:
        return Surrogate.load(directory)
    except (FileNotFoundError, ValueError) as error:
        raise _Failure(f"{error} (`make train` makes one)") from error


def _dataset_seconds(folder: Path) -> float | None:
    import json

    try:
        return float(json.loads((folder / "dataset.json").read_text())["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _summarize(record: Mapping[str, Any]) -> None:
    from surrogate.report.variations import variation_line

    for views in ("seen_views", "unseen_views"):
        for parameters in ("seen_parameters", "unseen_parameters"):
            values = [record[metric][views][parameters] for metric in ("psnr", "ssim")]
            if None not in values:
                label = f"{views}, {parameters}".replace("_", " ")
                click.echo(f"  {label:<38} {values[0]:6.2f} dB   SSIM {values[1]:.4f}")
    for entry in record["trivial_predictors"]:
        value = entry["psnr"]["unseen_views"]["unseen_parameters"]
        if value is not None:
            click.echo(f"  {entry['name']:<38.38} {value:6.2f} dB   (unseen views, unseen parameters)")
    for variation in record["variations"]:
        click.echo(f"  {variation_line(variation)}")
