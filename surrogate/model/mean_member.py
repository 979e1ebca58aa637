"""One member drawn twice, by its Gaussians and from its emulated field: the mean of the two pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Normalization
from surrogate.model.deformed import DeformedGaussians, checked_background, named
from surrogate.model.emulated_member import EmulatedMember
from surrogate.notebook import member_html


@dataclass(frozen=True, eq=False)
class MeanMember:
    """The mean of two predictions, whose errors differ, is mostly better than either.  Made by `Surrogate.at`."""

    gaussians: DeformedGaussians
    emulated: EmulatedMember

    @property
    def parameters(self) -> Mapping[str, float | str]:
        """Those of the simulation, and of the visualization where they were given."""
        return self.emulated.parameters

    @property
    def normalization(self) -> Normalization:
        """Between world and normalized coordinates."""
        return self.emulated.normalization

    def render(self, camera: Camera, *, background: Sequence[float] | None = None) -> NDArray[np.float32]:
        """The picture that `camera` sees, (H, W, 4) float32 premultiplied RGBA in [0, 1]; see `EmulatedMember.render`."""
        return self.picture(camera, checked_background(background))

    def picture(
        self, camera: Camera, background: NDArray[np.float32] | None, threads: int | None = None
    ) -> NDArray[np.float32]:
        """The same with a background from `checked_background`, on a CPU by a number of threads, None for all cores."""
        return self._pictures(camera, background, threads)[-1]

    def pictures(self, camera: Camera, background: Sequence[float] | None) -> list[NDArray[np.float32]]:
        """The picture by the Gaussians, the one from the field, and their mean, each as `render` returns it."""
        return self._pictures(camera, checked_background(background))

    def _pictures(
        self, camera: Camera, background: NDArray[np.float32] | None, threads: int | None = None
    ) -> list[NDArray[np.float32]]:
        by_gaussians = self.gaussians.picture(camera, background, threads)
        from_field = self.emulated.picture(camera, background, threads)
        return [by_gaussians, from_field, 0.5 * (by_gaussians + from_field)]

    def sample(self, places: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The field and its standard deviation at world places (N, 3); see `EmulatedMember.sample`."""
        return self.emulated.sample(places)

    def field(self, shape: ArrayLike | None = None) -> Any:
        """The emulated field; see `EmulatedMember.field`."""
        return self.emulated.field(shape)

    def within(self, low: ArrayLike, high: ArrayLike) -> NoReturn:
        """Refused with ValueError: see `EmulatedMember.within`."""
        self.gaussians.within(low, high)

    def slice(self, axis: str, at: float) -> NoReturn:
        """Refused with ValueError: see `EmulatedMember.slice`."""
        self.gaussians.slice(axis, at)

    @property
    def contents(self) -> list[tuple[str, str]]:
        """The things that it consists of, and how many there are."""
        return [*self.gaussians.contents, *self.emulated.contents]

    def __repr__(self) -> str:
        at, count = named(self.parameters), len(self.gaussians)
        return f"<MeanMember at {at or 'no parameters'}: {count:,} Gaussians and the emulated field>"

    def _repr_html_(self) -> str:
        """The same for notebooks, with a picture."""
        return member_html(self)


# One member of an ensemble, drawn by any of its representations.
MemberModel = DeformedGaussians | EmulatedMember | MeanMember
