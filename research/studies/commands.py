"""`repeat`, `ablate`, `compare`, `ceiling` and `stress` of `python -m research.studies`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from catalogs.commands import one_line_errors
from catalogs.progress import ProgressLine
from surrogate.command_line import RESULTS, RUNS, SCENE, OpenRun, load_surrogate

if TYPE_CHECKING:
    from catalogs.engines.engine import Engine

MEASURED = Path("research/records")
RECORDS = click.option(
    "--records",
    type=click.Path(path_type=Path),
    help="Folder with cached results; runs with the same settings and code are skipped.  "
    f"[default: {MEASURED} if it exists and --runs is not given, otherwise that of --runs]",
)
ENGINE = click.option("--engine", metavar="dask://HOST:PORT", help="Train on the workers of a Dask cluster.")


@dataclass(frozen=True, eq=False)
class StudiedRun:
    """A run, and the folder of its measured records, such as research/records/tgv."""

    run: OpenRun
    records: Path

    @classmethod
    def open(cls, path: Path, runs: Path, records: Path | None) -> StudiedRun:
        """The run that `path` names, a scene file or a run's folder; raises ClickException for errors that the user can fix."""
        run = OpenRun.open(path, runs)
        if records is None and not run.is_of_catalog:
            records = MEASURED if runs == RESULTS and MEASURED.is_dir() else runs
        return cls(run, run.folder if records is None else records / run.name)

    @contextlib.contextmanager
    def engine_at(self, address: str | None, line: ProgressLine) -> Iterator[Engine | None]:
        """The engine at `address`, whose workers see the run's catalog, results and records; None for None."""
        from catalogs.engines.address import opened

        read = [self.run.catalog.path / "catalog.json"]
        with opened(address, [self.run.folder, self.records], line.say, files=read) as engine:
            yield engine


@click.command()
@SCENE
@RUNS
@RECORDS
@click.option("--seeds", default=3, show_default=True, help="Number of seeds, beginning with the scene's own.")
@ENGINE
def repeat(scene: Path, runs: Path, records: Path | None, seeds: int, engine: str | None) -> None:
    """Train a SCENE, or a RUN again, with several seeds and report the variation of its figures. Resumes where it was interrupted.

    The model with the scene's own seed is that of `surrogate train`; the others lie in RUNS/<scene>/seeds.
    """
    studied, line = StudiedRun.open(scene, runs, records), ProgressLine()
    opened = studied.run
    from research.studies.repeats.run import repeat as run
    from research.studies.repeats.seeds import Scores, summarize_repeats
    from research.studies.repeats.table import terminal_lines, write_page

    def tell(scores: Scores) -> None:
        line.close()
        psnr = scores.cells["psnr"]["unseen_views"]["unseen_parameters"]
        reached = "" if psnr is None else f"{psnr:.2f} dB at unseen views and parameters, "
        click.echo(f"seed {scores.seed}: {reached}trained in {scores.seconds:.0f} s")

    resumed = "finished seeds are stored; run the same command to resume"
    with one_line_errors(RuntimeError, interrupted=resumed), line, studied.engine_at(engine, line) as hands:
        of_scene = opened.settings, opened.catalog, opened.folder
        scores = run(*of_scene, records=studied.records, seeds=seeds, engine=hands, progress=line, tell=tell)
    opened.keep_record()
    summary = summarize_repeats(scores)
    if summary is not None:
        click.echo(f"mean ± standard deviation over {len(scores)} seeds")
        for text in terminal_lines(summary):
            click.echo(f"  {text}")
    click.echo(write_page(opened.folder, opened.name, str(opened.source), scores))


@click.command()
@SCENE
@RUNS
@RECORDS
@click.option("--seconds", default=180.0, show_default=True, help="Processor time of each fit.")
@click.option("--seeds", default=3, show_default=True, help="Number of seeds per variant.")
@click.option("--only", multiple=True, metavar="NAME[,NAME...]", help="Variants; the default one is always included.")
@click.option(
    "--longest", type=float, help="Time limit in seconds of a fit with given steps.  [default: ten times --seconds]"
)
@click.option("--again", is_flag=True, help="Repeat fits that took 15 % more or less than --seconds.")
@click.option("--visualization", is_flag=True, help="Train F_vis alone, on the scene's finished surrogate.")
@ENGINE
def ablate(
    scene: Path,
    runs: Path,
    records: Path | None,
    only: tuple[str, ...],
    visualization: bool,
    engine: str | None,
    **options: Any,
) -> None:
    """Train variants of a SCENE or a RUN for equal time each and compare them on validation images. Can be interrupted.

    Several instances share the fits: with `taskset`, start one for each core. Other load on the machine changes little.
    With --engine all workers should be of one kind, since each fit gets the same processor time.
    """
    studied, line = StudiedRun.open(scene, runs, records), ProgressLine()
    opened = studied.run
    from research.studies.ablation.experiments import BaseExperiment, Experiment, VisualizationExperiment
    from research.studies.ablation.records import AblationResult
    from research.studies.ablation.study import ablate as run
    from research.studies.ablation.table import PAGE, verdict

    names = [name.strip() for given in only for name in given.split(",")]

    def tell(result: AblationResult) -> None:
        line.close()
        done = f"{result.psnr:.2f} dB after {result.steps:,} steps in {result.seconds:.0f} s"
        click.echo(f"{result.variant}, seed {result.seed}: {result.error or done}")

    resumed = "finished fits are stored; run the same command to resume"
    with one_line_errors(RuntimeError, interrupted=resumed):
        experiment: Experiment = (
            VisualizationExperiment(opened.settings, opened.catalog, load_surrogate(opened.model))
            if visualization
            else BaseExperiment(opened.settings, opened.catalog)
        )
        folder, options["records"] = opened.folder / experiment.folder, studied.records / experiment.folder
        with line, studied.engine_at(engine, line) as options["engine"]:
            rows = run(opened.name, experiment, folder, only=names, progress=line, tell=tell, **options)
    click.echo(verdict(rows))
    click.echo(folder / PAGE)


@click.command()
@SCENE
@RUNS
@RECORDS
@click.option(
    "--methods",
    multiple=True,
    metavar="NAME[,NAME...]",
    help="Compared methods.  [default: the usual ones]",
)
@click.option("--minutes", default="5", show_default=True, metavar="M[,M...]", help="Processor time of each training.")
@click.option("--seeds", default=1, show_default=True, help="Trainings of each method for each time.")
@click.option(
    "--published",
    is_flag=True,
    help="Use the published sizes and numbers of steps, instead of --minutes and of sizes for a processor.",
)
@click.option(
    "--device",
    type=click.Choice(["cpu", "cuda"]),
    default="cpu",
    show_default=True,
    help="Device of all trainings.  On a GPU, minutes are wall-clock time.",
)
@click.option(
    "--stop-after",
    type=float,
    default=math.inf,
    metavar="MINUTES",
    help="Stop after this time; run the same command to resume.",
)
@click.option(
    "--threads",
    default=1,
    show_default=True,
    help="Torch threads in the training of published methods; rendering of Gaussians uses all available cores.",
)
@click.option(
    "--tune", is_flag=True, help="Choose each method's rates on this scene, for all scenes, instead of comparing."
)
@ENGINE
def compare(
    scene: Path,
    runs: Path,
    records: Path | None,
    methods: tuple[str, ...],
    minutes: str,
    seeds: int,
    tune: bool,
    engine: str | None,
    **form: Any,
) -> None:
    """Train published methods and ours on a SCENE's or a RUN's images, for equal time each, and compare them on test images.

    Several instances share the trainings: with `taskset`, start one for each core. Finished results are stored, and an
    interrupted training of a published method resumes from its last checkpoint. With --engine all workers should be of
    one kind, since each training gets the same processor time.
    """
    if engine is not None and form["stop_after"] < math.inf:
        raise click.ClickException("--stop-after is for this machine: with --engine, Ctrl-C cancels queued trainings")
    studied, line = StudiedRun.open(scene, runs, records), ProgressLine()
    opened = studied.run
    from research.studies.comparison import run as comparing
    from research.studies.comparison.fitting import OutOfTime
    from research.studies.comparison.result import ComparisonResult

    def tell(result: ComparisonResult) -> None:
        line.close()
        click.echo(comparing.line(result))

    def tell_rate(method: str, rate: float, psnr: float | None) -> None:
        line.close()
        click.echo(f"{method}, {rate:g} times its rates: {'diverged' if psnr is None else f'{psnr:.2f} dB'}")

    resumed = "finished results are stored; run the same command to resume"
    names = [name.strip() for given in methods for name in given.split(",")]
    with one_line_errors(RuntimeError, interrupted=resumed), line, studied.engine_at(engine, line) as hands:
        options = comparing.RunOptions(names, comparing.times_of(minutes), seeds, **form)
        study = comparing.study_of(opened.name, opened.catalog, opened.folder, studied.records, options, line)
        if tune:
            comparing.tune_all(opened.name, study, line, tell_rate, hands)
            return
        if as_published := study.at_published_rates():
            line.close()
            click.echo(
                f"trained at published rates: {', '.join(as_published)}; {study.all_records} has no tuned ones, --tune chooses them"
            )
        try:
            study.run(line, tell, hands)
        except OutOfTime:
            raise RuntimeError(f"stopped after {form['stop_after']:g} minutes, before the end: {resumed}") from None
        click.echo(comparing.write_page(opened.name, study))


@click.command()
@SCENE
@RUNS
@RECORDS
def ceiling(scene: Path, runs: Path, records: Path | None) -> None:
    """Measure the per-member upper bound of a SCENE or a RUN: its Gaussians fitted to one unseen member alone, beside
    the surrogate."""
    studied = StudiedRun.open(scene, runs, records)
    opened = studied.run
    from research.studies.upper_bound import line, measure_upper_bound
    from research.studies.upper_bound_records import FOLDER
    from surrogate.model import Surrogate

    surrogate = load_surrogate(opened.model) if Surrogate.exists(opened.model) else None
    with one_line_errors(), ProgressLine() as shown:
        entries = measure_upper_bound(opened.settings, opened.catalog, studied.records, surrogate, progress=shown)
    for entry in entries:
        click.echo(line(entry))
    click.echo(studied.records / FOLDER)


@click.command()
@click.option("--backend", default="cpu", show_default=True, help="Backend of surrogate.splatting.render.")
@click.option("--drift/--no-drift", default=True, show_default=True, help="Also compare training in both precisions.")
@click.option(
    "-o", "--output", default="stress", show_default=True, help="Folder of the page.", type=click.Path(path_type=Path)
)
def stress(backend: str, drift: bool, output: Path) -> None:
    """Check the splatting engine on a table of hard cases; writes stress.md and stress.png, and fails if a case fails."""
    from native import kernels
    from research.studies.stress.check import CaseOutcome, tables
    from research.studies.stress.drift import measure_drift
    from research.studies.stress.functions import FunctionOutcome, check_function, function_cases
    from research.studies.stress.report import PAGE, write
    from surrogate.splatting import BACKENDS
    from surrogate.splatting.threads import one_torch_thread

    if backend not in BACKENDS:
        raise click.ClickException(f"--backend must be one of {sorted(BACKENDS)}, got {backend!r}")
    sets = kernels.instruction_sets() if backend == "cpu" else [""]
    options = {
        f"{backend} {name}".strip(): {"backend": backend} | ({"instruction_set": name} if name else {}) for name in sets
    }

    def tell(name: str, outcome: CaseOutcome | FunctionOutcome) -> None:
        said = "passed" if outcome.passed else "FAILED"
        click.echo(f"{said}  {name}  {outcome.case.name}  {'; '.join(outcome.complaints)}")

    with one_torch_thread():
        outcomes = tables(options, tell)
        functions = [check_function(case) for case in function_cases()]
        for one in functions:
            tell("values", one)
        drifted = measure_drift(backend) if drift else None
    write(output, outcomes, drifted, functions)
    missed = [outcome.case.name for rows in outcomes.values() for outcome in rows if not outcome.passed]
    missed += [outcome.case.name for outcome in functions if not outcome.passed]
    missed += drifted.complaints if drifted else ()
    click.echo(f"{output / PAGE}: {'all cases pass' if not missed else f'{len(missed)} cases fail'}")
    if missed:
        raise click.ClickException("; ".join(missed))
