"""The emulator learns from validation members once they have chosen, and is judged by them without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from surrogate.evaluation.evaluate import evaluate
from surrogate.evaluation.scoring import mean
from surrogate.model import FieldModel, Surrogate
from surrogate.model.judged import judged
from surrogate.model.representation import FIELD, FILE, VIEW
from surrogate.settings import TrainingSettings
from surrogate.training.emulator import fit
from surrogate.training.run import train
from surrogate.training.source import Source
from tests.support.field_catalogs import SIZE, rendered
from tests.support.hooked import blob

SETTINGS = TrainingSettings(
    gaussians=60, canonical_steps=2, deformation_steps=4, visualization_steps=4, fit_to_need=False
)


def dented(p: float) -> Any:
    """A field that no member for training tells about p = 0.6."""
    return blob(size=SIZE) * (0.7 + 0.3 * p - 0.3 * np.exp(-(((p - 0.6) / 0.04) ** 2)))


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return rendered(tmp_path_factory.mktemp("catalog") / "a.cdb", surface=False, of=dented)


@pytest.fixture(scope="module")
def folder(catalog: Catalog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "surrogate"
    train(SETTINGS, catalog, folder, only_field=True)
    return folder


def _count(catalog: Catalog, *splits: str) -> int:
    return sum(member.split in splits for member in catalog.members)


def _learnt(model: FieldModel | None) -> int:
    assert model is not None
    return len(next(iter(model.emulators.values())).processes.points)


def test_validation_members_choose_first_and_teach_then(catalog: Catalog, folder: Path) -> None:
    surrogate = Surrogate.load(folder)
    assert _count(catalog, "validation") > 0
    assert _learnt(surrogate.field) == _count(catalog, "train", "validation")
    unseeing, first = judged(surrogate, catalog), fit(Source(SETTINGS, catalog), "")
    assert unseeing.field is not None
    assert unseeing.field.emulators.stored_form().digest == first.emulators.stored_form().digest


def test_scores_are_those_of_the_first_emulator(catalog: Catalog, folder: Path) -> None:
    surrogate = Surrogate.load(folder)
    before = surrogate.scores.psnr[VIEW][FIELD]
    evaluation = evaluate(surrogate, catalog)
    assert mean(evaluation.validation, "psnr") == pytest.approx(before, abs=1e-6)
    seen = evaluate(replace(surrogate, field=surrogate.field and replace(surrogate.field, training={})), catalog)
    assert (mean(seen.validation, "psnr") or 0.0) > before + 1.0  # what it has learnt from since says nothing
    (folder / FILE).unlink()
    again = train(SETTINGS, catalog, folder, only_field=True)
    assert again.scores.psnr == surrogate.scores.psnr


def test_gaussians_follow_the_first_emulator(catalog: Catalog, folder: Path) -> None:
    surrogate = train(SETTINGS, catalog, folder)
    assert surrogate.deformation.emulated is not None
    assert len(surrogate.deformation.emulated.processes.points) == _count(catalog, "train")
    assert _learnt(surrogate.field) == _count(catalog, "train", "validation")
    assert _learnt(Surrogate.load(folder).field) == _count(catalog, "train", "validation")


def test_lost_fields_are_named(folder: Path, tmp_path: Path) -> None:
    surrogate, bare = Surrogate.load(folder), rendered(tmp_path / "bare.cdb", coarse_field=False, surface=False)
    with pytest.raises(ValueError, match=r"bare.cdb no longer keeps the coarse fields"):
        evaluate(surrogate, bare)
