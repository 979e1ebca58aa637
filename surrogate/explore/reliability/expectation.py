"""The error to expect at a setting: the median of the nearest measurements, adjusted to members that training never saw.

A number is given only near to what was measured: in trained colours, within the bounds of all parameters, and from where stored
images look.  The setting must not be farther from a measured one than these are from each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from catalogs.store.catalog import Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import POINT_PARAMETERS
from surrogate.evaluation.novelty import SeenValues
from surrogate.evaluation.scoring import Report, spread
from surrogate.explore.reliability.calibration import MeasuredFamily, families_of
from surrogate.explore.reliability.measuring import Measurement, kept_measurements, measurements
from surrogate.explore.reliability.points import ISOSURFACES, SettingPoint, fractions_of, point_of
from surrogate.explore.reliability.views import Views
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting, base_function
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

# Why no error is expected: the first where no catalog is there, or nothing in it to measure with.
NO_IMAGES = "no similar image was measured"
OUTSIDE = "outside the measured range"
TOO_FAR = "too far from any measured setting"

# On cloverleaf functions with nothing new kept 31 to 48 dB, those with 22, 52 and 60 % had 26, 20 and 25; between is not measured.
NEW = 0.05  # of what a function shows: more that training never showed is outside the measured range
FAR = 1.25  # typical spacings between training members beyond which one is far from all of them
NAMED = 4  # parameters of a member that a sentence lists


@dataclass(frozen=True)
class Expected:
    """The error to expect of an image.  Distances are Euclidean, of parameters as fractions of their ranges.

    Attributes
    ----------
    training_member : the nearest training member with its parameters, such as "train-007 (Re 1812)"; "" without a catalog.
    training_distance : to that member, in simulation parameters; None without a catalog.
    far : whether that is farther than training members usually are from each other.
    unmeasured : why no number is given: `NO_IMAGES`, `TOO_FAR`, or what is `OUTSIDE`; "" where there is one.
    psnr : dB; None where nothing similar was measured.
    error : dB, the leave-one-out error of such expectations for single images; None where too little was measured.
    neighbours : how many measurements `psnr` is the median of.
    seen_views : whether these are of views that training learnt from, so that others may be worse.
    """

    training_member: str = ""
    training_distance: float | None = None
    far: bool = False
    unmeasured: str = ""
    psnr: float | None = None
    error: float | None = None
    neighbours: int = 0
    seen_views: bool = False

    @property
    def warning(self) -> bool:
        """True where the page should say more than a number, because it extrapolates."""
        return self.far or self.psnr is None

    @property
    def short(self) -> str:
        """In a few words."""
        if self.psnr is None:
            return f"not measured here: {self.unmeasured}"
        about = "" if self.error is None else f" ± {self.error:.1f}"
        return f"expected PSNR {self.psnr:.1f}{about} dB"

    @property
    def sentence(self) -> str:
        """All of it for a reader."""
        sentence = self.short
        if self.psnr is not None:
            several = f"median of the {self.neighbours} nearest measurements"
            views = " at views that training saw: others may be worse" if self.seen_views else ""
            sentence += " (higher is better; from 40 dB on differences are hardly visible), "
            sentence += (several if self.neighbours > 1 else "the only measurement") + views
        return "; ".join(filter(None, [sentence, self.nearest]))

    @property
    def nearest(self) -> str:
        """The nearest training member, and whether that is far away; "" without one."""
        far = ", farther away than training members from each other: likely worse" if self.far else ""
        return f"nearest training member {self.training_member}{far}" if self.training_member else ""

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes, `warning`, `short`, `nearest` and `sentence`."""
        return asdict(self) | {name: getattr(self, name) for name in ("warning", "short", "nearest", "sentence")}


@dataclass(frozen=True, eq=False, repr=False)
class Expectation:
    """Measurements as a table to look up the error to expect at any setting.

    Attributes
    ----------
    measured : of all families; empty where nothing could be measured.
    families : by `SettingPoint.family` and `SettingPoint.drawn_by`.
    members : the training members; empty without a catalog.
    training : (N, P) their simulation parameters as fractions of their ranges.
    views : the catalog's cameras; None without any.
    seen_values : the field values that training showed; None where that is unknown.
    """

    measured: tuple[Measurement, ...]
    families: Mapping[tuple[str, str], MeasuredFamily]
    members: tuple[Member, ...]
    training: NDArray[np.float64]
    views: Views | None = None
    seen_values: SeenValues | None = None

    @classmethod
    def of(
        cls,
        measured: Sequence[Measurement],
        surrogate: Surrogate,
        members: Sequence[Member],
        views: Views | None = None,
        seen_values: SeenValues | None = None,
    ) -> Expectation:
        """The expectation of these measurements; `members` are the catalog's."""
        learnt = tuple(m for m in members if m.split == "train")
        fractions = fractions_of(surrogate.space, [m.parameters for m in learnt])
        return cls(tuple(measured), families_of(measured, surrogate), learnt, fractions, views, seen_values)

    def at(self, setting: Setting, surrogate: Surrogate, camera: Camera | None = None) -> Expected:
        """The error to expect of `surrogate`, the one that was measured, at `setting`: a lookup.

        With a `camera` it is that of the image that this sees, else of one like those stored.  Raises ValueError for parameters
        that are missing, unknown or not finite.
        """
        point = point_of(setting, surrogate)
        nearest, family = self._nearest_member(point, surrogate), self.families.get((point.family, point.drawn_by))
        if family is None:
            return replace(nearest, unmeasured=NO_IMAGES)
        outside = self._outside(setting, point, family, surrogate, camera)
        if outside or not family.reaches(point.values):
            return replace(nearest, unmeasured=f"{outside} {OUTSIDE}" if outside else TOO_FAR)
        psnr, neighbours = family.expected_at(point.values), min(family.nearest, len(family.psnr))
        return replace(nearest, psnr=psnr, error=family.error, neighbours=neighbours, seen_views=family.seen_views)

    def _outside(
        self, setting: Setting, point: SettingPoint, family: MeasuredFamily, surrogate: Surrogate, camera: Camera | None
    ) -> str:
        """The part of a setting that lies outside the measured range; "" where none does."""
        if point.outside:
            return " and ".join(name.replace("_", " ") for name in point.outside)
        if setting.color_map:
            return "colours"
        if not family.shows(point.values[len(surrogate.space) :]) or self._new(setting, surrogate) > NEW:
            return "isovalue" if point.family == ISOSURFACES else "transfer function"
        return "" if camera is None or self.views is None or self.views.cover(camera) else "camera"

    def _new(self, setting: Setting, surrogate: Surrogate) -> float:
        """The share of what the setting's transfer function shows that training never did; 0 where that is unknown."""
        edited = set(setting.visualization) & set(POINT_PARAMETERS)
        if self.seen_values is not None and edited and base_function(surrogate) is not None:
            with suppress(ValueError):  # control points cross
                return self.seen_values.novelty(setting.transfer_function(surrogate))
        return 0.0

    def _nearest_member(self, point: SettingPoint, surrogate: Surrogate) -> Expected:
        """The training member nearest to a point, with no error expected."""
        if not len(self.training):
            return Expected()
        distance, index = self._tree.query(point.values[: len(surrogate.space)])
        member, parameters = self.members[int(index)], surrogate.space.parameters
        values = ", ".join(f"{p.name} {p.text(member.parameters[p.name], 4)} {p.unit}".rstrip() for p in parameters)
        named = f"{member.name} ({values})" if 0 < len(parameters) <= NAMED else member.name
        return Expected(named, float(distance), self._spacing is not None and distance > FAR * self._spacing)

    @cached_property
    def _spacing(self) -> float | None:
        """The median distance between a training member and its nearest neighbour; None for fewer than two."""
        if len(self.training) < 2:
            return None
        distances, _ = self._tree.query(self.training[spread(len(self.training), 1000)], k=2)  # [N, 2]
        return float(np.median(distances[:, 1]))

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.training)


@one_torch_thread()
def measure(run: Run, progress: Report = lambda *_: None) -> Expectation:
    """The expectation of a run, empty without a catalog.  Takes some seconds unless it was measured before, see `measurements`."""
    return _expectation_of(measurements(run, progress), run)


def stored_expectation(run: Run) -> Expectation | None:
    """The expectation that was measured before; None where that would have to be done."""
    measurements = kept_measurements(run)
    return None if measurements is None else _expectation_of(measurements, run)


def _expectation_of(measured: Sequence[Measurement], run: Run) -> Expectation:
    views = Views.of(run.cameras, run.middle) if measured else None
    field_values = None if run.catalog is None or not measured else SeenValues.of_training(run.catalog, run.surrogate)
    return Expectation.of(measured, run.surrogate, run.members, views, field_values)
