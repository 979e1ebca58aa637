"""Gaussians on isosurfaces start on those of the emulated field, and learn slowly from there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.store.catalog import Catalog
from surrogate.model import Surrogate
from surrogate.model.form import without_gaussians
from surrogate.model.representation import GAUSSIANS
from surrogate.settings import TrainingSettings
from surrogate.training.emulator import fit
from surrogate.training.run import train
from surrogate.training.source import MOST_ERROR, Source
from surrogate.training.visualizations import BEGUN_FACTOR, new_visualization, visualization_stage
from tests.support.field_catalogs import rendered
from tests.support.interruptions import interrupt, outcome

SETTINGS = TrainingSettings(
    gaussians=60, visualization_gaussians=80, canonical_steps=4, deformation_steps=8, visualization_steps=30
)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return rendered(tmp_path_factory.mktemp("catalog") / "a.cdb")


@pytest.mark.slow
def test_they_start_on_emulated_surfaces_and_learn_slowly(catalog: Catalog) -> None:
    source = Source(SETTINGS, catalog)
    model, [variation] = fit(source, ""), source.variations
    surfaces = source.emulated_surfaces(model, variation)
    assert surfaces is not None
    base = without_gaussians(model)
    fitted = base["gaussians"], base["deformation"]
    visual = new_visualization(*fitted, variation, source, 0, surfaces)
    assert visual.gaussians is not None
    assert len(visual.gaussians) == 80
    assert not torch.equal(visual.deformation.weights_out, torch.zeros_like(visual.deformation.weights_out))
    slow, usual = (visualization_stage(*fitted, visual, SETTINGS, begun=begun).rates for begun in (True, False))
    assert slow == {name: pytest.approx(BEGUN_FACTOR * rate) for name, rate in usual.items()}


def test_they_start_elsewhere_where_the_field_tells_too_little(catalog: Catalog) -> None:
    source = Source(SETTINGS, catalog)
    model, [variation] = fit(source, ""), source.variations
    [(name, emulator)] = model.emulators.items()
    poor = replace(emulator, errors=np.full_like(emulator.errors, 1.01 * MOST_ERROR * emulator.spread))
    poorly = replace(model, emulators=replace(model.emulators, emulators={name: poor}))
    assert source.emulated_surfaces(poorly, variation) is None
    assert source.emulated_surfaces(None, variation) is None
    elsewhere = Source(replace(SETTINGS, initialization="random"), catalog)
    assert elsewhere.emulated_surfaces(model, variation) is None


@pytest.mark.slow
def test_a_run_starts_there_and_draws_them_again(catalog: Catalog, tmp_path: Path) -> None:
    surrogate = train(SETTINGS, catalog, tmp_path)
    camera = catalog.plan.cameras[0]
    pictures = [
        s.using(GAUSSIANS).at(p=0.4, isovalue=0.3).render(camera) for s in (surrogate, Surrogate.load(tmp_path))
    ]
    np.testing.assert_array_equal(*pictures)
    alpha = surrogate.at(p=0.4, isovalue=0.3).render(camera)[..., 3]
    assert alpha.max() > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("step", [12, 25], ids=["before the start", "after it"])
def test_an_interrupted_run_ends_where_an_undisturbed_one_does(catalog: Catalog, tmp_path: Path, step: int) -> None:
    interrupt(lambda progress: progress.step >= step, SETTINGS, catalog, tmp_path / "resumed")
    assert not (tmp_path / "resumed" / "model.json").exists()
    train(SETTINGS, catalog, tmp_path / "resumed")
    train(SETTINGS, catalog, tmp_path / "undisturbed")
    assert outcome(tmp_path / "resumed") == outcome(tmp_path / "undisturbed")
