"""The catalog's own pictures: which of them shows what is asked for, and which comes nearest."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from catalogs.cameras import Camera
from catalogs.catalog import Catalog, Member
from catalogs.parameters import ParameterSpace
from catalogs.variations import Variation
from surrogate.explore.reliability.places import asked, shown_by
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting

SAME_VALUE = 1e-9  # relative: a decimal number there and back
SAME_CAMERA = 1e-6  # of directions, of the distance to the middle, and of intrinsics: what an address of 9 digits keeps


@dataclass(frozen=True, eq=False)
class Stored:
    """A picture of the catalog; `split` is that of the image: test wins over validation, validation over train."""

    member: Member
    appearance: str
    view: int
    split: str

    @property
    def camera(self) -> Camera:
        return self.member.cameras[self.view]


@dataclass(frozen=True, eq=False)
class Truth:
    """A catalog's members, and the appearances that a surrogate follows.

    Attributes
    ----------
    members : as in `Run`.
    variations : those that the surrogate follows.
    shown : what a `Setting` asks for to show each appearance that the surrogate follows, by name; the base first.
    middle : (3,) world coordinates from which directions are taken: the centre of the catalog's box.
    """

    catalog: Catalog
    members: tuple[Member, ...]
    variations: tuple[Variation, ...]
    shown: Mapping[str, Mapping[str, float | str]]
    middle: NDArray[np.float64]

    @classmethod
    def of(cls, run: Run) -> Truth | None:
        """The pictures of the run's catalog; None without one.  Raises as `Run.members` does."""
        if run.catalog is None:
            return None
        variations = tuple(v.variation for v in run.surrogate.visualizations)
        middle = np.mean(np.array(run.catalog.plan.bounds), axis=0)  # [3]
        return cls(run.catalog, run.members, variations, shown_by(run.surrogate), middle)

    @property
    def base(self) -> str:
        """The name of the surrogate's base appearance."""
        return next(iter(self.shown))

    def match(self, setting: Setting, camera: Camera) -> Stored | None:
        """The stored picture that shows exactly this, whatever its size; None where there is none.

        Raises ValueError for visualization parameters that belong to no variation.
        """
        member = self._member_at(setting)
        appearance = None if member is None or setting.color_map else self._appearance_at(setting)
        if member is None or appearance is None or appearance not in member.appearances:
            return None
        view = self._view_at(camera, member)
        return None if view is None else self.stored(member, appearance, view)

    def stored(self, member: Member, appearance: str, view: int) -> Stored:
        """One picture; raises ValueError for one that the catalog does not have."""
        if appearance not in member.appearances or not 0 <= view < len(member.cameras):
            raise ValueError(f"member {member.name} has no view {view} of {appearance!r}")
        return Stored(member, appearance, view, member.row_split(view, self.catalog.plan.setting(appearance)))

    def picture(self, stored: Stored) -> NDArray[np.float32]:
        """The picture at its own size, (H, W, 4) float32 premultiplied RGBA; opaque where the catalog has a background.

        Raises ImageError where its file is absent or damaged.
        """
        return self.catalog.image(stored.member, stored.appearance, stored.view, dtype="float32")

    def nearest(self, setting: Setting, camera: Camera) -> Stored | None:
        """The picture most like what the setting shows: first by appearance, then by member, then by view; None without members.

        Raises ValueError for visualization parameters that belong to no variation.
        """
        if not self.members:
            return None
        appearance = self.nearest_appearance(setting) or self.base
        member = self.nearest_member(setting, appearance)
        return self.stored(member, appearance, self.nearest_view(camera, member))

    def nearest_member(self, setting: Setting, appearance: str) -> Member:
        """The nearest in simulation parameters of the members that show the appearance; raises ValueError without any.

        Distances are Euclidean, of parameters as fractions of their ranges.
        """
        able = np.array([appearance in member.appearances for member in self.members], dtype=bool)
        if not able.any():
            raise ValueError(f"no member shows {appearance!r}")
        steps = self._space.normalize(self._values) - self._space.normalize(self._wanted(setting))  # [M, P]
        return self.members[int(np.where(able, np.linalg.norm(steps, axis=1), np.inf).argmin())]

    def nearest_view(self, camera: Camera, member: Member) -> int:
        """The member's view from the direction most like the camera's, seen from the middle."""
        cosines = _directions(self._forms(member)) @ _directions(_form(camera, self.middle)[None])[0]  # [V]
        return int(cosines.argmax())

    def nearest_appearance(self, setting: Setting) -> str | None:
        """The catalog's appearance most like the setting's, of its own kind, by distances as of members; None without any.

        Colours are not compared.  Raises ValueError for visualization parameters that belong to no variation.
        """
        variation, values = asked(setting.visualization, self.variations)
        if variation is None or not variation.continuous:
            name = self._appearance_at(setting)
            return name if name in self.catalog.appearance_names else None
        wanted = variation.normalize(values)  # [V]
        distances = {
            name: float(np.linalg.norm(variation.normalize(known) - wanted))
            for name, known in self._settings(variation).items()
            if name in self.catalog.appearance_names
        }
        return min(distances, key=distances.__getitem__, default=None)

    @property
    def _space(self) -> ParameterSpace:
        return self.catalog.plan.space

    @cached_property
    def _values(self) -> NDArray[np.float64]:
        rows = [[member.parameters[name] for name in self._space.names] for member in self.members]
        return np.array(rows).reshape(len(rows), len(self._space))  # [M, P]

    @cached_property
    def _kept(self) -> dict[int, NDArray[np.float64]]:
        return {}

    def _forms(self, member: Member) -> NDArray[np.float64]:
        """The `_form` of each of the member's cameras, (V, 17); kept."""
        key = id(member.cameras)
        if key not in self._kept:
            self._kept[key] = np.array([_form(camera, self.middle) for camera in member.cameras])
        return self._kept[key]

    def _settings(self, variation: Variation) -> dict[str, tuple[float, ...]]:
        """The values (V,) of each of the variation's appearances, by name, the base among them where it has some."""
        base = {self.base: (0.0,) * len(variation.space)} if variation.edits_base else {}
        return base | {s.appearance: s.values for s in variation.settings}

    def _wanted(self, setting: Setting) -> list[float]:
        return [setting.parameters[name] for name in self._space.names]

    def _member_at(self, setting: Setting) -> Member | None:
        found = _same(self._space, self._wanted(setting), self._values)
        return None if found is None else self.members[found]

    def _appearance_at(self, setting: Setting) -> str | None:
        """The appearance that shows the setting's visualization parameters; None where none does."""
        variation, values = asked(setting.visualization, self.variations)
        if variation is None:
            return self.base
        known = self._settings(variation)
        found = _same(variation.space, values, np.array([*known.values()]))
        return None if found is None else [*known][found]

    def _view_at(self, camera: Camera, member: Member) -> int | None:
        differences = np.abs(self._forms(member) - _form(camera, self.middle)).max(axis=1)  # [V]
        nearest = int(differences.argmin())
        return nearest if differences[nearest] <= SAME_CAMERA else None


def _same(space: ParameterSpace, wanted: Sequence[float], known: NDArray[np.float64]) -> int | None:
    """The first of the `known` (N, P) that agrees with what is `wanted` (P,), to 1e-9 of itself or of the parameters' ranges."""
    slack = SAME_VALUE * np.maximum(np.abs(known), [p.high - p.low for p in space.parameters])  # [N, P]
    found = np.flatnonzero((np.abs(known - wanted) <= slack).all(axis=1))
    return int(found[0]) if len(found) else None


def _form(camera: Camera, middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """What makes a view what it is, whatever its size, (17,): rotation, place in distances from the middle, intrinsics."""
    to_middle = camera.rotation @ middle + camera.world_to_camera[:3, 3]  # [3], in camera axes
    distance = float(np.linalg.norm(to_middle))
    focal = np.array([camera.fx / camera.width, camera.fy / camera.height])
    center = np.array([camera.cx / camera.width, camera.cy / camera.height])
    scale = max(distance, 1e-300)
    return np.concatenate([camera.rotation.ravel(), to_middle / scale, [math.log(scale)], np.log(focal), center])


def _directions(forms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (V, 3) from the middle to the cameras of these `_form`s (V, 17); zero for one in the middle."""
    rotations, to_middle = forms[:, :9].reshape(-1, 3, 3), forms[:, 9:12]
    return -np.einsum("vij,vi->vj", rotations, to_middle)
