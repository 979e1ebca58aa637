"""A run: the folder of one surrogate, and `run.json` in it, which says what it learns from and how.

    run.json     the catalog, its members' splits, the settings of training, and what they were chosen from
    surrogate/   the model
    report/      what `surrogate evaluate` wrote

A run without `run.json`, made by a scene of an earlier version, has its catalog beside it as `catalog.cdb`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.splits import Splits, choose_splits
from catalogs.vocabulary.words import shortened
from surrogate.provenance import commit, machine
from surrogate.settings import TrainingSettings
from surrogate.storage import models
from surrogate.storage.checkpoints import fingerprint
from surrogate.storage.records import read_json, write_json

RECORD, MODEL, REPORT = "run.json", "surrogate", "report"
BESIDE = "catalog.cdb"
SCHEMA = 1


@dataclass(frozen=True)
class RunRecord:
    """The contents of `run.json`.

    Attributes
    ----------
    catalog : path of the catalog, relative to the run's folder where both have a folder in common.
    settings : those of training, as JSON values.
    splits : of the members that belong to the run; None: all members, as the catalog has them.
    fingerprint : of the training, by which the catalog is recognized.
    asked : what the command said, as JSON values; empty for a run of a scene.
    chosen : what followed from it, and from the machine's speed, for people; in `grown` how many members were taken in last, and
        the settings that differ in that training.
    made : commit, machine and time.
    """

    catalog: str
    settings: Mapping[str, Any] = field(repr=False)
    splits: Splits | None = None
    fingerprint: str = ""
    asked: Mapping[str, Any] = field(default_factory=dict)
    chosen: Mapping[str, Any] = field(default_factory=dict)
    made: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def save(self, folder: Path) -> None:
        """Write `run.json` into the run's folder, at once and whole."""
        origin = {"commit": commit(), "machine": machine(), "at": datetime.now(UTC).isoformat(timespec="seconds")}
        values = {
            "schema": SCHEMA,
            **vars(self),
            "splits": None if self.splits is None else self.splits.to_json(),
            "made": dict(self.made) or origin,
        }
        write_json(folder / RECORD, values)

    @classmethod
    def load(cls, folder: Path) -> RunRecord | None:
        """The record in the run's `run.json`; None without one.  Raises ValueError for a damaged or newer one."""
        path = folder / RECORD
        if not path.is_file():
            return None
        values = read_json(path)
        try:
            values = dict(values or {})
            if values.pop("schema") > SCHEMA:
                raise ValueError("it is of a newer version of gs-surrogate")
            splits = values.pop("splits")
            record = cls(**values, splits=None if splits is None else Splits.from_json(splits))
            if not isinstance(record.catalog, str) or not isinstance(record.fingerprint, str):
                raise TypeError("catalog and fingerprint must be text")
            if not all(isinstance(v, Mapping) for v in (record.settings, record.asked, record.chosen, record.made)):
                raise TypeError("settings, asked, chosen and made must be tables")
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"{path} is damaged ({error!r}): remove {folder}, and train again") from error
        return record


@dataclass(frozen=True, eq=False)
class RunFolder:
    """A run's folder, opened: whoever needs its catalog, splits or settings asks here, whether a scene made it or not."""

    folder: Path
    record: RunRecord | None = None

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> RunFolder:
        """The run in the folder `path`; its catalog is opened when it is first asked for.

        Raises FileNotFoundError for a folder that holds no run, ValueError for a damaged `run.json`.
        """
        folder = Path(path)
        record = RunRecord.load(folder)
        if record is None and not (folder / BESIDE).is_dir() and not models.exists(folder / MODEL):
            raise FileNotFoundError(
                f"there is no trained surrogate in {folder}, nor {RECORD}: `surrogate train` makes them"
            )
        return cls(folder, record)

    @property
    def name(self) -> str:
        """That of the folder."""
        return self.folder.resolve().name

    @property
    def model(self) -> Path:
        """The folder of the surrogate."""
        return self.folder / MODEL

    @property
    def catalog_path(self) -> Path:
        """The path of the catalog, which may be gone."""
        return Path(os.path.normpath(self.folder / (BESIDE if self.record is None else self.record.catalog)))

    @cached_property
    def missing(self) -> str:
        """A sentence where the catalog is gone, or another lies in its place, with what helps; "" where it is there."""
        if self.catalog_path.is_dir():
            if self._is_of_catalog():
                return ""
            return (
                f"{self.catalog_path} holds other pictures or members than {self.folder} was trained on: put these back, or train "
                "into another folder (-o)"
            )
        moved = (
            f": if it was moved, `surrogate train NEW/PLACE/{self.catalog_path.name} -o {self.folder}` finds it again"
        )
        return f"the catalog of {self.folder} is not at {self.catalog_path} any more{moved if self.record else ''}"

    @cached_property
    def catalog(self) -> Catalog:
        """The catalog as the run sees it: its members, each with the run's split.

        Raises CatalogError where it is gone, damaged or another, or lacks members that the run has.
        """
        if self.missing:
            raise CatalogError(self.missing)
        return self._catalog_of_run()

    def _catalog_of_run(self) -> Catalog:
        """The catalog that lies where the run's was."""
        catalog = Catalog.open(self.catalog_path)
        splits = None if self.record is None else self.record.splits
        return catalog if splits is None else seen_by_run(catalog, splits)

    def _is_of_catalog(self) -> bool:
        """False where another catalog lies in the place of the one that was learnt; other damage is for others to say."""
        if self.record is None or self.record.splits is None:
            return True
        try:
            return fingerprint(self.settings, self._catalog_of_run()) == self.record.fingerprint
        except (OSError, ValueError):
            return True

    @property
    def settings(self) -> TrainingSettings:
        """Those of training; raises ValueError where this version can't read them, FileNotFoundError where nobody knows them."""
        if self.record is not None:
            place, chosen = self.folder / RECORD, self.record.chosen
            settings = {**self.record.settings, **(chosen.get("grown") or {}).get("settings", {})}
        else:
            place = self.model / models.RECORD
            record = read_json(place)
            if record is None:
                raise FileNotFoundError(f"{self.folder} has no trained surrogate yet")
            settings = (record.get("training") or {}).get("settings") or {}
        try:
            return TrainingSettings.from_record(settings)
        except (TypeError, ValueError) as error:
            raise ValueError(f"the settings in {place} can't be read by this version: {error}") from error


def seen_by_run(catalog: Catalog, splits: Splits) -> Catalog:
    """The catalog with these splits; raises CatalogError where it lacks members that they name."""
    lost = sorted(set(splits.members) - {path.name for path in catalog.member_paths()})
    if lost:
        raise CatalogError(f"{catalog.path} lacks members that the run has: {shortened(lost, 5)}")
    return catalog.with_splits(splits)


def with_chosen_splits(
    catalog: Catalog, settings: TrainingSettings, hold_out: float | None, seed: int, folder: Path | None = None
) -> Catalog:
    """The catalog as a new run with these settings sees it; see `catalogs.store.splits.choose_splits`.

    A finished run in `folder` whose dumps an earlier version held out, whatever their runs, keeps its splits.
    """
    appearance = settings.appearance or catalog.appearance_names[0]
    if appearance not in catalog.appearance_names:
        return catalog  # whoever learns it says so
    record = RunRecord.load(folder) if folder is not None else None
    rules = (True, False) if record is not None else (True,)
    members, space = catalog.members, catalog.plan.space
    candidates = [
        catalog.with_splits(choose_splits(members, space, appearance, hold_out=hold_out, seed=seed, whole_runs=rule))
        for rule in rules
    ]
    same = (
        candidate
        for candidate in candidates
        if record is not None and fingerprint(settings, candidate) == record.fingerprint
    )
    return next(same, candidates[0])


def path_between(folder: Path, catalog: Path) -> str:
    """The catalog's path as `run.json` keeps it: relative to the run's folder where both have a folder in common, else absolute."""
    here, there = folder.resolve(), catalog.resolve()
    common = Path(os.path.commonpath([here, there]))
    return os.path.relpath(there, here) if common != Path(common.anchor) else str(there)
