"""A scene trained with several seeds, each scored as in its report; finished seeds are skipped."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from catalogs.engines.engine import Engine
from catalogs.store.catalog import Catalog
from research.studies.progress import StudyProgress, StudyWatch
from research.studies.remote import train_on
from research.studies.repeats.seeds import FOLDER, Scores, load, load_scores, save
from surrogate.evaluation.cases import all_cases, base_cells, variation_cells
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import METRICS, Report, by_cell, score_cases
from surrogate.evaluation.tables import cell_tables
from surrogate.model import Surrogate
from surrogate.provenance import code
from surrogate.settings import TrainingSettings
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.checkpoints import Checkpoint, fingerprint
from surrogate.storage.records import Provenance
from surrogate.training.run import train

MODEL, STAGE = "surrogate", "scoring"


@dataclass(frozen=True)
class Repeat:
    """A seed to be trained: its settings, their fingerprint, and the model's folder."""

    settings: TrainingSettings
    mark: str
    model: Path


def repeat(
    settings: TrainingSettings,
    catalog: Catalog,
    run: Path,
    *,
    records: Path | None = None,
    seeds: int = 3,
    engine: Engine | None = None,
    progress: Callable[[StudyProgress], None] = lambda _: None,
    tell: Callable[[Scores], None] = lambda _: None,
) -> list[Scores]:
    """Train `settings` with `seeds` successive seeds and store their scores in `records`; returns all stored scores, by seed.

    `records` is the folder of the scene's records, by default `run`, which holds the models; that of the settings' own
    seed is in `run`/surrogate. Finished models are used as they are, and interrupted trainings resume from their last
    checkpoint. A seed is skipped if its stored scores have the same fingerprint and come from the same code. That is
    the code of its model, or the present code without a model. `tell` receives each seed's stored scores. With an
    `engine`, each of its workers trains a seed; they must see all of these folders.

    Raises ValueError, before anything is written, for fewer than two seeds. It is also raised where a run's path is a
    file, or its folder holds a run with other settings or of another catalog. Raises RuntimeError where another process
    trains there, and at the end for every training that failed on an engine.
    """
    plan, records = planned(settings, catalog, run, seeds), run if records is None else records
    base = plan[0].mark
    left = [one for one in plan if not _is_scored(records, one, base)]
    _check(left, run)
    if engine is not None:
        tasks = {f"seed {one.settings.seed}": partial(_kept, one, catalog, settings, base, records) for one in left}
        train_on(engine, tasks, tell, progress)
        return load_scores(records, base=base)
    watch = StudyWatch(progress)
    for number, one in enumerate(left, start=1):
        watch.begin(f"seed {one.settings.seed}", len(left) - number)
        tell(_kept(one, catalog, settings, base, records, watch))
    return load_scores(records, base=base)


def planned(settings: TrainingSettings, catalog: Catalog, run: Path, seeds: int) -> list[Repeat]:
    """The seeds to be trained, the settings' own first; raises ValueError for fewer than two `seeds`."""
    if seeds < 2:
        raise ValueError(f"seeds must be at least 2, or nothing could be said about their spread; got {seeds}")
    varied = [settings.changed(seed=settings.seed + number) for number in range(seeds)]
    folders = [run, *(run / FOLDER / str(one.seed) for one in varied[1:])]
    return [Repeat(one, fingerprint(one, catalog), folder / MODEL) for one, folder in zip(varied, folders, strict=True)]


def _is_scored(records: Path, one: Repeat, base: str) -> bool:
    scores = load(records, one.settings.seed)
    if scores is None or (scores.fingerprint, scores.base) != (one.mark, base):
        return False
    is_trained = Surrogate.exists(one.model) and _mark_in(one.model) == one.mark
    return scores.provenance.code == (_code_of(Surrogate.load(one.model)) if is_trained else code())


def _check(plan: Sequence[Repeat], run: Path) -> None:
    """Raise ValueError, before hours of training, where the folder of any seed is a file or holds another run."""
    folders = [run / FOLDER, *(folder for one in plan for folder in (run / FOLDER / str(one.settings.seed), one.model))]
    files = [str(path) for path in folders if path.exists() and not path.is_dir()]
    if files:
        raise ValueError(f"{' and '.join(files)} must be folders of results: delete or rename these files")
    other = [str(one.model) for one in plan if _mark_in(one.model) not in (None, one.mark)]
    if other:
        raise ValueError(
            f"{' and '.join(other)} hold runs with other training settings or of another catalog, and nothing is overwritten: "
            "delete or rename these folders"
        )


def _mark_in(directory: Path) -> str | None:
    """The fingerprint of the finished or interrupted run in a folder; None without one."""
    if Surrogate.exists(directory):
        return str(Surrogate.load(directory).training.get("fingerprint"))
    checkpoint = Checkpoint.load(directory)
    return None if checkpoint is None else str(checkpoint.record["fingerprint"])


def _code_of(surrogate: Surrogate) -> str:
    """The fingerprint of the code that trained a model; "" if unknown."""
    return str(surrogate.training.get("code_version", ""))


def _kept(
    one: Repeat, catalog: Catalog, settings: TrainingSettings, base: str, records: Path, watch: StudyWatch | None = None
) -> Scores:
    """Train, score and store a seed; scores that another process has just stored are returned."""
    stored = load(records, one.settings.seed)
    if stored is not None and _is_scored(records, one, base):
        return stored
    scores = _trained_and_scored(one, catalog, settings, base, watch or StudyWatch(lambda _: None))
    save(records, scores)
    return scores


def _trained_and_scored(
    one: Repeat, catalog: Catalog, settings: TrainingSettings, base: str, watch: StudyWatch
) -> Scores:
    begun, is_new = time.process_time(), _mark_in(one.model) is None
    surrogate = train(one.settings, catalog, one.model, progress=lambda now: watch.tell(now, now.seconds_left))
    watch.expect(surrogate.training["seconds"])
    try:
        scored = score_model(surrogate, catalog, progress=watch.counter())
    except ValueError as error:
        raise ValueError(f"seed {one.settings.seed}, {one.model}: {error}") from error
    made = Provenance.now(time.process_time() - begun if is_new else None)
    commit = surrogate.training.get("commit", made.commit)
    return Scores(
        seed=one.settings.seed,
        fingerprint=one.mark,
        base=base,
        settings=settings.to_json(),
        **scored,
        gaussians=len(surrogate.gaussians),
        megabytes=surrogate.megabytes,
        seconds=surrogate.training["seconds"],
        processor_seconds=surrogate.training.get("processor_seconds"),
        provenance=replace(made, code=_code_of(surrogate), commit=commit),
    )


@one_torch_thread()
def score_model(surrogate: Surrogate, catalog: Catalog, *, progress: Report = lambda *_: None) -> dict[str, Any]:
    """`cells` and `variations` as `Scores` has them.

    Raises ValueError where its images are not finite, because training diverged.
    """
    main = base_cells(catalog, str(surrogate.training["appearance"]))
    varied = [variation_cells(catalog, v.variation) for v in surrogate.visualizations]
    predictor = SurrogatePredictor(surrogate.at, catalog.plan.background)
    cases = [case for cells in (main, *varied) for case in all_cases(cells)]
    [scores] = score_cases(predictor, catalog, cases, progress=partial(progress, STAGE))
    if not all(math.isfinite(scored.score.psnr) for scored in scores.values()):
        raise ValueError("training diverged: the model's images are not finite")
    return {
        "cells": cell_tables(by_cell(main, scores), METRICS),
        "variations": [
            {"kind": v.variation.kind, "base": v.variation.base, **cell_tables(by_cell(cells, scores), METRICS)}
            for v, cells in zip(surrogate.visualizations, varied, strict=True)
        ],
    }
