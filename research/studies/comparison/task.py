"""The images of a comparison on one scene: those that all methods learn from, and those that judge them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import Variation
from research.studies.baselines.method import TrainingImages
from surrogate.evaluation.cases import Case, base_cells, drawn_evenly, sample_of, variation_cells
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import fingerprint_of_scene
from surrogate.training.data import Example, ImageRow, normalized_parameters, validation_rows
from surrogate.training.source import Source

IMAGES = 24  # test images in each cell
WATCHED = 8  # validation images for curves and tuning


@dataclass(frozen=True, eq=False)
class ComparisonTask:
    """A catalog and the compared variation of it; None for the base appearance.

    Raises ValueError where there are no training images or no test images.
    """

    catalog: Catalog
    variation: Variation | None = None

    @classmethod
    def of(cls, catalog: Catalog) -> ComparisonTask:
        """The task of a catalog: the first continuous variation of its first appearance, otherwise that appearance."""
        shown = [v for v in catalog.plan.variations if v.continuous and v.base == catalog.plan.appearances[0].name]
        return cls(catalog, shown[0] if shown else None)

    @cached_property
    def mark(self) -> str:
        """Fingerprint of the catalog, wherever it was rendered, and of the choice of test images."""
        judged = f"{IMAGES} test images a cell, {WATCHED} validation images"
        return f"{fingerprint_of_scene(self.catalog)}, {judged}"

    @cached_property
    def colors(self) -> dict[str, list[float]]:
        """Mean premultiplied RGBA of each cell's test images, in [0, 1], by which other images are recognized."""
        return {
            name: np.mean([self._mean(case) for case in cases], axis=0).tolist() for name, cases in self.cells.items()
        }

    @cached_property
    def source(self) -> Source:
        """The catalog as training reads it."""
        return Source(TrainingSettings(), self.catalog)

    @cached_property
    def cells(self) -> Mapping[str, Sequence[Case]]:
        """The test images by cell, at most `IMAGES` each, drawn by a fixed seed; the same for every method."""
        if self.variation is None:
            views = base_cells(self.catalog, self.source.appearance)
            named = {
                "novel views": sample_of(views["unseen_views"]["seen_parameters"], IMAGES),
                "unseen parameters": sample_of(views["seen_views"]["unseen_parameters"], IMAGES),
                "both": sample_of(views["unseen_views"]["unseen_parameters"], IMAGES),
            }
        else:
            unseen, plural = variation_cells(self.catalog, self.variation)["unseen_settings"], self.variation.plural
            named = {
                f"unseen {plural}": drawn_evenly(unseen["seen_parameters"], IMAGES),
                f"unseen {plural} and parameters": drawn_evenly(unseen["unseen_parameters"], IMAGES),
            }
        return {name: cases for name, cases in named.items() if cases}

    @property
    def cases(self) -> list[Case]:
        """The test images of all cells."""
        return [case for cases in self.cells.values() for case in cases]

    @cached_property
    def watched(self) -> list[Case]:
        """The validation images of curves and tuning."""
        rows = validation_rows(self.catalog, self._appearances, WATCHED)
        return [Case(row.member, row.view, row.appearance, self._asked(row)) for row in rows]

    def pictures(self, device: str = "cpu") -> TrainingImages:
        """All training images; for transfer functions also those of the base, at displacements of zero.

        Tensors that methods compute with lie on `device`; pixels and cameras stay in main memory.
        """
        data = self.source.data(self.variation)
        if self.variation is not None and self.variation.kind == "transfer_function":
            data = data.with_base(self.source.data(), len(self.variation.space))
        points = self.source.points
        box = self.source.normalization.points(self.catalog.plan.bounds)  # [2, 3]
        colors = None if points is None or points.colors is None else _float32(points.colors)
        pixels, cameras, views, parameters = _stacked(data.examples)
        return TrainingImages(
            pixels,
            cameras,
            views,
            parameters.to(device),
            box=_float32(box).to(device),
            background=data.background,
            visualization=0 if self.variation is None else len(self.variation.space),
            points=None if colors is None or points is None else _float32(points.places).to(device),
            point_colors=None if colors is None else colors.to(device),
        )

    def parameters(self, case: Case) -> Tensor:
        """Normalized parameters (P,) of a test image, as in `TrainingImages`."""
        setting = self.catalog.plan.setting(case.appearance)
        row = ImageRow(case.member, case.view, case.appearance, setting)
        return normalized_parameters(self.source.space, row, self.variation)

    def camera(self, case: Case) -> Camera:
        """The camera of a test image in normalized coordinates."""
        return self.source.normalization.camera(case.camera)

    def _mean(self, case: Case) -> np.ndarray:
        """The mean RGBA (4,) of a test image."""
        return self.catalog.image(case.member, case.appearance, case.view, dtype="float32").mean(axis=(0, 1))

    @property
    def _appearances(self) -> list[str]:
        if self.variation is None:
            return [self.source.appearance]
        return [setting.appearance for setting in self.variation.settings]

    def _asked(self, row: ImageRow) -> Mapping[str, float | str]:
        return {} if self.variation is None or row.setting is None else self.variation.arguments(row.setting)


def _stacked(examples: Sequence[Example]) -> tuple[np.ndarray, list[Camera], Tensor, Tensor]:
    """Pixels, distinct cameras, views and parameters of `TrainingImages`."""
    cameras = {id(e.camera): e.camera for e in examples}
    numbers = {identity: number for number, identity in enumerate(cameras)}
    height, width = examples[0].pixels.shape[:2]
    pixels = np.full((len(examples), height, width, 4), 255, dtype=np.uint8)  # [M, H, W, 4]
    for of, example in zip(pixels, examples, strict=True):
        of[..., : example.pixels.shape[2]] = example.pixels
    views = torch.tensor([numbers[id(e.camera)] for e in examples])  # [M]
    return pixels, list(cameras.values()), views, torch.stack([e.parameters for e in examples])


def _float32(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
