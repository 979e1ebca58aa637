"""A comparison from start to end: its options, the study of a scene, tuning, and the page."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from catalogs.engines.engine import Engine
from catalogs.files import durable
from catalogs.store.catalog import Catalog
from research.studies.baselines.method import Plan
from research.studies.comparison import tuning
from research.studies.comparison.contestants import Contestant
from research.studies.comparison.methods import chosen
from research.studies.comparison.page import tables
from research.studies.comparison.plots import curves, sheet
from research.studies.comparison.reduced import reduced
from research.studies.comparison.result import AS_PUBLISHED, FOLDER, TRIVIAL, ComparisonResult, load, terms
from research.studies.comparison.study import SHARED, ComparisonStudy
from research.studies.comparison.task import ComparisonTask
from research.studies.comparison.tuning import Tuning
from research.studies.progress import StudyWatch
from research.studies.remote import train_on
from surrogate.splatting.cuda import usable_device
from surrogate.storage.checkpoints import locked
from surrogate.training.emulator import lacking

PAGE, CURVES = "comparison.md", "curves.png"
LOCK = ".page.lock"


@dataclass(frozen=True)
class RunOptions:
    """The options of a comparison; raises ValueError for invalid ones.

    Attributes
    ----------
    published : use the published sizes and numbers of steps in place of `minutes`.
    stop_after : minutes after which the command stops; it can be resumed later.
    """

    methods: Sequence[str] = ()
    minutes: Sequence[float] = (5.0,)
    seeds: int = 1
    published: bool = False
    threads: int = 1
    device: Literal["cpu", "cuda"] = "cpu"
    stop_after: float = math.inf

    def __post_init__(self) -> None:
        chosen(self.methods)
        for name in ("seeds", "threads"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not self.minutes or not all(0.0 < minutes < math.inf for minutes in self.minutes):
            raise ValueError(f"minutes must be positive times, got {list(self.minutes)}")
        if not self.stop_after > 0.0:
            raise ValueError(f"--stop-after must be a positive number of minutes, got {self.stop_after}")
        usable_device(self.device)


def times_of(words: str) -> list[float]:
    """Minutes such as "5,30"; raises ValueError for text that is not a number."""
    try:
        return [float(word) for word in words.split(",")]
    except ValueError:
        raise ValueError(f"--minutes must be numbers such as 5,30, got {words!r}") from None


def study_of(
    name: str,
    catalog: Catalog,
    folder: Path,
    records: Path,
    options: RunOptions,
    progress: Callable[[Any], None] = lambda _: None,
) -> ComparisonStudy:
    """The study of a scene's `catalog` in its `folder` of results; smaller images are made where needed."""
    own = folder / FOLDER
    durable.make_folder(own)
    with durable.locked(own / f".{name}.lock"):  # or two processes would make the same images
        task = ComparisonTask.of(reduced(catalog, own / "catalog.cdb", progress))
    plan = Plan(1, size="official" if options.published else "small", threads=options.threads)
    kind = "" if task.variation is None else task.variation.kind
    contestants = chosen(options.methods, kind=kind, with_fields=not lacking(task.source))
    until = time.monotonic() + 60.0 * options.stop_after
    minutes = (AS_PUBLISHED,) if options.published else options.minutes
    return ComparisonStudy(
        task, own, records, records.parent, contestants, minutes, options.seeds, plan, options.device, until
    )


def tune_all(
    name: str,
    study: ComparisonStudy,
    progress: Callable[[Any], None],
    tell: Callable[[str, float, float | None], None],
    engine: Engine | None = None,
) -> None:
    """Choose the rates of all contestants that have none yet, on the workers of an `engine` where one is given."""
    order = [contestant for contestant in study.contestants if contestant.is_tuned]
    if engine is not None:
        trainings = {f"rates of {one.name}": partial(_tuned, name, study, one) for one in order}
        train_on(engine, trainings, partial(_tell_all, tell), progress)
        return
    watch = StudyWatch(progress)
    for number, contestant in enumerate(order, start=1):
        watch.begin(f"rates of {contestant.name}", len(order) - number)
        try:
            _tuned(name, study, contestant, watch, partial(tell, contestant.name))
        except RuntimeError as error:
            progress(str(error))  # another process tunes it
        watch.end()


def _tuned(
    name: str,
    study: ComparisonStudy,
    contestant: Contestant,
    watch: StudyWatch | None = None,
    tell: Callable[[float, float | None], None] = lambda *_: None,
) -> Tuning | None:
    """Choose and record the rates of a contestant; None where they are chosen already."""
    plan, work = study.plan_of(contestant.name), study.folder / "tuning" / contestant.name
    if study.chosen_rates(contestant) is not None:
        return None
    durable.make_folder(work)
    report = (watch or StudyWatch(lambda _: None)).counter("steps")
    with locked(work):
        rates = tuning.tune(contestant, study.task, name, plan, work, study.folder / SHARED, report=report, tell=tell)
        tuning.save(study.all_records, rates)
    return rates


def _tell_all(tell: Callable[[str, float, float | None], None], tuned: Tuning | None) -> None:
    if tuned is None:
        return
    for rate, psnr in tuned.decibels.items():
        tell(tuned.method, float(rate), psnr)


def write_page(name: str, study: ComparisonStudy) -> Path:
    """Write all results of a scene into its folder, as a page with plots; returns its path."""
    results = [r for r in load(study.records) if r.mark == study.task.mark]
    pictures = {CURVES: curves(results)}
    for each in terms(results):
        pictures[f"pictures_{each.name}.png"] = sheet(study.records, results, each)
    drawn = {file: content for file, content in pictures.items() if content is not None}
    with durable.locked(study.folder / LOCK):
        for file, content in drawn.items():
            durable.replace(study.folder / file, content)
        shown = "\n\n".join(f"![{file.partition('.')[0]}]({file})" for file in drawn)
        durable.replace(study.folder / PAGE, f"# {name}\n\n{tables(results)}\n\n{shown}\n".encode())
    return study.folder / PAGE


def line(result: ComparisonResult) -> str:
    """A result as one line for the terminal."""
    if result.method == TRIVIAL:
        return f"mixtures of stored images: {len(result.cells)} rules and cells"
    who = f"{result.method}, {result.terms}, seed {result.seed}"
    if result.error:
        return f"{who}: {result.error}"
    cells = ", ".join(f"{cell} {of['psnr']:.2f} dB" for cell, of in result.cells.items())
    return f"{who}: {cells} after {result.steps:,} steps in {result.seconds:.0f} s"
