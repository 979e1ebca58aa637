"""Studies of F_vis alone."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from catalogs.store.catalog import Catalog
from research.studies.ablation.experiments import VisualizationExperiment, score
from research.studies.ablation.records import AblationResult
from research.studies.ablation.study import ablate
from research.studies.ablation.variants import DEFAULT, VISUALIZATION_VARIANTS
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.evaluation.scoring import mean
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.training.loop import StageRun
from tests.support.varied_blobs import EVERYTHING, FUNCTIONS, ISOVALUE, varied_catalog, varied_surrogate

SCENE = TrainingSettings(gaussians=40, canonical_steps=20, deformation_steps=60, visualization_steps=80)
MEMBERS = {
    "train-0": (0.0, EVERYTHING),
    "train-1": (1.0, EVERYTHING),
    "validation-0": (0.25, ("dvr", *ISOVALUE.named("validation"), *FUNCTIONS.named("validation"))),
}


@pytest.fixture(scope="module")
def surrogate() -> Surrogate:
    return varied_surrogate()


@pytest.fixture(scope="module")
def catalog(surrogate: Surrogate, tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return varied_catalog(tmp_path_factory.mktemp("varied") / "varied.cdb", surrogate, MEMBERS)


@pytest.fixture(scope="module")
def experiment(surrogate: Surrogate, catalog: Catalog) -> VisualizationExperiment:
    return VisualizationExperiment(SCENE, catalog, surrogate)


def test_the_first_variant_is_the_default_and_all_others_change_something() -> None:
    settings = [variant.settings(SCENE) for variant in VISUALIZATION_VARIANTS]
    assert VISUALIZATION_VARIANTS[0].name == DEFAULT
    assert settings[0] == SCENE
    assert all(
        s != SCENE or variant.steps_of for s, variant in zip(settings[1:], VISUALIZATION_VARIANTS[1:], strict=True)
    )


@pytest.mark.slow
def test_only_f_vis_is_trained_and_by_as_many_steps_as_fit(
    experiment: VisualizationExperiment, surrogate: Surrogate, tmp_path: Path
) -> None:
    found: list[AblationResult] = []
    ablate("blobs", experiment, tmp_path, tell=found.append, seconds=0.4, seeds=1, only=["surface-samples-1"])
    assert [result.variant for result in found] == ["default", "surface-samples-1"]
    for result in found:
        assert result.error == ""
        assert result.steps == result.visualization_steps > 0
        assert (
            result.images == 2
        )  # the validation view of the validation member, under each variation's validation setting
        assert 5.0 < result.psnr < 60.0
    page = (tmp_path / "ablation.md").read_text()
    assert "F_sim is that of the finished surrogate" in page
    assert "python -m research.studies ablate scenes/blobs.toml --visualization --seconds 0.4" in page


def test_training_starts_from_the_base_and_gets_better(
    experiment: VisualizationExperiment, surrogate: Surrogate, tmp_path: Path
) -> None:
    brief = experiment.trained(experiment.base.changed(visualization_steps=1), tmp_path, lambda _: None)
    longer = experiment.trained(experiment.base.changed(visualization_steps=150), tmp_path, lambda _: None)
    before, after = mean(score(experiment, brief), "psnr"), mean(score(experiment, longer), "psnr")
    assert before is not None
    assert after is not None
    assert after > before + 1.0
    perfect = mean(score(experiment, surrogate), "psnr")
    assert perfect is not None
    assert perfect > 45.0  # the catalog shows what it draws, in 8 bits
    for trained in (brief, longer):
        for name, tensor in surrogate.gaussians.tensors().items():
            assert torch.equal(trained.gaussians.tensors()[name], tensor)
    assert not list(tmp_path.iterdir())


def test_a_seed_gives_the_same_again(experiment: VisualizationExperiment, tmp_path: Path) -> None:
    settings = experiment.base.changed(visualization_steps=20)
    first, second = (score(experiment, experiment.trained(settings, tmp_path, lambda _: None)) for _ in range(2))
    assert [s.score for s in first] == [s.score for s in second]


def test_what_diverges_in_its_last_step_is_said(
    experiment: VisualizationExperiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    advance = StageRun.advance

    def spoilt(run: StageRun, pause: bool = False) -> float:
        loss = advance(run)
        with torch.no_grad():
            next(iter(run.stage.tensors.values()))[0] = torch.nan
        return loss

    monkeypatch.setattr(StageRun, "advance", spoilt)
    with pytest.raises(ValueError, match="training diverged in stage isovalue at step 1 of 1, where visualization"):
        experiment.trained(experiment.base.changed(visualization_steps=1), tmp_path, lambda _: None)


def test_surfaces_are_deformed_and_functions_applied_to_values(
    experiment: VisualizationExperiment, tmp_path: Path
) -> None:
    short = experiment.base.changed(visualization_steps=2)
    default = experiment.trained(short, tmp_path, lambda _: None)
    assert [type(v.deformation) for v in default.visualizations] == [BilinearDeformation, ValuesDeformation]


def test_what_a_study_needs_is_said(surrogate: Surrogate, catalog: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="train the scene first"):
        VisualizationExperiment(SCENE, catalog, replace(surrogate, visualizations=()))
    wider = replace(surrogate.normalization, extent=2.0 * surrogate.normalization.extent)
    renamed = replace(surrogate.space, parameters=(replace(surrogate.space.parameters[0], name="other"),))
    for other in (replace(surrogate, normalization=wider), replace(surrogate, space=renamed)):
        with pytest.raises(ValueError, match=r"other parameters or another box than catalog .*train the scene again"):
            VisualizationExperiment(SCENE, catalog, other)
    with pytest.raises(ValueError, match="there is no F_vis"):
        VisualizationExperiment(SCENE.changed(visualization_steps=0), catalog, surrogate)
    monkeypatch.setattr("research.studies.ablation.experiments.validation_rows", lambda *_: [])
    with pytest.raises(ValueError, match="must not be judged on test images"):
        VisualizationExperiment(SCENE, catalog, surrogate)
