"""Fixtures of the tests of ablation studies."""

from collections.abc import Callable
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from research.studies.ablation import experiments
from research.studies.ablation import study as module
from research.studies.ablation.experiments import BaseExperiment
from research.studies.ablation.records import AblationResult
from research.studies.ablation.study import ablate
from research.studies.ablation.timing import StepTimes
from surrogate.settings import TrainingSettings
from tests.research.support.ablations import BUDGET, MEMBERS, SCENE, SMALL, VIEW_SPLITS


@pytest.fixture
def catalog(make_catalog) -> Catalog:
    return make_catalog(SMALL, members=MEMBERS, view_splits=VIEW_SPLITS)


@pytest.fixture
def conduct(catalog: Catalog, tmp_path: Path) -> Callable[..., list[AblationResult]]:
    """Runs a study in `tmp_path`; returns what was fitted now."""

    def run(settings: TrainingSettings = SCENE, *, data: Catalog = catalog, **options: object) -> list[AblationResult]:
        fitted: list[AblationResult] = []
        ablate(
            "blobs",
            BaseExperiment(settings, data),
            tmp_path,
            tell=fitted.append,
            **{"seconds": BUDGET, "seeds": 1} | options,
        )
        return fitted

    return run


@pytest.fixture
def given_step_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measured ones would be those of a busy machine, on which loading the images may take longer than so small a budget."""
    times = StepTimes(start=0.0, canonical=0.5e-3, deformation=0.5e-3)
    monkeypatch.setattr(experiments, "measure_step_times", lambda *_: times)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Experiments that take no time, for tests of which of them are done."""
    monkeypatch.setattr(
        module.AblationStudy, "_fit", lambda *_: {"psnr": 20.0, "ssim": 0.5, "images": 1, "seconds": 0.1}
    )
    monkeypatch.setattr("research.studies.ablation.table.plot", lambda _: None)
