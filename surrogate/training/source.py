"""What a training run takes from its catalog: images, the box, and where Gaussians start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import field_of
from catalogs.catalog import Catalog
from catalogs.variations import Variation
from surrogate.gaussians import Gaussians, Normalization
from surrogate.initialization.pictures import Points
from surrogate.initialization.start import initial_gaussians, initial_points
from surrogate.settings import TrainingSettings
from surrogate.training.data import (
    Example,
    ImageRow,
    TrainingData,
    foreground_color,
    load_examples,
    training_rows,
    validation_rows,
)

COLOR_SAMPLES = 32  # images that the first colour is taken from
DECISION_IMAGES = 48  # validation images that choices about a model are made on


@dataclass(frozen=True, eq=False)
class Source:
    """The catalog as one run sees it.

    Raises ValueError where it has nothing to learn from, or not what the settings ask for.
    """

    settings: TrainingSettings
    catalog: Catalog

    def __post_init__(self) -> None:
        names = [a.name for a in self.catalog.plan.appearances]
        if self.appearance not in names:
            raise ValueError(f"training.appearance must be one of the catalog's {names}, got {self.appearance!r}")
        for variation in (None, *self.variations):
            training_rows(self.catalog, self._shown(variation))  # says at once where there are none
        if self.settings.start.initialization == "in-situ":
            _ = self.points  # says at once where the catalog has none

    @cached_property
    def appearance(self) -> str:
        """The name of the base appearance."""
        return self.settings.appearance or self.catalog.plan.appearances[0].name

    @cached_property
    def normalization(self) -> Normalization:
        """Of the catalog's box."""
        return Normalization.of_box(self.catalog.plan.bounds)

    def data(self, variation: Variation | None = None) -> TrainingData:
        """All images that training needs, decoded: of the base appearance, or of a variation without it."""
        learnt = self._loaded(training_rows(self.catalog, self._shown(variation)), variation)
        return TrainingData(
            learnt, self._validation(self.settings.validation.images, variation), self.catalog.plan.background
        )

    def decision_images(self, variation: Variation | None = None) -> list[Example]:
        """The validation images that choices about the model are made on; none where the settings want none."""
        return self._validation(DECISION_IMAGES if self.settings.validation.images else 0, variation)

    def _validation(self, count: int, variation: Variation | None) -> list[Example]:
        return self._loaded(validation_rows(self.catalog, self._shown(variation), count), variation)

    def _loaded(self, rows: Sequence[ImageRow], variation: Variation | None) -> list[Example]:
        return load_examples(self.catalog, rows, self.normalization, variation)

    def _shown(self, variation: Variation | None) -> list[str]:
        """The appearances to learn from."""
        return [self.appearance] if variation is None else [setting.appearance for setting in variation.settings]

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Those of the appearance that is learnt, where they are learnt too."""
        kept = self.catalog.plan.variations if self.settings.steps.visualization else ()
        return tuple(v for v in kept if v.base == self.appearance)

    @property
    def histogram(self) -> tuple[NDArray[np.int64] | None, NDArray[np.float64] | None]:
        """How often the training members have which values, (K,), and the bins' edges (K + 1,); None where not known.

        Values are those of the field that the appearance shows.
        """
        shown = next(a for a in self.catalog.plan.appearances if a.name == self.appearance)
        summaries = [m.summary(field_of(shown)) for m in self.catalog.members if m.split == "train"]
        known = [summary for summary in summaries if summary is not None]
        if not known:
            return None, None
        return np.sum([summary.histogram for summary in known], axis=0), known[0].bin_edges

    @cached_property
    def points(self) -> Points | None:
        """What Gaussians start on; None: anywhere in the box."""
        return initial_points(self.settings, self.catalog, self.appearance, self.normalization)

    def initial_gaussians(
        self, data: TrainingData, settings: TrainingSettings | None = None, *, own_colors: bool = True
    ) -> Gaussians:
        """What stage 1 starts from, by the run's own settings where none are given.

        Without `own_colors` all start in the mean colour of the images: the points' colours are those of the base appearance.
        """
        points = self.points
        if points is not None and not own_colors:
            points = Points(points.places, None)
        box = self.normalization.points(self.catalog.plan.bounds)  # [2, 3]
        some = data.examples[:: max(1, len(data.examples) // COLOR_SAMPLES)]
        return initial_gaussians(settings or self.settings, box, points, foreground_color(some, data.background))
