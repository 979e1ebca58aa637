"""The time that reading images takes in a training, beside its steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from catalogs.store.catalog import Catalog
from surrogate.training.data import ImageRow, fitting_in_memory
from surrogate.training.stages import COOLDOWN
from surrogate.training.step_images import share_in_memory


@dataclass(frozen=True)
class Reading:
    """Seconds that reading images takes beside the steps.

    Attributes
    ----------
    images, in_memory : numbers of images, and of those that are read before the first step.
    load : seconds of one.
    late : the share of steps whose image is read for them, or was in memory: the others have it downsampled from an earlier epoch.
    """

    images: int
    in_memory: int
    load: float
    late: float

    @classmethod
    def of(cls, catalog: Catalog, rows: Sequence[Sequence[ImageRow]], factor: int, load: float) -> Reading:
        """For training on `rows` of images that are downsampled by a factor in early steps."""
        images, in_memory = sum(map(len, rows)), sum(fitting_in_memory(catalog, of) for of in rows)
        again = share_in_memory(4.0 * images * pixels(rows[0]) / factor**2) if factor > 1 else 0.0
        return cls(images, in_memory, load, 1.0 - (1.0 - COOLDOWN) * again)

    @property
    def before(self) -> float:
        """Seconds before the first step."""
        return self.load * self.in_memory

    def steps(self, seconds: float, step: float, factor: float) -> tuple[int, float]:
        """The number of steps that fit, each of `step` seconds and `factor` times in all, and a step's seconds with its reading."""
        read = self.load * (1.0 - self.in_memory / self.images)
        first = read * self.images * (1.0 - self.late)  # each of those that are kept is read once
        few, many = (
            int(s / (each * factor)) for s, each in ((seconds, step + read), (seconds - first, step + self.late * read))
        )
        return max(few, many), step + read * (self.late if many > few else 1.0)


def pixels(rows: Sequence[ImageRow]) -> int:
    """Of the first image."""
    camera = rows[0].member.cameras[rows[0].view]
    return camera.width * camera.height
