"""The catalog's own pictures: which of them shows what is asked for, and which comes nearest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.cameras import Camera
from catalogs.catalog import Catalog, Member
from catalogs.parameters import ParameterSpace
from catalogs.variations import Variation
from surrogate.explore.reliability.places import asked, base_name, fractions_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting

SAME_VALUE = 1e-9  # relative: a decimal number there and back
NEAR = 1e-3  # of the range: what lies within is compared number by number
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
    base : name of the surrogate's base appearance.
    variations : those that the surrogate follows.
    middle : (3,) world coordinates from which directions are taken: the centre of the catalog's box.
    """

    catalog: Catalog
    members: tuple[Member, ...]
    base: str
    variations: tuple[Variation, ...]
    middle: NDArray[np.float64]

    @classmethod
    def of(cls, run: Run) -> Truth | None:
        """The pictures of the run's catalog; None without one.  Raises as `Run.members` does."""
        if run.catalog is None:
            return None
        variations = tuple(v.variation for v in run.surrogate.visualizations)
        middle = np.mean(np.array(run.catalog.plan.bounds), axis=0)  # [3]
        return cls(run.catalog, run.members, base_name(run.surrogate), variations, middle)

    def match(self, setting: Setting, camera: Camera) -> Stored | None:
        """The stored picture that shows exactly this, whatever its size; None where there is none.

        Raises ValueError for visualization parameters that belong to no variation.
        """
        member = self._member_at(setting.parameters)
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

    def nearest_member(self, setting: Setting, *, shows: str = "") -> tuple[Member, float]:
        """The member nearest in simulation parameters, and how far it is: Euclidean, of fractions of their ranges.

        With `shows` one that was rendered in that appearance.  Raises ValueError without any.
        """
        able = np.array([not shows or shows in member.appearances for member in self.members], dtype=bool)
        if not able.any():
            raise ValueError(f"no member shows {shows!r}" if shows else "the catalog has no members")
        steps = self._fractions - fractions_of(self._space, [setting.parameters])  # [M, P]
        distances = np.where(able, np.linalg.norm(steps, axis=1), np.inf)  # [M]
        nearest = int(distances.argmin())
        return self.members[nearest], float(distances[nearest])

    def nearest_view(self, camera: Camera, member: Member) -> tuple[int, float]:
        """The member's view from the direction most like the camera's, seen from the middle, and the degrees between them."""
        directions, _ = self._views(member)
        cosines = directions @ _unit(camera.position - self.middle)  # [V]
        nearest = int(cosines.argmax())
        return nearest, math.degrees(math.acos(min(1.0, max(-1.0, float(cosines[nearest])))))

    def nearest_appearance(self, setting: Setting, member: Member | None = None) -> tuple[str, float] | None:
        """The appearance most like the setting's, and how far it is: Euclidean, of fractions of the parameters' ranges.

        Only of its own kind, and of those that `member` shows; None without any.  Colours are not compared.  Raises ValueError for
        visualization parameters that belong to no variation.
        """
        shown = self.catalog.appearance_names if member is None else member.appearances
        variation, values = asked(setting.visualization, self.variations)
        functions = next((v for v in self.variations if v.edits_base), None)
        if variation is None and functions is not None:
            variation = functions
        if variation is None or not variation.continuous:
            name = self._appearance_at(setting)
            return None if name is None or name not in shown else (name, 0.0)
        wanted = variation.normalize(values) / 2.0  # [V]
        known = [(s.appearance, s.values) for s in variation.settings if s.appearance in shown]
        places = {name: variation.normalize(given) / 2.0 for name, given in known}
        if variation.edits_base and self.base in shown:
            places = {self.base: variation.normalize(None) / 2.0, **places}
        distances = {name: float(np.linalg.norm(place - wanted)) for name, place in places.items()}
        nearest = min(distances, key=distances.__getitem__, default=None)
        return None if nearest is None else (nearest, distances[nearest])

    def asked(self, appearance: str) -> dict[str, float | str]:
        """What a `Setting` must ask for to show this appearance; nothing for the base.  Raises ValueError for unknown ones."""
        if appearance == self.base:
            return {}
        for variation in self.variations:
            setting = variation.setting(appearance)
            if setting is not None:
                return variation.asked(setting)
        raise ValueError(f"the surrogate does not follow the appearance {appearance!r}")

    @property
    def _space(self) -> ParameterSpace:
        return self.catalog.plan.space

    @cached_property
    def _fractions(self) -> NDArray[np.float64]:
        return fractions_of(self._space, [member.parameters for member in self.members])  # [M, P]

    @cached_property
    def _seen(self) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        return {}

    def _views(self, member: Member) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit directions (V, 3) of the member's cameras from the middle, and `_form` of each (V, 17); kept."""
        key = id(member.cameras)
        if key not in self._seen:
            directions = np.array([_unit(camera.position - self.middle) for camera in member.cameras])
            self._seen[key] = directions, np.array([_form(camera, self.middle) for camera in member.cameras])
        return self._seen[key]

    def _member_at(self, parameters: Mapping[str, float]) -> Member | None:
        wanted = {p.name: parameters[p.name] for p in self._space.parameters}
        near = np.flatnonzero(
            np.abs(self._fractions - fractions_of(self._space, [wanted])).max(axis=1, initial=0.0) < NEAR
        )
        candidates = (self.members[i] for i in near)
        return next((m for m in candidates if _same(self._space, m.parameters, wanted)), None)

    def _appearance_at(self, setting: Setting) -> str | None:
        """The appearance that shows the setting's visualization parameters; None where none does."""
        variation, values = asked(setting.visualization, self.variations)
        if variation is None or values is None:
            return self.base
        given = dict(zip(variation.space.names, values, strict=True))
        if variation.edits_base and _same(variation.space, dict.fromkeys(given, 0.0), given):
            return self.base
        known = ((s.appearance, dict(zip(given, s.values, strict=True))) for s in variation.settings)
        return next((name for name, values in known if _same(variation.space, values, given)), None)

    def _view_at(self, camera: Camera, member: Member) -> int | None:
        _, forms = self._views(member)
        differences = np.abs(forms - _form(camera, self.middle)).max(axis=1)  # [V]
        nearest = int(differences.argmin())
        return nearest if differences[nearest] <= SAME_CAMERA else None


def _same(space: ParameterSpace, known: Mapping[str, float], wanted: Mapping[str, float]) -> bool:
    """Whether all parameters agree, to a relative 1e-9 of themselves or of their ranges."""
    return all(
        abs(known[p.name] - wanted[p.name]) <= SAME_VALUE * max(abs(known[p.name]), p.high - p.low)
        for p in space.parameters
    )


def _form(camera: Camera, middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """What makes a view what it is, whatever its size, (17,): rotation, place in distances from the middle, intrinsics."""
    to_middle = camera.rotation @ middle + camera.world_to_camera[:3, 3]  # [3], in camera axes
    distance = float(np.linalg.norm(to_middle))
    focal = np.array([camera.fx / camera.width, camera.fy / camera.height])
    center = np.array([camera.cx / camera.width, camera.cy / camera.height])
    scale = max(distance, 1e-300)
    return np.concatenate([camera.rotation.ravel(), to_middle / scale, [math.log(scale)], np.log(focal), center])


def _unit(vector: ArrayLike) -> NDArray[np.float64]:
    """The vector (3,) with length 1; zero stays zero."""
    vector = np.asarray(vector, dtype=np.float64)
    return vector / max(float(np.linalg.norm(vector)), 1e-300)
