"""One member as its emulated field, drawn by the ray caster."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import finite
from catalogs.vocabulary.quantity import Quantity
from native.ray_casting import SampledField, SurfaceCaster, VolumeCaster, fitting_distance
from native.ray_casting.cuts import AXES, Cut, sliced
from native.ray_casting.fields import triple
from surrogate.emulation import EmulatedField, FieldEmulator
from surrogate.gaussians import Normalization
from surrogate.model.deformed import checked_background, named, over
from surrogate.notebook import first_camera, member_html

NO_COLORS = "a slice has the colours of a transfer function, and an isosurface has none: show the volume"


@dataclass(frozen=True, eq=False)
class EmulatedMember:
    """The emulated field of one member in one appearance: `render` shows it; world units everywhere.

    Made by `Surrogate.at`.  The field is computed when it is first asked for, and kept.

    Attributes
    ----------
    point : (P,) normalized simulation parameters.
    sample_distance : along rays through a volume, world units; None for what the appearance needs.
    quantity : the field's name and unit.
    cut : what of the field is drawn; None for all.
    uncut : the member that this one is cut from, which keeps the field for all cuts; None where nothing is cut.
    """

    emulator: FieldEmulator
    point: NDArray[np.float64]  # [P]
    appearance: VolumeRendering | Isosurface
    parameters: Mapping[str, float | str]
    normalization: Normalization
    sample_distance: float | None = None
    quantity: Quantity = Quantity()  # noqa: RUF009 - frozen
    cut: Cut | None = None
    uncut: EmulatedMember | None = None

    @cached_property
    def _field(self) -> EmulatedField:
        if self.uncut is not None:
            return self.uncut._field
        return replace(self.emulator.at(self.point), quantity=self.quantity)

    def field(self, shape: ArrayLike | None = None) -> EmulatedField:
        """The field on its lattice, or on `shape` (Z, Y, X) samples over the same box; see `EmulatedField.resampled`."""
        return self._field if shape is None else self._field.resampled(shape)

    @cached_property
    def samples(self) -> SampledField:
        """The field as it is drawn."""
        if self.uncut is not None:
            return self.uncut.samples
        field = self._field
        return SampledField(field.values, field.holes, field.spacing, field.origin)

    @cached_property
    def distance(self) -> float:
        """Between samples along rays through a volume, world units."""
        if self.sample_distance:
            return self.sample_distance
        assert isinstance(self.appearance, VolumeRendering)
        return fitting_distance(self.samples, self.appearance, first_camera(self.normalization))

    @cached_property
    def _caster(self) -> VolumeCaster | SurfaceCaster:
        if isinstance(self.appearance, VolumeRendering):
            return VolumeCaster.of(self.samples, self.appearance, sample_distance=self.distance)
        return SurfaceCaster.of(self.samples, self.appearance)

    @cached_property
    def _cut_caster(self) -> VolumeCaster | SurfaceCaster:
        if self.cut is None or self.uncut is None:
            return self._caster
        caster = self.uncut._caster if self.cut.plane is None else self.uncut._slice_caster
        return caster.within(self.cut.bounds(self.samples))

    @cached_property
    def _slice_caster(self) -> VolumeCaster:
        assert isinstance(self.appearance, VolumeRendering)
        return VolumeCaster.of(self.samples, sliced(self.appearance, self.samples))

    def within(self, low: ArrayLike, high: ArrayLike) -> EmulatedMember:
        """The same of which pictures show what lies in a box alone, exactly: rays begin and end there, and surfaces are cut.

        `low` and `high` are its corners (x, y, z) in world units.  Raises ValueError for others.
        """
        return self.cut_to(replace(self.cut or Cut(), box=(triple(low, "low", finite), triple(high, "high", finite))))

    def slice(self, axis: str, at: float) -> EmulatedMember:
        """The same of which pictures show the plane `axis` = `at` (world units) alone: field values in colours, opaque.

        The colours are those of the transfer function; holes are transparent.  Where `within` was called the plane ends at that
        box.  Raises ValueError for another axis than "x", "y" and "z", and for an isosurface, which has one colour alone.
        """
        if axis not in (*AXES,):
            raise ValueError(f"a slice is perpendicular to x, y or z, got {axis!r}")
        return self.cut_to(replace(self.cut or Cut(), plane=(AXES.index(axis), finite(at, "at"))))

    def cut_to(self, cut: Cut) -> EmulatedMember:
        """The same of which pictures show what a cut leaves alone; raises ValueError for a slice of an isosurface."""
        if cut.plane is not None and not isinstance(self.appearance, VolumeRendering):
            raise ValueError(NO_COLORS)
        return replace(self, cut=cut, uncut=self.uncut or self)

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
        return over(self._cut_caster.draw(camera, threads=threads), background)

    def sample(self, places: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The field and its standard deviation, each (N,), at world `places` (N, 3); NaN outside the field and in holes."""
        return self.emulator.sample(self.point, np.asarray(places, dtype=np.float64))

    @property
    def contents(self) -> list[tuple[str, str]]:
        """The things that it consists of, and how many there are."""
        nz, ny, nx = self.emulator.shape
        return [("samples of the field", f"{nx} x {ny} x {nz}")]

    def __repr__(self) -> str:
        at = named(self.parameters)
        nz, ny, nx = self.emulator.shape
        return f"<EmulatedMember at {at or 'no parameters'}: {nx} x {ny} x {nz} samples>"

    def _repr_html_(self) -> str:
        """The same for notebooks, with a picture."""
        return member_html(self)
