"""A catalog's images in memory, as training reads them: 8-bit, with normalized cameras and parameters."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import accumulate, takewhile
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation, VariationSetting
from surrogate.gaussians import Normalization
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.value_loss import KnownValues

MEMORY = 2 << 30  # bytes of decoded images; what exceeds them is read from the catalog whenever it is used


class ImageRow(NamedTuple):
    """One image of a catalog."""

    member: Member
    view: int
    appearance: str
    setting: VariationSetting | None = None  # of the appearance, where it belongs to a variation

    @property
    def split(self) -> str:
        return self.member.row_split(self.view, self.setting)


@dataclass(frozen=True, eq=False)
class Example:
    """One image to learn from.

    Attributes
    ----------
    camera : in normalized coordinates.
    parameters : (P,) float32, normalized to [-1, 1] over their bounds; followed by the visualization parameters (V,) of
        `Variation.normalize` in training of those.
    image : (H, W, 4) uint8 premultiplied RGBA, or (H, W, 3) uint8 RGB where the catalog's images are opaque; or a function that
        reads it.
    member : the name of the member that it shows.
    """

    camera: Camera
    parameters: Tensor  # [P] or [P + V]
    image: NDArray[np.uint8] | Callable[[], NDArray[np.uint8]]  # [H, W, 3 or 4]
    member: str = ""

    @property
    def in_memory(self) -> bool:
        """False where the image is read whenever it is used."""
        return isinstance(self.image, np.ndarray)

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """The image, (H, W, 3 or 4) uint8."""
        return self.image if isinstance(self.image, np.ndarray) else self.image()

    def read(self) -> Example:
        """The same with its image in memory."""
        return self if self.in_memory else replace(self, image=self.pixels)

    def compared(self) -> NDArray[np.uint8]:
        """The target of a drawn picture: opaque pixels as they are, (H, W, 3), others over white, (H, W, 4).

        The colours over white, as they are judged, and alpha as a fourth channel, without which the colour over any other
        background is anyone's guess.  A background drawn per step constrains both too, but the noise of it cost 0.7 dB
        (Taylor-Green, 2,500 steps).
        """
        if self.pixels.shape[2] == 3:
            return self.pixels
        packed = self.pixels.view("<u4")  # [H, W, 1], alpha in the highest byte
        through = np.uint32(255) - (packed >> np.uint32(24))  # no premultiplied channel exceeds alpha: nothing carries
        return (packed + through * np.uint32(0x010101)).view(np.uint8)


@dataclass(frozen=True, eq=False)
class TrainingData:
    """The images that a run learns from, and the few that it is validated on.

    `background` (3,) is the colour that opaque images show behind the volume, None where images have alpha.  `values` are
    the fields' own at points, None where nothing is learnt of them.  Of the images of a step, and of those that are judged, each of
    the processes `ranks` draws its share.
    """

    examples: Sequence[Example]
    validation: Sequence[Example]
    background: tuple[float, float, float] | None
    values: KnownValues | None = None
    ranks: Ranks = ALONE

    def with_base(self, base: TrainingData, count: int) -> TrainingData:
        """The same and the images of the `base` appearance, where all `count` visualization parameters are zero."""
        still = torch.zeros(count)
        examples = [replace(e, parameters=torch.cat([e.parameters, still])) for e in base.examples]
        return replace(self, examples=[*self.examples, *examples])


def rows(catalog: Catalog, appearances: Sequence[str]) -> list[ImageRow]:
    """Every image of some appearances, in the order of members, appearances and views."""
    settings = {name: catalog.plan.setting(name) for name in appearances}
    return [
        ImageRow(member, view, name, settings[name])
        for member in catalog.members
        for name in appearances
        if name in member.appearances
        for view in range(len(member.cameras))
    ]


def training_rows(catalog: Catalog, appearances: Sequence[str]) -> list[ImageRow]:
    """The images to learn from; raises ValueError where there are none."""
    chosen = [row for row in rows(catalog, appearances) if row.split == "train"]
    if not chosen:
        raise ValueError(
            f"catalog {catalog.path} holds no training images of {', '.join(appearances[:4]) or 'any appearance'}: at least "
            "one member of split train with a view of split train is needed"
        )
    return chosen


def validation_rows(catalog: Catalog, appearances: Sequence[str], count: int) -> list[ImageRow]:
    """`count` images spread evenly over those kept for choices, as unlike the training images as there are.

    Validation views of validation members where there are any, else any view of those, else validation views.
    """
    chosen = [row for row in rows(catalog, appearances) if row.split == "validation"]
    of_settings = [row for row in chosen if row.setting is not None and row.setting.split == "validation"]
    chosen = of_settings or chosen
    of_members = [row for row in chosen if row.member.split == "validation"]
    of_both = [row for row in of_members if row.member.view_splits[row.view] == "validation"]
    chosen = of_both or of_members or chosen
    if not chosen or not count:
        return []
    return [chosen[i] for i in np.unique(np.linspace(0, len(chosen) - 1, count).round().astype(int))]


def load_examples(
    catalog: Catalog,
    images: Sequence[ImageRow],
    normalization: Normalization,
    variation: Variation | None = None,
    space: ParameterSpace | None = None,
) -> list[Example]:
    """Some images, (len(images)) examples in order: as many as `MEMORY` holds decoded in parallel, the others read when used.

    Their parameters are the simulation's, on the scales of `space`, by default the catalog's, followed by the visualization
    parameters of `variation` where one is given.
    """
    names = {(row.member.name, row.appearance): row for row in images}
    scales = space or catalog.plan.space
    parameters = {name: normalized_parameters(scales, row, variation) for name, row in names.items()}
    camera = functools.cache(normalization.camera)  # most are shared
    examples = [
        Example(
            camera(row.member.cameras[row.view]),
            parameters[row.member.name, row.appearance],
            functools.partial(_pixels, catalog, row),
            row.member.name,
        )
        for row in images
    ]
    fitting = fitting_in_memory(catalog, images)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return [*pool.map(Example.read, examples[:fitting]), *examples[fitting:]]


def fitting_in_memory(catalog: Catalog, images: Sequence[ImageRow]) -> int:
    """The number of images, from the first on, whose pixels `MEMORY` holds."""
    channels = 4 if catalog.plan.background is None else 3
    cameras = (row.member.cameras[row.view] for row in images)
    sizes = accumulate(camera.width * camera.height * channels for camera in cameras)
    return sum(1 for _ in takewhile(lambda size: size <= MEMORY, sizes))


def foreground_color(examples: Iterable[Example], background: Sequence[float] | None) -> NDArray[np.float64]:
    """Mean straight RGB (3,) of what is not background, over a few images; mid-grey where all is background."""
    total, weight = np.zeros(3), 0.0
    for example in examples:
        pixels = example.pixels.reshape(-1, example.pixels.shape[2]) / 255.0  # [H * W, C]
        if background is None:
            total, weight = total + pixels[:, :3].sum(0), weight + pixels[:, 3].sum()
        else:
            visible = np.abs(pixels - np.asarray(background)).max(1) > 2.0 / 255.0
            total, weight = total + pixels[visible].sum(0), weight + float(visible.sum())
    return total / weight if weight > 0 else np.full(3, 0.5)


def _pixels(catalog: Catalog, row: ImageRow) -> NDArray[np.uint8]:
    image = catalog.image(row.member, row.appearance, row.view, dtype="uint8")  # [H, W, 4]
    return image if catalog.plan.background is None else np.ascontiguousarray(image[..., :3])


def normalized_parameters(space: ParameterSpace, row: ImageRow, variation: Variation | None) -> Tensor:
    """Those of one image, (P + V,): the simulation's on the scales of `space`, and the visualization's of `variation`, if any."""
    simulation = space.normalize([row.member.parameters[name] for name in space.names])  # [P]
    if variation is None:
        return torch.from_numpy(simulation).to(torch.float32)
    visualization = variation.normalize(None if row.setting is None else row.setting.values)  # [V]
    return torch.from_numpy(np.concatenate([simulation, visualization])).to(torch.float32)
