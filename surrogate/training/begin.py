"""The run of a catalog: begun with the options of a command, or resumed."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from catalogs.files import durable
from catalogs.store.catalog import Catalog
from surrogate.model.field_model import FOLDER as FIELD
from surrogate.settings import TrainingSettings
from surrogate.storage import models
from surrogate.storage.checkpoints import CHECKPOINT, fingerprint, locked
from surrogate.storage.runs import BESIDE, RunFolder, RunRecord, path_between, seen_by_run, with_chosen_splits
from surrogate.training.budget import MINUTES, STEP_KEYS, Budget, budgeted
from surrogate.training.pace import Clock
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.requirements import require_possible
from surrogate.training.source import Source

MOST_CALMED = 3  # times that a training which diverged begins anew


@dataclass(frozen=True)
class TrainingOptions:
    """The options of a command for a run of a catalog; the others are chosen.

    Attributes
    ----------
    budget : in minutes or steps; where neither is said, ten minutes, unless the settings say how many steps there are.
    hold_out : share of the training members that test the surrogate.
    settings : values by key of the `[training]` table.
    """

    budget: Budget = Budget()  # noqa: RUF009 - immutable
    hold_out: float | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        TrainingSettings.from_table(self.settings)  # says what is wrong

    @property
    def whole_budget(self) -> Budget:
        """The budget, or the default where neither it nor the settings say one."""
        choices = self.budget.minutes, self.budget.steps, *(self.settings.get(key) for key in STEP_KEYS)
        return self.budget if any(choices) else Budget(minutes=MINUTES)

    def to_json(self) -> dict[str, Any]:
        """JSON values, for `run.json`."""
        return {**vars(self.whole_budget), "hold_out": self.hold_out, "settings": dict(self.settings)}


def read_settings(path: Path) -> dict[str, Any]:
    """The settings in a TOML file: its `[training]` table, such as a scene has, or all of it.

    Raises ValueError naming the file for anything but TOML with settings; OSError where it can't be read.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        table = tables.get("training", tables)
        if not isinstance(table, dict):
            raise ValueError(f"training must be a table, got {table!r}")
        TrainingSettings.from_table(table)
    except ValueError as error:
        raise ValueError(f"settings {path}: {error}") from error
    return table


def begin(
    path: Path,
    folder: Path,
    options: TrainingOptions,
    *,
    elapsed: Clock | None = None,
    ranks: Ranks = ALONE,
) -> RunFolder:
    """The run of the catalog at `path` in `folder`: the one that is there, or a new one with these `options`.

    A catalog that was moved is found again.  `elapsed` says how many seconds of a budget in minutes are spent, on the clock that
    they are counted with; see `budgeted`.  Of several processes that will train together, `ranks`, all call this: they measure the
    speed, and the first one reads and writes `folder`.

    Raises ValueError, with nothing written, where the folder holds a run of other options, of another catalog or of a scene, and
    where the catalog can't be learnt from.  Raises RuntimeError where another process trains there.
    """
    catalog = Catalog.open(path)
    existing = ranks.by_first(lambda: _existing(folder, catalog, options))
    if existing is not None:
        return RunFolder(folder, existing)
    first = TrainingSettings.from_table(options.settings)
    own_catalog = with_chosen_splits(catalog, first, options.hold_out, first.seed)
    require_possible(Source(first, own_catalog, ranks), folder)
    ranks.by_first(lambda: durable.make_folder(folder))
    try:
        with ExitStack() as locks:
            ranks.by_first(lambda: locks.enter_context(locked(folder)))
            settings, chosen = budgeted(options.settings, own_catalog, options.whole_budget, elapsed, ranks)
            record = RunRecord(
                path_between(folder, path),
                settings.to_json(),
                own_catalog.splits,
                fingerprint(settings, own_catalog),
                options.to_json(),
                chosen,
            )
            saved = ranks.by_first(lambda: _saved(record, folder))
    except BaseException:
        if ranks.is_first:
            _remove_empty(folder)
        raise
    return RunFolder(folder, saved)


def _saved(record: RunRecord, folder: Path) -> RunRecord | None:
    """The record as it is read again, with when and where it was made."""
    record.save(folder)
    return RunRecord.load(folder)


def calmer(run: RunFolder) -> RunFolder | None:
    """A run of a catalog that diverged, begun anew with half its rates; None after three times, and for a scene."""
    record = run.record
    if record is None or not record.asked or record.chosen.get("calmed", 0) >= MOST_CALMED:
        return None
    before = TrainingSettings.from_record(record.settings)
    settings = before.changed(latent_rate=before.latent_rate / 2.0, embedding_rate=before.embedding_rate / 2.0)
    chosen = {**record.chosen, "calmed": record.chosen.get("calmed", 0) + 1}
    calm = replace(record, settings=settings.to_json(), chosen=chosen)
    with locked(run.folder):
        (run.model / CHECKPOINT).unlink(missing_ok=True)
        models.remove(run.model / FIELD)  # it names the settings, and takes seconds
        mark = fingerprint(RunFolder(run.folder, calm).settings, run.catalog)
        replace(calm, fingerprint=mark).save(run.folder)
    return RunFolder.open(run.folder)


def _existing(folder: Path, catalog: Catalog, options: TrainingOptions) -> RunRecord | None:
    """The run in the folder if its options are the same; None where there is none."""
    record = RunRecord.load(folder)
    if record is not None:
        return _matching(RunFolder(folder, record), catalog, options).record
    if (
        (folder / BESIDE).exists()
        or models.exists(folder / "surrogate")
        or (folder / "surrogate" / CHECKPOINT).exists()
    ):
        raise ValueError(
            f"{folder} holds the results of a scene, or of an earlier version: choose another folder with -o"
        )
    return None


def _matching(run: RunFolder, catalog: Catalog, options: TrainingOptions) -> RunFolder:
    """The run in the folder if its options agree; its record follows a catalog that was moved."""
    assert run.record is not None
    others = _disagreements(run.record, options)
    if others:
        raise ValueError(
            f"{run.folder} was begun with {'; '.join(others)}: `surrogate train {run.folder}` goes on with it, -o names another "
            "folder"
        )
    if run.missing or not catalog.path.samefile(run.catalog_path):
        own_catalog = None if run.record.splits is None else seen_by_run(catalog, run.record.splits)
        if fingerprint(run.settings, own_catalog or catalog) != run.record.fingerprint:
            raise ValueError(
                f"{run.folder} is a run of {run.catalog_path}, not of {catalog.path}: -o names another folder"
            )
        run = replace(run, record=replace(run.record, catalog=path_between(run.folder, catalog.path)))
        assert run.record is not None
        run.record.save(run.folder)
    return run


def _disagreements(record: RunRecord, options: TrainingOptions) -> list[str]:
    """Options with which a run was begun otherwise; options that are left out agree with everything."""
    now = {"minutes": options.budget.minutes, "steps": options.budget.steps, "hold_out": options.hold_out}
    differing = [
        f"{_option(name, record.asked.get(name))}, not {_option(name, value)}"
        for name, value in now.items()
        if value is not None and value != record.asked.get(name)
    ]
    before = TrainingSettings.from_record(record.settings).to_json()
    settings = TrainingSettings.from_table(options.settings).to_json()
    others = [key for key in options.settings if before.get(key) != settings.get(key)]
    return differing + [f"{key}={before.get(key)}, not {settings.get(key)}" for key in others]


def _option(name: str, value: Any) -> str:
    option = f"--{name.replace('_', '-')}"
    return f"no {option}" if value is None else f"{option} {value:g}"


def _remove_empty(folder: Path) -> None:
    """Remove a folder that was made for nothing."""
    (folder / ".lock").unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()


def seconds_of_process() -> float:
    """Since this process began."""
    import psutil

    return time.time() - psutil.Process().create_time()
