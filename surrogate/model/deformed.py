"""The Gaussians of one member, and pictures of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import fraction, row, text
from surrogate.gaussians import Gaussians, Normalization
from surrogate.notebook import member_html
from surrogate.rasterizer import Rasterizer

NO_FIELD = (
    "this surrogate knows no field values: its catalog keeps no coarse fields, or it was trained before they were added; "
    "`insitu dataset` or `insitu ensemble` with --add-coarse-fields adds them, and `surrogate train` then fits their emulator"
)
NO_CUT = 'Gaussians can\'t be cut exactly, only the emulated field: draw it by `surrogate.using("field")`'


@dataclass(frozen=True, eq=False)
class DeformedGaussians:
    """The Gaussians of one member: `render` shows them; world units everywhere.

    Made by `Surrogate.at`; nothing here depends on the parameters any more, so moving the camera costs only drawing.  It can be
    pickled.
    """

    gaussians: Gaussians  # in normalized coordinates
    parameters: Mapping[str, float | str]  # those of the simulation, and of the visualization where they were given
    normalization: Normalization
    rasterizer: Rasterizer
    emulated: Any = None  # the `EmulatedMember` of the same parameters, where the surrogate has an emulator

    def render(self, camera: Camera, *, background: Sequence[float] | None = None) -> NDArray[np.float32]:
        """The picture that `camera` (world units) sees, (H, W, 4) float32 premultiplied RGBA in [0, 1].

        With a `background` (red, green, blue), each in [0, 1], it is opaque: composited on that colour, alpha 1.  Raises ValueError
        for another background.
        """
        return self.picture(camera, checked_background(background))

    def picture(
        self, camera: Camera, background: NDArray[np.float32] | None, threads: int | None = None
    ) -> NDArray[np.float32]:
        """The same with a background from `checked_background`, on a CPU by a number of threads, None for all cores."""
        with torch.no_grad():
            rendering = self.rasterizer.draw(self.gaussians, self.normalization.camera(camera), threads=threads)
        color, alpha = rendering.color.cpu().numpy(), rendering.alpha.cpu().numpy()[..., None]  # [H, W, 3], [H, W, 1]
        return over(np.concatenate([color, alpha], axis=-1), background)

    def sample(self, places: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The field and its standard deviation, each (N,), at world `places` (N, 3); see `EmulatedMember.sample`.

        Raises ValueError where the surrogate has no emulator of the field.
        """
        return self._numbers().sample(places)

    def field(self, shape: ArrayLike | None = None) -> Any:
        """The emulated field, see `EmulatedMember.field`; raises ValueError where the surrogate has no emulator of it."""
        return self._numbers().field(shape)

    def within(self, low: ArrayLike, high: ArrayLike) -> NoReturn:
        """Refused with ValueError: see `EmulatedMember.within`."""
        raise ValueError(NO_CUT)

    def slice(self, axis: str, at: float) -> NoReturn:
        """Refused with ValueError: see `EmulatedMember.slice`."""
        raise ValueError(NO_CUT)

    def _numbers(self) -> Any:
        if self.emulated is None:
            raise ValueError(NO_FIELD)
        return self.emulated

    @property
    def means(self) -> NDArray[np.float64]:
        """Centres in world units, (N, 3)."""
        return self.normalization.world(self.gaussians.means.cpu().numpy())

    @property
    def scales(self) -> NDArray[np.float64]:
        """Standard deviations along the principal axes in world units, (N, 3)."""
        return self.gaussians.scales().double().cpu().numpy() * self.normalization.extent

    @property
    def opacities(self) -> NDArray[np.float32]:
        """Opacities, (N,); where Gaussians absorb along rays, those of balls of the same volume."""
        return self.gaussians.opacities().cpu().numpy()

    def __len__(self) -> int:
        return len(self.gaussians)

    @property
    def contents(self) -> list[tuple[str, str]]:
        """The things that it consists of, and how many there are."""
        return [("Gaussians", f"{len(self):,}")]

    def __repr__(self) -> str:
        at = named(self.parameters)
        return f"<DeformedGaussians at {at or 'no parameters'}: {len(self):,} Gaussians>"

    def _repr_html_(self) -> str:
        """The same for notebooks, with a picture."""
        return member_html(self)


def over(picture: NDArray[np.float32], background: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """A picture (H, W, 4), premultiplied RGBA, on a background (3,), where there is one, and cut to [0, 1]."""
    if background is not None:
        alpha = picture[..., 3:]  # [H, W, 1]
        picture = np.concatenate([picture[..., :3] + (1.0 - alpha) * background, np.ones_like(alpha)], axis=-1)
    return np.clip(picture, 0.0, 1.0)


def named(parameters: Mapping[str, float | str]) -> str:
    """Parameters in words, such as "Re=1830, time=1"."""
    values = {name: text(v) if not isinstance(v, str) else repr(v) for name, v in parameters.items()}
    return ", ".join(f"{name}={value}" for name, value in values.items())


def checked_background(background: Any) -> NDArray[np.float32] | None:
    """A background as (3,) float32, None for none; raises ValueError for anything but a colour."""
    if background is None:
        return None
    what = "background, (red, green, blue) each in [0, 1],"
    return np.array([fraction(channel, what) for channel in row(background, 3, what)], dtype=np.float32)
