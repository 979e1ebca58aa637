"""What an ablation trains: the base appearance from the start, or F_vis alone on a finished surrogate."""

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

BASE_FOLDER, VISUALIZATION_FOLDER = "ablation", "ablation-visualization"  # of a scene's results and records
# Settings with which all time is given to training itself.
NOTHING_ELSE: dict[str, Any] = {
    "fit_to_need": False,
    "validation_interval": 0,
    "validation_images": 0,
    "checkpoint_seconds": 86400.0,
}
REPORT_STEPS = 50  # between two looks at the progress
WITHOUT_VALIDATION = (
    "and an ablation must not be judged on test images: at least one member or view of split validation is needed"
)


class BaseExperiment:
    """Stages 1 and 2 of a scene's settings, with all time given to training itself.

    `variants`, the first of which the others are compared with, depart from the settings `base`, which are those of the `scene` but
    for what ablations need; `mark` changes with all else that results depend on.  `cases` are the validation images that judge
    them, and `folder` is where results and records of a scene lie.

    Nothing is chosen during training, since a choice takes time and may fall differently from run to run: colours are of degree 0
    where they are left to be chosen, and "auto" is replaced by what it stands for.
    Raises ValueError for a catalog without validation images.
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
        """How long a step of these settings takes here and now, measured in about `seconds`."""
        return measure_step_times(settings, self.catalog, seconds)

    def trained(self, settings: TrainingSettings, work: Path, progress: ProgressReport) -> Surrogate:
        """The surrogate of these settings, trained in the folder `work`."""
        return train(settings, self.catalog, work, progress=progress)


class VisualizationExperiment:
    """Stage 3 of a scene's settings on the F_sim of its finished `surrogate`, the same for all variants.

    The colour degree is the one that was chosen then, and nothing else is chosen.
    Raises ValueError where the catalog varies nothing, has no validation images of it, or the surrogate has no F_vis.
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
        """As of `BaseExperiment`; the images are loaded once for all, so that takes no variant's time."""
        learnt = self._data

        @one_torch_thread()
        def timed(form: TrainingSettings, of: Callable[[StageRun], float]) -> StepTimes:
            each = [of(self._begun(form, *one)[1]) for one in learnt]
            return StepTimes(0.0, visualization=math.fsum(each))

        return settled(settings, seconds, timed, ROUGHLY * seconds / len(learnt))

    @one_torch_thread()
    def trained(self, settings: TrainingSettings, work: Path, progress: ProgressReport) -> Surrogate:
        """As of `BaseExperiment`; nothing is written into `work`, and an interrupted training begins anew."""
        found = []
        for one in self._data:
            visualization, run = self._begun(settings, *one)
            while run.step < run.stage.steps:
                run.advance()
                if run.step % REPORT_STEPS == 0:
                    progress(TrainingProgress(run.stage.name, run.step, run.stage.steps))
            run.require_finite()
            found.append(visualization.copy())
        return replace(self._surrogate, visualizations=tuple(v.to(torch.device("cpu")) for v in found))

    @property
    def cases(self) -> list[Case]:
        """As of `BaseExperiment`."""
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
    """How well a surrogate shows the validation images."""
    predictor = SurrogatePredictor(surrogate.at, experiment.catalog.plan.background)
    [found] = score_cases(predictor, experiment.catalog, experiment.cases)
    return list(found.values())


def _is_of(surrogate: Surrogate, source: Source) -> bool:
    """Whether what the surrogate knows means the same in the catalog."""
    own, there = surrogate.normalization, source.normalization
    same_box = own.extent == there.extent and (own.center == there.center).all()
    return bool(same_box) and surrogate.space == source.space


def base_settings(settings: TrainingSettings, catalog: Catalog) -> TrainingSettings:
    """What all variants of `BaseExperiment` depart from."""
    start = settings.initialization
    if start == "auto":
        start = "random" if Source(settings, catalog).points is None else "in-situ"
    return settings.changed(
        initialization=start,
        color_degree=0 if settings.color_degree == "auto" else settings.color_degree,
        visualization_steps=0,
        **NOTHING_ELSE,
    )
