"""`surrogate train` and `surrogate show`."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from catalogs.commands import one_line_errors
from catalogs.progress import ProgressLine
from surrogate.command_line import RUN, RUNS, OpenRun, kind_of, load_surrogate

if TYPE_CHECKING:
    from surrogate.model import Surrogate
    from surrogate.storage.runs import RunFolder, RunRecord
    from surrogate.training.ranks import Ranks


@click.command()
@click.argument("source", metavar="CATALOG|SCENE|RUN", type=click.Path(path_type=Path))
@click.argument("settings", nargs=-1, metavar="[KEY=VALUE]...")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Folder of the run.  [default: runs/<catalog's name>]"
)
@click.option(
    "--minutes",
    type=float,
    help="Time for all of it; Gaussians follow from a stated speed, steps from this machine's.  [default: 10]",
)
@click.option("--steps", type=int, help="Steps of training instead: the same model wherever it is trained.")
@click.option(
    "--hold-out",
    type=float,
    metavar="SHARE",
    help="Of the training members, such as 0.2, to test the surrogate with; dumps of one run stay together.",
)
@click.option("--appearance", metavar="NAME", help="Which of the catalog's to learn.  [default: the first]")
@click.option("--seed", type=int, help="Of all that is drawn at random.  [default: 0]")
@click.option(
    "--settings",
    "file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="A TOML file with keys of a scene's [training].",
)
@click.option(
    "--model",
    type=click.Choice(["both", "field"]),
    default="both",
    show_default=True,
    help="Stop after the emulator of the coarse fields, or train the Gaussians as well.",
)
@click.option(
    "--new-members",
    is_flag=True,
    help="Take in the members that came after RUN began, and go on from its model with their share of the steps.",
)
@RUNS
def train(
    source: Path,
    settings: tuple[str, ...],
    output: Path | None,
    file: Path | None,
    model: str,
    new_members: bool,
    runs: Path,
    **options: Any,
) -> None:
    """Train a surrogate from a CATALOG (NAME.cdb), as a SCENE (FILE.toml) says, or go on with a RUN (its folder).

    KEY=VALUE are keys of a scene's [training] table, such as gaussians=20000.  The same command goes on where it was interrupted,
    and does nothing when all is done.

    Several processes train one surrogate together as `torchrun --standalone --nproc-per-node 4 -m surrogate train CATALOG batch=4`,
    each drawing its share of a step's pictures.
    """
    kind = kind_of(source)
    every = {f"--{name.replace('_', '-')}": value for name, value in options.items()}
    every |= {"--output": output, "--settings": file, "KEY=VALUE": settings or None}
    wrong = [name for name, value in every.items() if value is not None]
    if kind != "catalog" and wrong:
        raise click.ClickException(
            f"{', '.join(wrong)}: for a catalog only; {source} is a {kind}, which says all of this itself"
        )
    if new_members and kind != "run":
        raise click.ClickException(f"--new-members: for the folder of a run only; {source} is a {kind}")
    from surrogate.training.ranks import launched

    resumed = "what was trained is stored; run the same command to resume"
    only_field = model == "field"
    with one_line_errors(RuntimeError, interrupted=resumed), launched() as ranks:
        if kind == "catalog":
            run = _begun(source, output or runs / source.resolve().stem, settings, file, ranks, **options)
            opened = OpenRun.of_run(run)
        else:
            opened = OpenRun.open(source, runs)
        _train(opened, ranks, only_field=only_field, new_members=new_members)


def _begun(
    source: Path, folder: Path, words: tuple[str, ...], file: Path | None, ranks: Ranks, **options: Any
) -> RunFolder:
    """The run of a catalog, begun or found; says what was chosen for it."""
    from surrogate.settings import values_of_words
    from surrogate.storage.runs import RECORD
    from surrogate.training.begin import TrainingOptions, begin, read_settings, seconds_of_process
    from surrogate.training.budget import Budget
    from surrogate.training.messages import opening

    chosen = {} if file is None else read_settings(file)
    chosen |= values_of_words(words)
    chosen |= {name: options[name] for name in ("appearance", "seed") if options[name] is not None}
    wanted = TrainingOptions(Budget(options["minutes"], options["steps"]), options["hold_out"], chosen)
    is_told = ranks.is_first and not (folder / RECORD).is_file()
    with ProgressLine() as line:
        if is_told:
            line("looking at the catalog, and how fast this machine is")
        run = begin(source, folder, wanted, elapsed=seconds_of_process, ranks=ranks)
    for text in opening(run) if is_told else ():
        click.echo(text, err=True)
    return run


def _train(opened: OpenRun, ranks: Ranks, *, only_field: bool, new_members: bool) -> None:
    from surrogate.model import FieldModel
    from surrogate.training.emulator import described
    from surrogate.training.growth import take_place
    from surrogate.training.messages import closing

    opened, growing = _growing(opened, ranks, only_field=only_field, new_members=new_members)
    outer, opened = opened, growing or opened
    is_finished = ranks.by_first(lambda: _is_finished(opened, only_field=only_field))
    had_field = FieldModel.exists(opened.model)
    for text in _notes(opened, is_finished, outer.folder) if ranks.is_first else ():
        click.echo(f"  {text}", err=True)
    if not is_finished and not only_field:
        news = ranks.by_first(lambda: _fit_emulator(opened))
        for text in news if ranks.is_first else ():
            click.echo(f"  {text}", err=True)
    before = outer if growing else None
    surrogate, opened = _trained(opened, ranks, before, only_field=only_field)  # which looks whether it is this one
    if growing:
        record = ranks.by_first(lambda: take_place(_folder(outer), _folder(opened)).record)
        opened = OpenRun.of_run(replace(_folder(outer), record=record))
    if not ranks.is_first:
        return
    opened.keep_record()
    if is_finished and not growing:
        news = (
            [] if surrogate.field is None or had_field else ["an emulated field is new", *described(surrogate.scores)]
        )
        click.echo(
            "\n".join([f"{opened.model}: {news.pop(0) if news else 'nothing to do'}", *(f"  {n}" for n in news)])
        )
        return
    click.echo(f"{surrogate!r} after {surrogate.training['seconds']:.0f} s -> {opened.model}")
    for text in closing(surrogate, opened.catalog, opened.folder):
        click.echo(text)


def _growing(opened: OpenRun, ranks: Ranks, *, only_field: bool, new_members: bool) -> tuple[OpenRun, OpenRun | None]:
    """The run, and the training that will take its place; None without one."""
    from surrogate.storage.runs import RunFolder
    from surrogate.training.growth import GROWING, begin_growing, growing
    from surrogate.training.messages import growing_line

    if not opened.is_of_catalog:
        return opened, None

    def records() -> tuple[RunRecord | None, RunRecord | None]:
        inner = growing(_folder(opened))
        run = _folder(opened)  # whose place one that was finished may have taken
        if inner is None and new_members:
            inner = begin_growing(run, only_field=only_field)
        return run.record, None if inner is None else inner.record

    record, inner = ranks.by_first(records)
    opened = OpenRun.of_run(RunFolder(opened.folder, record))
    if inner is None:
        return opened, None
    run = RunFolder(opened.folder / GROWING, inner)
    if ranks.is_first:
        click.echo(f"  {growing_line(run)}", err=True)
    return opened, OpenRun.of_run(run)


def _folder(opened: OpenRun) -> RunFolder:
    from surrogate.storage.runs import RunFolder

    return RunFolder.open(opened.folder)


def _fit_emulator(opened: OpenRun) -> list[str]:
    """Fit the emulator of the catalog's coarse fields; return sentences on how well it predicts, or why there is none."""
    from surrogate.model import Surrogate
    from surrogate.storage.checkpoints import fingerprint
    from surrogate.training.emulator import described, with_emulator, with_scores
    from surrogate.training.source import Source

    source, mark = Source(opened.settings, opened.catalog), fingerprint(opened.settings, opened.catalog)
    if lacking := with_emulator(source, opened.model, mark):
        return [f"no emulated field: {lacking}"]
    return list(described(with_scores(Surrogate.load(opened.model), opened.catalog, opened.model).scores))


def _notes(opened: OpenRun, is_finished: bool, folder: Path) -> Iterator[str]:
    """Sentences on the catalog of a run; raises ValueError where it can't be learnt."""
    from surrogate.training.messages import grown_line, starting, tests_line
    from surrogate.training.requirements import require_possible
    from surrogate.training.source import Source

    appearance = opened.settings.appearance or opened.catalog.appearance_names[0]
    grown = grown_line(opened.catalog, appearance, folder)
    if is_finished:
        return filter(None, [tests_line(opened.catalog), grown])
    source = Source(opened.settings, opened.catalog)
    require_possible(source, opened.folder)
    return chain(filter(None, [grown]), starting(source))


def _is_finished(opened: OpenRun, *, only_field: bool) -> bool:
    """True where all that was asked for is there; else the run's folder says from now on how to resume its training."""
    from surrogate.model import FieldModel
    from surrogate.storage import models
    from surrogate.storage.runs import RECORD

    is_finished = FieldModel.exists(opened.model) if only_field else models.exists(opened.model)
    if not is_finished and not (opened.folder / RECORD).is_file():
        opened.keep_record()
    return is_finished


def _trained(
    opened: OpenRun, ranks: Ranks, before: OpenRun | None = None, *, only_field: bool
) -> tuple[Surrogate, OpenRun]:
    """The surrogate and the run that it is of, which goes on from the model of another run `before`, where there is one.

    A catalog's training that diverges begins anew with lower rates.
    """
    from surrogate.storage.runs import RunFolder
    from surrogate.training.growth import keep_start
    from surrogate.training.loop import Diverged
    from surrogate.training.run import train as run

    while True:
        with ProgressLine(None if ranks.is_first else io.StringIO()) as line:
            if before is not None and not only_field:
                note = ranks.by_first(partial(keep_start, _folder(before), _folder(opened)))
                if note:
                    line.say(note)
            try:
                settings, catalog, folder = opened.settings, opened.catalog, opened.model
                return run(settings, catalog, folder, progress=line, ranks=ranks, only_field=only_field), opened
            except Diverged as error:
                record = ranks.by_first(partial(_calmer, opened, error))
                line.say(
                    f"{str(error).split(':')[0]}: it begins anew with half the rates of the simulation deformation; nothing need "
                    "be done"
                )
        opened = OpenRun.of_run(RunFolder(opened.folder, record))


def _calmer(opened: OpenRun, error: Exception) -> RunRecord | None:
    """The record of a catalog's run that begins anew; raises `error` where none does."""
    from surrogate.storage.runs import RunFolder
    from surrogate.training.begin import calmer

    again = calmer(RunFolder.open(opened.folder)) if opened.is_of_catalog else None
    if again is None:
        raise error
    return again.record


@click.command()
@RUN
def show(run: Path) -> None:
    """Say what the surrogate in RUN is and how it was trained."""
    surrogate = load_surrogate(run / "surrogate")
    from surrogate.storage.runs import RunFolder
    from surrogate.training.messages import about

    with one_line_errors():
        for text in about(RunFolder.open(run), surrogate):
            click.echo(text)
