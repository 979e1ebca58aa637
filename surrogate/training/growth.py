"""A finished run that goes on from its model, with members that were rendered after it began.

The training is a run of its own in the folder `growing` inside the run's.  Its first checkpoint holds the finished Gaussians, which
follow a new emulator.  So it is trained, interrupted and resumed like any other.  Once finished it takes the run's place.
"""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from catalogs.files import durable
from catalogs.store.catalog import Catalog
from catalogs.store.splits import Splits, with_later
from catalogs.vocabulary.words import joined_names
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.emulated_values import EmulatedValues
from surrogate.model import FieldModel, Surrogate
from surrogate.settings import TrainingSettings
from surrogate.storage import models
from surrogate.storage.checkpoints import CHECKPOINT, Checkpoint, fingerprint, locked
from surrogate.storage.runs import RunFolder, RunRecord, path_between
from surrogate.training.source import Source
from surrogate.training.state import FittedGaussians, TrainingState

GROWING = "growing"


def growing(run: RunFolder) -> RunFolder | None:
    """The training that will take the run's place; None without one.  One that is finished takes it now."""
    folder = run.folder / GROWING
    record = RunRecord.load(folder)
    if record is None:
        return None
    inner = RunFolder(folder, replace(record, catalog=path_between(folder, run.catalog_path)))
    if inner.record != record and inner.record is not None:  # the catalog was moved
        inner.record.save(folder)
    if Surrogate.exists(run.model) and _mark(run.model) == record.fingerprint:
        take_place(run, inner)
        return None
    return inner


def begin_growing(run: RunFolder, *, only_field: bool = False) -> RunFolder | None:
    """The training of a finished run with its catalog's later members, begun in the run's folder; None without such members.

    Raises ValueError, naming the remedy, for the run of a scene, one that is not finished, and where its model can't go on.
    """
    record = run.record
    if record is None or record.splits is None or not record.asked:
        raise ValueError(
            f"{run.folder} is the run of a scene, which trains what its catalog had: `surrogate train SCENE --runs NEW` begins one "
            "with all members"
        )
    if (run.model / CHECKPOINT).exists() or not Surrogate.exists(run.model):
        raise ValueError(
            f"{run.folder} can't take members in before it is finished: `surrogate train {run.folder}` first"
        )
    appearance = run.settings.appearance or run.catalog.appearance_names[0]
    whole, surrogate = Catalog.open(run.catalog_path), Surrogate.load(run.model)
    settings = TrainingSettings.from_record(record.settings)
    hold_out = record.asked.get("hold_out")
    splits = with_later(
        record.splits, whole.members, whole.plan.space, appearance, hold_out=hold_out, seed=settings.seed
    )
    if len(splits.members) == len(record.splits.members):
        return None
    if only_field and len(surrogate.gaussians):
        raise ValueError(f"{run.folder} holds Gaussians, which go on with its emulated field: leave --model field out")
    catalog = whole.with_splits(splits)
    changed = _changed(settings, surrogate, _share(splits, record.splits)) if len(surrogate.gaussians) else {}
    _require_same(surrogate, Source(settings.changed(**changed), catalog), run)
    more = len(splits.members) - len(record.splits.members)
    chosen = {**record.chosen, "grown": {"members": more, "to": len(splits.members), "settings": changed}}
    folder = run.folder / GROWING
    new = replace(record, catalog=path_between(folder, catalog.path), splits=splits, chosen=chosen, made={})
    mark = fingerprint(RunFolder(folder, new).settings, catalog)
    with locked(run.folder):
        durable.make_folder(folder)
        replace(new, fingerprint=mark).save(folder)
    return RunFolder(folder, RunRecord.load(folder))


def _share(splits: Splits, before: Splits) -> float:
    """The share of the training members that are new."""
    train = [name for name, split in splits.members.items() if split == "train"]
    return sum(name not in before.members for name in train) / len(train)


def _changed(settings: TrainingSettings, surrogate: Surrogate, share: float) -> dict[str, Any]:
    """The settings that differ in a training that goes on: the new members' share of the steps, without the first stage."""
    steps = settings.canonical_steps + settings.deformation_steps
    return {
        "canonical_steps": 0,
        "deformation_steps": max(1, math.ceil(share * steps)),
        "visualization_steps": math.ceil(share * settings.visualization_steps),
        "color_degree": surrogate.gaussians.color_degree,
        "validation_interval": math.ceil(share * settings.validation_interval),
    }


def _require_same(surrogate: Surrogate, source: Source, run: RunFolder) -> None:
    """Raise ValueError where a surrogate is not of what a catalog shows now, or of an earlier version that learnt it otherwise."""
    pairs = {
        "parameters": (surrogate.space, source.space),
        "appearance": (surrogate.training.get("appearance"), source.appearance),
        "variations": (surrogate.variations, source.variations),
        "box": (surrogate.normalization.to_json(), source.normalization.to_json()),
        "background": (surrogate.background, source.catalog.plan.background),
        "carried values": (isinstance(surrogate.gaussians, FieldGaussians), source.field is not None),
    }
    other = [name for name, (own, of_source) in pairs.items() if own != of_source]
    if other:
        raise ValueError(
            f"the model of {run.folder} can't go on, for {joined_names(other)} differ from those of {source.catalog.path}: "
            f"`surrogate train {source.catalog.path} -o NEW` begins a run with all members"
        )


def keep_start(run: RunFolder, inner: RunFolder) -> str:
    """Let the training `inner`, where it has not begun yet, begin with the model of `run`, and the emulator that it has by now.

    Returns a sentence where a run from the start promises more, else "".
    """
    if not models.exists(run.model):
        return ""
    durable.make_folder(inner.model)
    with locked(inner.model):
        if models.exists(inner.model) or Checkpoint.load(inner.model) is not None:
            return ""
        field = FieldModel.load(inner.model) if FieldModel.exists(inner.model) else None
        surrogate, source = Surrogate.load(run.model), Source(inner.settings, inner.catalog)
        warm_start(surrogate, source, field).checkpoint(fingerprint(inner.settings, inner.catalog)).save(inner.model)
        if field is None or surrogate.deformation.emulated is not None or source.start_from_field(field) is None:
            return ""
    return (
        f"its Gaussians do not follow the emulated field, which predicts well by now: `surrogate train {run.catalog_path} -o NEW` "
        "begins a run that starts from it"
    )


def warm_start(surrogate: Surrogate, source: Source, field: FieldModel | None) -> TrainingState:
    """The state of a training that goes on from a surrogate, whose values follow the emulated `field` from now on."""
    gaussians, deformation = surrogate.gaussians, surrogate.deformation
    followed = deformation.emulated
    visualizations = surrogate.visualizations
    emulated = None if followed is None or field is None else source.emulated_values(field, gaussians)
    if followed is not None and emulated is not None:
        emulated = emulated.like(followed)
        gaussians = _anchored(gaussians, followed, emulated)
        deformation = replace(deformation, emulated=emulated)
        visualizations = tuple(replace(v, simulation=_following(v.simulation, emulated)) for v in visualizations)
    training = surrogate.training
    return TrainingState(
        FittedGaussians(gaussians, deformation.widened(source.settings.latent_size, source.settings.seed)),
        visualizations=visualizations,
        seconds=training.get("seconds", 0.0),
        processor_seconds=training.get("processor_seconds", 0.0),
        steps_before=training.get("steps", 0),
    )


def _anchored(gaussians: AnyGaussians, before: EmulatedValues, after: EmulatedValues) -> AnyGaussians:
    """The Gaussians whose values are on average over the members that the emulator knew the same as `before`."""
    if not isinstance(gaussians, FieldGaussians):
        return gaussians
    points = torch.from_numpy(before.processes.points).float()  # [M, P]
    change = torch.stack([before.shifts(point) - after.shifts(point) for point in points]).mean(dim=0)  # [N]
    return replace(gaussians, values=gaussians.values + torch.stack([change, torch.zeros_like(change)], dim=1))


def _following(deformation: BilinearDeformation | None, emulated: EmulatedValues) -> BilinearDeformation | None:
    return deformation and (replace(deformation, emulated=emulated) if deformation.emulated else deformation)


def take_place(run: RunFolder, inner: RunFolder) -> RunFolder:
    """Replace a run's model and record by those of its finished training `inner`; done again where it was interrupted."""
    assert inner.record is not None
    with locked(run.folder):
        if not Surrogate.exists(run.model) or _mark(run.model) != inner.record.fingerprint:
            _exchange(inner.model, run.model)
        replace(inner.record, catalog=path_between(run.folder, inner.catalog_path)).save(run.folder)
        done = durable.partial_name(inner.folder)
        durable.rename(inner.folder, done)
        shutil.rmtree(done)
    return RunFolder.open(run.folder)


def _mark(model: Path) -> str | None:
    return Surrogate.load(model).training.get("fingerprint")


def _exchange(new: Path, old: Path) -> None:
    """Give the folder `new` the name of `old`, which stays beside it until both are gone: at once, where the file system can."""
    try:
        durable.exchange(new, old)
    except OSError:
        if old.exists():
            durable.rename(old, new.with_name("before"))
        durable.rename(new, old)
    durable.sync(new.parent)
    durable.sync(old.parent)
