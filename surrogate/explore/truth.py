"""The catalog's own pictures: which of them shows what is asked for, and which comes nearest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation
from surrogate.explore.points import appearances_of, values_of, variation_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting

SAME_VALUE = 1e-9  # relative: a decimal number there and back
_USE = {"train": "trained on", "validation": "validation: not trained on", "test": "test: not trained on"}
SAME_CAMERA = 1e-6  # of directions, of the distance to the middle, and of intrinsics: what an address of 9 digits keeps


@dataclass(frozen=True, eq=False, repr=False)
class StoredPicture:
    """A picture of the catalog.  Its member, its view and its appearance belong to a split each, "" for the base appearance."""

    member: Member
    appearance: str
    view: int
    appearance_split: str = ""

    @property
    def camera(self) -> Camera:
        return self.member.cameras[self.view]

    @property
    def view_split(self) -> str:
        return self.member.view_splits[self.view]

    @property
    def sentence(self) -> str:
        """Which it is, and what of it training saw."""
        said = [f"member {self.member.name} ({_USE[self.member.split]})", f"view {self.view} ({_USE[self.view_split]})"]
        if self.appearance_split:
            said.append(f"{self.appearance} ({_USE[self.appearance_split]})")
        return ", ".join(said)


@dataclass(frozen=True, eq=False, repr=False)
class Truth:
    """A run's catalog, members and middle, with the variations and the appearances that its surrogate follows."""

    catalog: Catalog
    members: tuple[Member, ...]
    variations: tuple[Variation, ...]
    appearances: Mapping[str, Mapping[str, float | str]]
    middle: NDArray[np.float64]

    @classmethod
    def of(cls, run: Run) -> Truth | None:
        """The pictures of the run's catalog; None without one.  Raises as `Run.members` does."""
        if run.catalog is None:
            return None
        variations = run.surrogate.variations
        return cls(run.catalog, run.members, variations, appearances_of(run.surrogate), run.middle)

    @property
    def base(self) -> str:
        """The name of the surrogate's base appearance."""
        return next(iter(self.appearances))

    def match(self, setting: Setting, camera: Camera) -> StoredPicture | None:
        """The stored picture that shows exactly this, whatever its size; None where there is none.

        Raises ValueError for visualization parameters that belong to no variation.
        """
        number = _same(self._space, values_of(self._space, [setting.parameters]), self._values)
        if number is None or setting.is_free or setting.cut is not None:
            return None
        member, appearance = self.members[number], self._appearance_at(setting)
        differences = np.abs(self._descriptors(member) - _descriptor(camera, self.middle)).max(axis=1)  # [V]
        view = int(differences.argmin())
        if appearance is None or appearance not in member.appearances or differences[view] > SAME_CAMERA:
            return None
        return self._stored_picture(member, appearance, view)

    def picture(self, match: StoredPicture) -> NDArray[np.float32]:
        """The picture at its own size, (H, W, 4) float32 premultiplied RGBA; opaque where the catalog has a background.

        Raises ImageError where its file is absent or damaged.
        """
        return self.catalog.image(match.member, match.appearance, match.view, dtype="float32")

    def nearest(self, setting: Setting, camera: Camera) -> StoredPicture | None:
        """The picture most like what the setting shows: first by appearance, then by member, then by view; None without members.

        Raises ValueError for visualization parameters that belong to no variation.
        """
        if not self.members:
            return None
        appearance = self.nearest_appearance(setting) or self.base
        member = self.nearest_member(setting, appearance)
        return self._stored_picture(member, appearance, self.nearest_view(camera, member))

    def nearest_member(self, setting: Setting, appearance: str) -> Member:
        """The nearest in simulation parameters of the members that show the appearance; raises ValueError without any.

        Distances are Euclidean, of parameters as fractions of their ranges.
        """
        able = np.array([appearance in member.appearances for member in self.members], dtype=bool)
        if not able.any():
            raise ValueError(f"no member shows {appearance!r}")
        wanted = values_of(self._space, [setting.parameters])  # [1, P]
        steps = self._space.normalize(self._values) - self._space.normalize(wanted)  # [M, P]
        return self.members[int(np.where(able, np.linalg.norm(steps, axis=1), np.inf).argmin())]

    def nearest_view(self, camera: Camera, member: Member) -> int:
        """The member's view from the direction most like the camera's, seen from the middle."""
        cosines = _directions(self._descriptors(member)) @ _directions(_descriptor(camera, self.middle)[None])[0]  # [V]
        return int(cosines.argmax())

    def nearest_appearance(self, setting: Setting) -> str | None:
        """The catalog's appearance most like the setting's, of its own kind, by distances as of members; None without any.

        Colours are not compared.  Raises ValueError for visualization parameters that belong to no variation.
        """
        variation, values = variation_of(setting.visualization, self.variations)
        if variation is None or not variation.continuous:
            names = {self._appearance_at(setting): 0.0}
        else:
            wanted, settings = variation.normalize(values), self._settings(variation)  # [V]
            names = {name: float(np.linalg.norm(variation.normalize(v) - wanted)) for name, v in settings.items()}
        present = (name for name in names if name in self.catalog.appearance_names)
        return min(present, key=names.__getitem__, default=None)

    @property
    def _space(self) -> ParameterSpace:
        return self.catalog.plan.space

    @cached_property
    def _values(self) -> NDArray[np.float64]:
        return values_of(self._space, [member.parameters for member in self.members])  # [M, P]

    @cached_property
    def _by_cameras(self) -> dict[int, NDArray[np.float64]]:
        return {}

    def _descriptors(self, member: Member) -> NDArray[np.float64]:
        """The `_descriptor` of each of the member's cameras, (V, 17); kept."""
        key = id(member.cameras)
        if key not in self._by_cameras:
            self._by_cameras[key] = np.array([_descriptor(camera, self.middle) for camera in member.cameras])
        return self._by_cameras[key]

    def _settings(self, variation: Variation) -> dict[str, tuple[float, ...]]:
        """The values (V,) of each of the variation's appearances, by name, the base among them where it has some."""
        base = {self.base: (0.0,) * len(variation.space)} if variation.edits_base else {}
        return base | {s.appearance: s.values for s in variation.settings}

    def _stored_picture(self, member: Member, appearance: str, view: int) -> StoredPicture:
        setting = self.catalog.plan.setting(appearance)
        return StoredPicture(member, appearance, view, "" if setting is None else setting.split)

    def _appearance_at(self, setting: Setting) -> str | None:
        """The appearance that shows the setting's visualization parameters; None where none does."""
        variation, values = variation_of(setting.visualization, self.variations)
        if variation is None:
            return self.base
        settings = self._settings(variation)
        number = _same(variation.space, np.array(values), np.array([*settings.values()]))
        return None if number is None else [*settings][number]


def _same(space: ParameterSpace, wanted: NDArray[np.float64], candidates: NDArray[np.float64]) -> int | None:
    """The first of the `candidates` (N, P) that agrees with `wanted` (P,), to 1e-9 of itself or of the parameters' ranges."""
    slack = SAME_VALUE * np.maximum(np.abs(candidates), [p.high - p.low for p in space.parameters])  # [N, P]
    matches = np.flatnonzero((np.abs(candidates - wanted) <= slack).all(axis=1))
    return int(matches[0]) if len(matches) else None


def _descriptor(camera: Camera, middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """A view in numbers, whatever its size, (17,): rotation, position in distances from the middle, intrinsics."""
    to_middle = camera.rotation @ middle + camera.world_to_camera[:3, 3]  # [3], in camera axes
    distance = max(float(np.linalg.norm(to_middle)), 1e-300)
    size = np.array([camera.width, camera.height])
    focal, center = np.array([camera.fx, camera.fy]) / size, np.array([camera.cx, camera.cy]) / size
    return np.concatenate([camera.rotation.ravel(), to_middle / distance, [math.log(distance)], np.log(focal), center])


def _directions(descriptors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (V, 3) from the middle to the cameras of these `_descriptor`s (V, 17); zero for one in the middle."""
    rotations, to_middle = descriptors[:, :9].reshape(-1, 3, 3), descriptors[:, 9:12]
    return -np.einsum("vij,vi->vj", rotations, to_middle)
