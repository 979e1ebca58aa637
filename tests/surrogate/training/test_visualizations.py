from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.variations import Variation
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.deformation import values as of_values
from surrogate.deformation.values import VALUE_BINS
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import NAMES
from surrogate.lighting import Lighting
from surrogate.settings import TrainingSettings
from surrogate.training.data import Example, TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.state import FittedGaussians
from surrogate.training.visualizations import (
    in_common,
    new_visualization,
    shared_visualization,
    visualization_stage,
)
from tests.support.comparing import same
from tests.support.field_blobs import BLOBS, FUNCTIONS, ISOVALUE, appearance_of, field_catalog
from tests.support.visualizations import base

SETTINGS = TrainingSettings(visualization_steps=30, latent_size=3, hidden_width=5)
MEMBERS = (("train", 0.0), ("train", 1.0))


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    path = tmp_path_factory.mktemp("varied") / "field.cdb"
    return field_catalog(path, members=MEMBERS, view_splits=("train",) * 2, summaries=True)


def source(catalog: Catalog, **settings: object) -> Source:
    return Source(TrainingSettings.from_table(SETTINGS.to_json() | settings), catalog)


def bits(fitted: FittedGaussians) -> list[bytes]:
    return [tensor.detach().numpy().tobytes() for tensor in fitted.tensors().values()]


@pytest.mark.parametrize("variation", [FUNCTIONS, ISOVALUE], ids=["functions", "isovalue"])
@pytest.mark.parametrize("color_degree", [0, 1])
def test_at_first_nothing_moves(catalog: Catalog, variation: Variation, color_degree: int) -> None:
    fitted = base()
    visual = shared_visualization(*fitted, variation, source(catalog), color_degree=color_degree)
    for setting in variation.settings if variation is ISOVALUE else ():
        place = torch.tensor([0.3, *variation.normalize(setting.values)], dtype=torch.float32)
        shown = visual.gaussians_at(*fitted, place)
        assert same(shown, fitted.at(place[:1]).with_color_degree(color_degree))
    assert visual.color_degree == color_degree
    assert (visual.simulation is None) == (variation is FUNCTIONS)
    if visual.simulation is not None:
        assert all(torch.equal(t, fitted.deformation.tensors()[n]) for n, t in visual.simulation.tensors().items())
    if isinstance(visual.deformation, BilinearDeformation):
        assert all(visual.deformation.moves(name) for name in NAMES)
    else:
        before = fitted.at(torch.zeros(1)).with_color_degree(color_degree).tensors()
        after = visual.gaussians_at(*fitted, torch.tensor([0.0, 1.0, 0.0, 0.0, 0.0])).tensors()
        assert [n for n in NAMES if not torch.equal(before[n], after[n])] == ["opacity_logits", "colors"]


def test_isovalues_have_lit_gaussians_of_their_own_that_leave_the_base_alone(
    catalog: Catalog, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert new_visualization(*base(), ISOVALUE, source(catalog)).gaussians is None, (
        "these blobs have colours of their own"
    )
    monkeypatch.setattr(Lighting, "explains", lambda *_: True)
    given, fitted = source(catalog, visualization_gaussians=70), base()
    data, before = given.data(ISOVALUE), bits(fitted)
    visual = new_visualization(*fitted, ISOVALUE, given)
    assert visual.gaussians is not None
    assert visual.lighting == Lighting.of([appearance_of(s) for s in ISOVALUE.settings])
    assert (len(visual.gaussians), visual.simulation, visual.color_degree) == (70, None, 0)
    torch.testing.assert_close(visual.gaussians.colors.norm(dim=1), torch.full((70,), 0.8))
    at_first = visual.stored()
    begun = in_common(visual, given.settings, data)
    assert all(torch.equal(t, at_first[n]) for n, t in visual.stored().items()), "what was given stays as it is"
    assert not torch.equal(begun.gaussians.means, visual.gaussians.means)
    stage = visualization_stage(*fitted, begun, given.settings)
    assert stage.per_gaussian >= set(NAMES), "dead ones are relocated"
    run = StageRun(stage, given.settings, replace(data, validation=data.examples[::3]))
    psnr = run.validate()
    for _ in range(30):
        run.advance()
    assert run.validate() > psnr
    assert bits(fitted) == before
    for p in (-1.0, 0.4):
        assert same(begun.gaussians_at(*fitted, torch.tensor([p, torch.nan])), fitted.at(torch.tensor([p])))
    moved = begun.gaussians_at(*fitted, torch.tensor([0.4, 0.1]))
    assert moved.lighting == begun.lighting
    assert same(moved, begun.of(torch.arange(3)).gaussians_at(*fitted, torch.tensor([0.4, 0.1])))
    loaded = Visualization.load(begun.stored(), json.loads(json.dumps(begun.record())))
    assert same(loaded.gaussians_at(*fitted, torch.tensor([0.4, 0.1])), moved)
    assert loaded.lighting == begun.lighting


def test_values_follow_the_training_members_histogram(catalog: Catalog) -> None:
    visual = new_visualization(*base(), FUNCTIONS, source(catalog))
    assert isinstance(visual.deformation, ValuesDeformation)
    values = visual.deformation.values
    assert len(values) == VALUE_BINS
    assert (values[0], values[-1]) == (0.0, 3.0)
    assert np.ptp(np.diff(values)) > 0.01
    assert visual.deformation.steps == (0.4, 0.25, 0.4, 0.3)


def test_it_is_made_on_the_device_of_its_gaussians(catalog: Catalog) -> None:
    meta, fitted = torch.device("meta"), base()  # a device that every torch has
    visual = shared_visualization(*fitted.to(meta), ISOVALUE, source(catalog))
    assert {tensor.device for tensor in visual.deformation.tensors().values()} == {meta}


def test_an_appearance_without_a_transfer_function_is_named(tmp_path: Path, make_catalog) -> None:
    plain = Source(SETTINGS, make_catalog())
    assert isinstance(plain.catalog.plan.appearances[0], ImportedImages)
    variation = replace(FUNCTIONS, base="drawn")
    with pytest.raises(ValueError, match="appearance drawn has no transfer function"):
        new_visualization(*base(), variation, plain)


@pytest.mark.parametrize("variation", [FUNCTIONS, ISOVALUE], ids=["functions", "isovalue"])
def test_stage_3_leaves_the_base_as_it_is_bit_for_bit(
    catalog: Catalog, variation: Variation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(of_values, "VALUE_RATE", 0.05)
    given = source(catalog)
    fitted = base()
    before, visual = bits(fitted), shared_visualization(*fitted, variation, given)
    at_first = {name: t.clone() for name, t in visual.stored().items()}
    stage = visualization_stage(*fitted, visual, given.settings)
    data = given.data(variation)
    run = StageRun(stage, given.settings, replace(data, validation=data.examples[::3]))
    psnr = run.validate()
    for _ in range(30):
        run.advance()
    assert bits(fitted) == before
    assert all(tensor.grad is None and not tensor.requires_grad for tensor in fitted.tensors().values())
    assert run.validate() > psnr
    changed = {name for name, t in visual.stored().items() if not torch.equal(t, at_first[name])}
    assert any(name.startswith("deformation.") for name in changed)
    assert any(name.startswith("simulation.") for name in changed) == (variation is ISOVALUE)
    if variation is FUNCTIONS:
        for p in (-1.0, 0.4):
            assert same(visual.gaussians_at(*fitted, torch.tensor([p, 0, 0, 0, 0])), fitted.at(torch.tensor([p])))
            moved = visual.gaussians_at(*fitted, torch.tensor([p, 0.7, -0.3, 0.2, 1.0]))
            rest = fitted.at(torch.tensor([p]))
            assert all(torch.equal(getattr(moved, name), getattr(rest, name)) for name in NAMES[:3])


def test_f_sim_is_tuned_at_a_part_of_its_rates(catalog: Catalog) -> None:
    given, fitted = source(catalog, latent_rate=0.04, embedding_rate=0.02), base()
    rates = visualization_stage(*fitted, shared_visualization(*fitted, ISOVALUE, given), given.settings).rates
    assert rates["simulation.latents"] == pytest.approx(0.004)
    assert rates["simulation.weights_in"] == pytest.approx(0.002)
    assert rates["visualization.latents"] == 0.04
    assert not set(rates) & set(NAMES)


def test_values_that_are_wrong_at_first_are_learnt(catalog: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blobs of one value each, shown exactly at the base: after a short training their looks under unseen functions fit."""
    monkeypatch.setattr(of_values, "VALUE_RATE", 0.03)
    given = source(catalog, visualization_steps=150)
    truth = BLOBS.shown(0.5, given.catalog.plan.appearances[0])
    fitted = FittedGaussians(truth, BilinearDeformation.create(truth, 1, SETTINGS))
    visual = new_visualization(*fitted, FUNCTIONS, given)
    assert isinstance(visual.deformation, ValuesDeformation)
    visual.deformation.weights.mul_(0.3).add_(0.02)
    members = field_members(given)
    stage = visualization_stage(*fitted, visual, given.settings)
    run = StageRun(stage, given.settings, members)

    def error() -> float:
        found = 0.0
        for setting in (s for s in FUNCTIONS.settings if s.split == "test"):
            place = torch.tensor([0.0, *FUNCTIONS.normalize(setting.values)], dtype=torch.float32)
            with torch.no_grad():
                shown = visual.gaussians_at(*fitted, place)
            found += float((shown.opacities() - BLOBS.shown(0.5, appearance_of(setting)).opacities()).abs().mean())
        return found

    at_first = error()
    while run.step < stage.steps:
        run.advance()
    assert error() < 0.5 * at_first


def field_members(given: Source) -> TrainingData:
    """Images of a member at p = 0.5 only."""
    examples = []
    for setting in (s for s in FUNCTIONS.settings if s.split == "train"):
        place = torch.tensor([0.0, *FUNCTIONS.normalize(setting.values)], dtype=torch.float32)
        for camera in BLOBS.cameras()[:6]:
            pixels = np.round(255 * BLOBS.drawn(0.5, appearance_of(setting), camera)).astype(np.uint8)
            pixels[..., :3] = np.minimum(pixels[..., :3], pixels[..., 3:])
            examples.append(Example(given.normalization.camera(camera), place, pixels))
    return TrainingData(examples, [], None)
