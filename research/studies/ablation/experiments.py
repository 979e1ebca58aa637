"""Experiments of an ablation: training of the base appearance, or of F_vis alone on a finished surrogate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import Variation
from research.studies.ablation.timing import ROUGHLY, StepTimes, measure_step_times, settled
from research.studies.ablation.variants import VARIANTS, VISUALIZATION_VARIANTS
from surrogate.deformation.visualization import Visualization
from surrogate.evaluation.cases import Case
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import Scored, score_cases
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.splatting.cuda import chosen_device
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.checkpoints import fingerprint
from surrogate.training.data import TrainingData, validation_rows
from surrogate.training.loop import StageRun
from surrogate.training.run import train
from surrogate.training.session import ProgressReport, TrainingProgress
from surrogate.training.source import DECISION_IMAGES, Source
from surrogate.training.visualizations import in_common, new_visualization, visualization_stage

BASE_FOLDER, VISUALIZATION_FOLDER = "ablation", "ablation-visualization"  # below a scene's results and records
# Settings that leave all time to training itself.
NOTHING_ELSE: dict[str, Any] = {
    "fit_to_need": False,
    "validation_interval": 0,
    "validation_images": 0,
    "checkpoint_seconds": 86400.0,
}
REPORT_STEPS = 50  # between progress reports
WITHOUT_VALIDATION = (
    "and an ablation must not be judged on test images: at least one member or view of split validation is needed"
)


class BaseExperiment:
    """Stages 1 and 2 of a scene's settings, with all time given to training itself.

    `variants` depart from the settings `base`, which are those of the `scene` but for the needs of ablations. The
    others are compared with the first of them. `mark` changes with everything else that results depend on. `cases` are
    the validation images, and `folder` is the subfolder of a scene's results and records.

    Nothing is chosen during training, since a choice takes time and may differ from run to run. Colours have degree 0
    where it is "auto", and other "auto" settings are resolved beforehand. Raises ValueError for a catalog without
    validation images.
    """

    variants, folder = VARIANTS, BASE_FOLDER

    def __init__(self, settings: TrainingSettings, catalog: Catalog) -> None:
        self.scene, self.base, self.catalog = settings, base_settings(settings, catalog), catalog
        self.mark = fingerprint(self.base, catalog)
        rows = validation_rows(catalog, [Source(self.base, catalog).appearance], DECISION_IMAGES)
        if not rows:
            raise ValueError(f"catalog {catalog.path} has no validation images, {WITHOUT_VALIDATION}")
        self.cases = [Case(row.member, row.view, row.appearance) for row in rows]

    def step_times(self, settings: TrainingSettings, seconds: float) -> StepTimes:
        """Step times of these settings on this machine, measured in about `seconds`."""
        return measure_step_times(settings, self.catalog, seconds)

    def trained(self, settings: TrainingSettings, work: Path, progress: ProgressReport) -> Surrogate:
        """Train a surrogate with these settings in the folder `work`."""
        return train(settings, self.catalog, work, progress=progress)


class VisualizationExperiment:
    """Stage 3 of a scene's settings on the F_sim of its finished `surrogate`, the same for all variants.

    The colour degree is that of the surrogate, and nothing else is chosen. Raises ValueError where the catalog varies
    nothing, has no validation images of its variations, or the surrogate has no F_vis.
    """

    variants, folder = VISUALIZATION_VARIANTS, VISUALIZATION_FOLDER

    def __init__(self, settings: TrainingSettings, catalog: Catalog, surrogate: Surrogate) -> None:
        self.scene, self.catalog, self._surrogate = settings, catalog, surrogate
        self._source = Source(settings, catalog)
        if not self._source.variations:
            raise ValueError(f"catalog {catalog.path} has no variation of {self._source.appearance}: there is no F_vis")
        if not surrogate.visualizations or surrogate.training.get("appearance") != self._source.appearance:
            raise ValueError(f"the surrogate has no F_vis of {self._source.appearance}: train the scene first")
        if not _is_of(surrogate, self._source):
            raise ValueError(
                f"the surrogate has other parameters or another box than catalog {catalog.path}: delete or rename its folder and "
                "train the scene again"
            )
        if not all(self._cases(variation) for variation in self._source.variations):
            raise ValueError(f"catalog {catalog.path} has no validation images of its variations, {WITHOUT_VALIDATION}")
        degree = max(v.color_degree for v in surrogate.visualizations)
        self.base = settings.changed(
            canonical_steps=0,
            deformation_steps=0,
            visualization_color_degree=1 if degree else 0,
            **NOTHING_ELSE,
        )
        self.mark = f"{fingerprint(self.base, catalog)} on {surrogate.training.get('fingerprint')}"

    def step_times(self, settings: TrainingSettings, seconds: float) -> StepTimes:
        """See `BaseExperiment`; the images are loaded once for all variants, so their loading is not timed."""
        learnt = self._data

        @one_torch_thread()
        def timed(form: TrainingSettings, of: Callable[[StageRun], float]) -> StepTimes:
            each = [of(self._begun(form, *one)[1]) for one in learnt]
            return StepTimes(0.0, visualization=math.fsum(each))

        return settled(settings, seconds, timed, ROUGHLY * seconds / len(learnt))

    @one_torch_thread()
    def trained(self, settings: TrainingSettings, work: Path, progress: ProgressReport) -> Surrogate:
        """See `BaseExperiment`; nothing is written into `work`, and an interrupted training starts again."""
        visualizations = []
        for one in self._data:
            visualization, run = self._begun(settings, *one)
            while run.step < run.stage.steps:
                run.advance()
                if run.step % REPORT_STEPS == 0:
                    progress(TrainingProgress(run.stage.name, run.step, run.stage.steps))
            run.require_finite()
            visualizations.append(visualization.copy())
        return replace(self._surrogate, visualizations=tuple(v.to(torch.device("cpu")) for v in visualizations))

    @property
    def cases(self) -> list[Case]:
        """See `BaseExperiment`."""
        return [case for variation in self._source.variations for case in self._cases(variation)]

    @cached_property
    def _data(self) -> list[tuple[Variation, TrainingData]]:
        silent = Source(self.base, self.catalog)
        return [(variation, silent.data(variation)) for variation in self._source.variations]

    def _cases(self, variation: Variation) -> list[Case]:
        shown = {setting.appearance: variation.arguments(setting) for setting in variation.settings}
        rows = validation_rows(self.catalog, list(shown), DECISION_IMAGES)
        return [Case(row.member, row.view, row.appearance, shown[row.appearance]) for row in rows]

    def _begun(
        self, settings: TrainingSettings, variation: Variation, data: TrainingData
    ) -> tuple[Visualization, StageRun]:
        """A new F_vis and its training."""
        device, source = chosen_device(settings.device), Source(settings, self.catalog)
        fitted = self._surrogate.gaussians.to(device), self._surrogate.deformation.to(device)
        degree = int(settings.visualization_color_degree)
        visualization = in_common(new_visualization(*fitted, variation, source, degree), settings, data)
        stage = visualization_stage(*fitted, visualization, settings)
        return visualization, StageRun(stage, settings, data)


Experiment = BaseExperiment | VisualizationExperiment


@one_torch_thread()
def score(experiment: Experiment, surrogate: Surrogate) -> list[Scored]:
    """Scores of a surrogate on the validation images."""
    predictor = SurrogatePredictor(surrogate.at, experiment.catalog.plan.background)
    [scores] = score_cases(predictor, experiment.catalog, experiment.cases)
    return list(scores.values())


def _is_of(surrogate: Surrogate, source: Source) -> bool:
    """True if the surrogate's parameters and box are those of the catalog."""
    own, there = surrogate.normalization, source.normalization
    same_box = own.extent == there.extent and (own.center == there.center).all()
    return bool(same_box) and surrogate.space == source.space


def base_settings(settings: TrainingSettings, catalog: Catalog) -> TrainingSettings:
    """The common settings that all variants of `BaseExperiment` depart from."""
    start = settings.initialization
    if start == "auto":
        start = "random" if Source(settings, catalog).points is None else "in-situ"
    return settings.changed(
        initialization=start,
        color_degree=0 if settings.color_degree == "auto" else settings.color_degree,
        visualization_steps=0,
        **NOTHING_ELSE,
    )
