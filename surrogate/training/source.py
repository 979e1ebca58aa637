"""The input of a training run from its catalog: images, the box, and starting Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Appearance, VolumeRendering, field_of
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from catalogs.vocabulary.words import joined_names
from surrogate.appearance.field_gaussians import AnyGaussians, FieldValues
from surrogate.appearance.scale import ValueScale
from surrogate.deformation.emulated_values import EmulatedValues
from surrogate.emulation import FieldEmulator
from surrogate.gaussians import Gaussians, Normalization
from surrogate.initialization.field_points import field_points
from surrogate.initialization.from_field import StartFromField, start_from_field, values_at
from surrogate.initialization.on_surfaces import EmulatedSurfaces
from surrogate.initialization.pictures import StartPoints
from surrogate.initialization.start import initial_gaussians, initial_points, surface_points, with_random_normals
from surrogate.model.field_model import FieldModel
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
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.value_loss import KnownValues

COLOR_SAMPLES = 32  # images that the first colour is taken from
# Images, and opaque pixels of them, that tell whether surfaces are lit as the catalog says.
LOOKED_AT, MOST_PIXELS = 8, 4_000
# Relative error of left-out members, above which Gaussians do not start from the emulated field: they would follow what is wrong.
# `python -m research.benchmarks.emulation.starts` compares both starts on any catalog.
MOST_ERROR = 0.2
DECISION_IMAGES = 48  # validation images that choices about a model are made on


@dataclass(frozen=True, eq=False)
class Source:
    """The catalog as one run sees it, which the processes `ranks` train together.

    Raises ValueError where it has nothing to learn from, or not what the settings ask for.
    """

    settings: TrainingSettings
    catalog: Catalog
    ranks: Ranks = ALONE

    def __post_init__(self) -> None:
        if self.settings.batch < self.ranks.count:
            raise ValueError(
                f"{self.ranks.count} processes can't share steps of batch = {self.settings.batch} pictures: say "
                f"batch = {self.ranks.count} or more in the scene's [training] table, or as KEY=VALUE of a catalog"
            )
        names = [a.name for a in self.catalog.plan.appearances]
        if self.appearance not in names:
            raise ValueError(
                f"training.appearance must be one of the catalog's {joined_names(names)}, got {self.appearance!r}"
            )
        for variation in (None, *self.variations):
            training_rows(self.catalog, self._appearance_names(variation))  # says at once where there are none
        if self.settings.initialization == "in-situ":
            _ = self.points  # says at once where the catalog has none
        _ = self.field  # says at once where values can't be carried

    @cached_property
    def appearance(self) -> str:
        """The name of the base appearance."""
        return self.settings.appearance or self.catalog.plan.appearances[0].name

    @cached_property
    def target(self) -> Appearance:
        """The base appearance."""
        return next(a for a in self.catalog.plan.appearances if a.name == self.appearance)

    @cached_property
    def field(self) -> FieldValues | None:
        """The meaning of carried values; None where Gaussians carry colours.  Raises ValueError where they can't."""
        if not self.settings.carry_values(self.target) or not isinstance(self.target, VolumeRendering):
            return None
        return FieldValues(self.target.transfer_function, ValueScale.of_function(self.target.transfer_function))

    @cached_property
    def space(self) -> ParameterSpace:
        """The catalog's parameters on the scales that are learnt: those that span a decade or more by their logarithms."""
        return self.catalog.plan.space.with_logarithms()

    @cached_property
    def values(self) -> KnownValues | None:
        """The fields' own values to learn from; None where Gaussians carry colours, or nothing is learnt of them."""
        if self.field is None or not self.settings.field_value_weight:
            return None
        points = field_points(self.catalog, field_of(self.target), self.normalization, self.space)
        return KnownValues(points, self.field.scale, self.settings.seed)

    @cached_property
    def normalization(self) -> Normalization:
        """Of the catalog's box."""
        return Normalization.of_box(self.catalog.plan.bounds)

    def data(self, variation: Variation | None = None) -> TrainingData:
        """All images that training needs, decoded: of the base appearance, or of a variation without it."""
        learnt = self._loaded(training_rows(self.catalog, self._appearance_names(variation)), variation)
        watched = self._validation(self.settings.validation_images, variation)
        return TrainingData(learnt, watched, self.catalog.plan.background, self.values, self.ranks)

    def decision_images(self, variation: Variation | None = None) -> list[Example]:
        """The validation images that choices about the model are made on; none where the settings want none."""
        return self._validation(DECISION_IMAGES if self.settings.validation_images else 0, variation)

    def _validation(self, count: int, variation: Variation | None) -> list[Example]:
        return self._loaded(validation_rows(self.catalog, self._appearance_names(variation), count), variation)

    def _loaded(self, rows: Sequence[ImageRow], variation: Variation | None) -> list[Example]:
        return load_examples(self.catalog, rows, self.normalization, variation, self.space)

    def _appearance_names(self, variation: Variation | None) -> list[str]:
        """The appearances to learn from."""
        return [self.appearance] if variation is None else [setting.appearance for setting in variation.settings]

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Those of the appearance that is learnt, where they are learnt too."""
        variations = self.catalog.plan.variations if self.settings.visualization_steps else ()
        return tuple(v for v in variations if v.base == self.appearance)

    @property
    def histogram(self) -> tuple[NDArray[np.int64] | None, NDArray[np.float64] | None]:
        """The histogram of the training members' values, (K,), and its bins' edges (K + 1,); None where unknown.

        Values are those of the field that the appearance shows.
        """
        summaries = [m.summary(field_of(self.target)) for m in self.catalog.members if m.split == "train"]
        present = [summary for summary in summaries if summary is not None]
        if not present:
            return None, None
        return np.sum([summary.histogram for summary in present], axis=0), present[0].bin_edges

    @cached_property
    def points(self) -> StartPoints | None:
        """The points on which Gaussians start; None: anywhere in the box."""
        return initial_points(self.settings, self.catalog, self.appearance, self.normalization)

    def initial_gaussians(
        self, data: TrainingData, settings: TrainingSettings | None = None, *, own_colors: bool = True
    ) -> AnyGaussians:
        """The Gaussians that stage 1 starts from, by the run's own settings where none are given.

        Without `own_colors` all start in the mean colour of the images: the points' colours are those of the base appearance.
        """
        points = self.points
        if points is not None and not own_colors:
            points = StartPoints(points.places, None, points.values)
        box = self.normalization.points(self.catalog.plan.bounds)  # [2, 3]
        some = data.examples[:: max(1, len(data.examples) // COLOR_SAMPLES)]
        color = foreground_color(some, data.background)  # [3]
        field = self.field if settings is None else None
        return initial_gaussians(settings or self.settings, box, points, color, field)

    def start_from_field(self, model: FieldModel) -> StartFromField | None:
        """The start from the emulated field; None where Gaussians carry colours, start elsewhere, or holes move.

        None as well where the emulator predicts left-out members poorly: Gaussians that follow it are then worse than others.
        """
        emulator = self._followed(model, self.target)
        if self.field is None or emulator is None:
            return None
        return start_from_field(self.settings, emulator, self.field, self.normalization)

    def emulated_surfaces(self, model: FieldModel | None, variation: Variation) -> EmulatedSurfaces | None:
        """The surfaces that a variation's own Gaussians start on; None where it shows others, or where none are followed."""
        names = variation.named("train") if isinstance(variation, IsovalueVariation) else ()
        surfaces = [a for a in self.catalog.plan.appearances if a.name in names]
        emulator = self._followed(model, surfaces[0]) if model is not None and surfaces else None
        return None if emulator is None else EmulatedSurfaces.of(emulator, variation)

    def emulated_values(self, model: FieldModel, gaussians: AnyGaussians) -> EmulatedValues | None:
        """The emulated field at Gaussians that carry values; None where it has none that they can follow."""
        emulator = self._followed(model, self.target)
        if emulator is None or self.field is None:
            return None
        return values_at(emulator, self.field, self.normalization.world(gaussians.means.detach().numpy()))

    def _followed(self, model: FieldModel, appearance: Appearance) -> FieldEmulator | None:
        """The emulator that Gaussians start from."""
        emulator = model.emulators.get(field_of(appearance))
        if emulator is None or self.settings.initialization != "auto" or emulator.outline:
            return None
        return emulator if emulator.relative_error <= MOST_ERROR else None

    def opaque_pixels(self, variation: Variation) -> NDArray[np.float64]:
        """Some of those that pictures of a variation show, (M, 3) in [0, 1]."""
        rows = training_rows(self.catalog, self._appearance_names(variation))
        some = self._loaded(rows[:: max(1, len(rows) // LOOKED_AT)][:LOOKED_AT], variation)
        opaque = [e.pixels[e.pixels[..., 3] == 255] if e.pixels.shape[2] == 4 else e.pixels[..., :3] for e in some]
        pixels = np.concatenate([p.reshape(-1, p.shape[-1])[:, :3] for p in opaque])  # [., 3]
        return pixels[:: max(1, len(pixels) // MOST_PIXELS)] / 255.0

    def gaussians_on_surfaces(self, variation: Variation) -> Gaussians:
        """A variation's own Gaussians before training: on the surfaces, as far as the catalog has points there.

        Their colours are normals that point anywhere.
        """
        settings = self.settings.changed(gaussians=self.settings.count_on_surfaces, color_degree=0)
        points = surface_points(settings, self.catalog, variation, self.normalization) or self.points
        box = self.normalization.points(self.catalog.plan.bounds)  # [2, 3]
        gaussians = initial_gaussians(settings, box, points, np.zeros(3)).drawn()
        return with_random_normals(gaussians, settings.seed)
