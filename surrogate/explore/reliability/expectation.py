"""What error to expect at a setting: the median of the nearest measurements, adjusted to members that training never saw.

A number is given only where the like was measured: within the bounds of all parameters, no farther from a measured setting than
these lie from each other, in trained colours, and from where stored pictures look.  Elsewhere the reasons are named instead.
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
from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter
from catalogs.vocabulary.variations import ISOVALUE, POINT_PARAMETERS
from surrogate.evaluation.novelty import SeenValues
from surrogate.evaluation.scoring import Report, spread
from surrogate.explore.reliability.calibration import (
    NEAREST,
    adjusted,
    generalization_gap,
    leave_one_out_error,
    predicted,
    reach,
    tables_of,
)
from surrogate.explore.reliability.measuring import Measurement, kept_measurements, measurements
from surrogate.explore.reliability.places import Place, base_name, fractions_of, place_of
from surrogate.explore.reliability.views import Views
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting, base_function
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

# On cloverleaf functions with nothing new kept 31 to 48 dB, those with 22, 52 and 60 % had 26, 20 and 25; between is not measured.
NEW = 0.05  # of what a function shows: where training never showed so much, nothing is known
FAR = 1.25  # typical spacings between training members beyond which one is far from all of them
SLACK = 1.0 + 1e-9  # distances went through decimals
NAMED = 4  # parameters of a member that a sentence lists


@dataclass(frozen=True)
class Expected:
    """What error to expect of a picture.  Distances are Euclidean, of parameters as fractions of their ranges.

    Attributes
    ----------
    training_member : the nearest training member with its parameters, such as "train-007 (Re 1812)"; "" without a catalog.
    training_distance : to that member, in simulation parameters; None without a catalog.
    training_spacing : the median distance of training members to their nearest neighbours; None for fewer than two.
    outside : names of the parameters that lie out of bounds.
    unmeasured : why no number is given, a reason each; empty where there is one.
    psnr : dB; None where nothing alike was measured.
    error : dB, the leave-one-out error of such expectations for single pictures; None where too little was measured.
    neighbours : how many measurements `psnr` is the median of.
    seen_views : whether these are of views that training learnt from, so that others may be worse.
    """

    training_member: str = ""
    training_distance: float | None = None
    training_spacing: float | None = None
    outside: tuple[str, ...] = ()
    unmeasured: tuple[str, ...] = ()
    psnr: float | None = None
    error: float | None = None
    neighbours: int = 0
    seen_views: bool = False

    @property
    def far(self) -> bool:
        """Whether the nearest training member is farther away than training members usually are from each other."""
        distance, spacing = self.training_distance, self.training_spacing
        return distance is not None and spacing is not None and distance > FAR * spacing

    @property
    def warning(self) -> bool:
        """Whether the page should say more than a number: it extrapolates, or guesses."""
        return self.far or self.psnr is None

    @property
    def short(self) -> str:
        """In a few words."""
        if self.psnr is None:
            return f"not measured here: {' and '.join(self.unmeasured)}"
        about = "" if self.error is None else f" ± {self.error:.1f}"
        return f"expected PSNR {self.psnr:.1f}{about} dB"

    @property
    def sentence(self) -> str:
        """All of it for a reader."""
        said = [self.short]
        if self.psnr is not None:
            of = (
                f"median of the {self.neighbours} nearest measurements"
                if self.neighbours > 1
                else "the only measurement"
            )
            views = " at views that training saw: others may be worse" if self.seen_views else ""
            said = [f"{self.short} (higher is better; from 40 dB on differences are hardly visible), {of}{views}"]
        return "; ".join(filter(None, [*said, self.nearest]))

    @property
    def nearest(self) -> str:
        """Which training member is nearest, and whether that is far away; "" without one."""
        far = ", farther away than training members from each other: likely worse" if self.far else ""
        return f"nearest training member {self.training_member}{far}" if self.training_member else ""

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes, `far`, `warning`, `short`, `nearest` and `sentence`."""
        said = {name: getattr(self, name) for name in ("far", "warning", "short", "nearest", "sentence")}
        return {**asdict(self), **said}


@dataclass(frozen=True, eq=False, repr=False)
class Family:
    """What a lookup needs: places (R, P + V), and the PSNR (R,) there of members that training never saw.

    `reach` is the largest distance to the nearest of the places at which such an expectation was checked.
    """

    places: NDArray[np.float64]
    psnr: NDArray[np.float64]
    error: float | None
    reach: float
    seen_views: bool

    def shows(self, visualization: NDArray[np.float64]) -> bool:
        """Whether visualization parameters (V,), as in a place, lie between those of the places."""
        shown = self.places[:, self.places.shape[1] - len(visualization) :]  # [R, V]
        return bool(((shown.min(axis=0) <= visualization + 1e-9) & (visualization - 1e-9 <= shown.max(axis=0))).all())

    def reaches(self, place: NDArray[np.float64]) -> bool:
        """Whether an expectation at `place` (P + V,) was checked from as far away as this is."""
        distance = float(np.linalg.norm(self.places - place, axis=1).min())
        return distance <= max(self.reach * SLACK, 1e-9)


@dataclass(frozen=True, eq=False, repr=False)
class Expectation:
    """Measurements as a table to look up what is expected at any setting.

    Attributes
    ----------
    measured : of all families; empty where nothing could be measured.
    families : by `Place.family`.
    members : the training members; empty without a catalog.
    training : (N, P) their simulation parameters as fractions of their ranges.
    views : the catalog's cameras; None without any.
    seen : what training showed of every field value; None where that is not known.
    """

    measured: tuple[Measurement, ...]
    families: Mapping[str, Family]
    members: tuple[Member, ...]
    training: NDArray[np.float64]
    views: Views | None = None
    seen: SeenValues | None = None

    @classmethod
    def of(
        cls,
        measured: Sequence[Measurement],
        surrogate: Surrogate,
        members: Sequence[Member],
        views: Views | None = None,
        seen: SeenValues | None = None,
    ) -> Expectation:
        """The expectation of these measurements; `members` are the catalog's."""
        tables = tables_of(measured, surrogate)
        gap = generalization_gap(tables[base_name(surrogate)]) if base_name(surrogate) in tables else None
        at_seen_views = {place_of(m.setting, surrogate).family for m in measured if m.seen_views}
        families = {
            name: Family(
                table.places, adjusted(table, gap), leave_one_out_error(table, gap), reach(table), name in at_seen_views
            )
            for name, table in tables.items()
        }
        learnt = tuple(m for m in members if m.split == "train")
        fractions = fractions_of(surrogate.space, [m.parameters for m in learnt])
        return cls(tuple(measured), families, learnt, fractions, views, seen)

    @cached_property
    def training_spacing(self) -> float | None:
        """The median distance between a training member and its nearest neighbour; None for fewer than two."""
        if len(self.training) < 2:
            return None
        distances, _ = self._tree.query(self.training[spread(len(self.training), 1000)], k=2)  # [N, 2]
        return float(np.median(distances[:, 1]))

    def at(self, setting: Setting, surrogate: Surrogate, camera: Camera | None = None) -> Expected:
        """What is expected of `surrogate`, the one that was measured, at `setting`: a lookup.

        With a `camera` it is that of the picture that this sees, else of one like those stored.  Raises ValueError for parameters
        that are missing, unknown or not finite.
        """
        place = place_of(setting, surrogate)
        found = Expected(**self._nearest_member(place, surrogate), outside=place.outside)
        family = self.families.get(place.family)
        reasons = self._unmeasured(setting, place, family, surrogate)
        if camera is not None and self.views is not None and family is not None:
            reasons += self.views.unlike(camera)
        if reasons or family is None:
            return replace(found, unmeasured=tuple(reasons))
        psnr, neighbours = predicted(family.places, family.psnr, place.values), min(NEAREST, len(family.psnr))
        return replace(found, psnr=psnr, error=family.error, neighbours=neighbours, seen_views=family.seen_views)

    def _unmeasured(self, setting: Setting, place: Place, family: Family | None, surrogate: Surrogate) -> list[str]:
        """Reasons why no measurement tells anything of the setting."""
        reasons = [_beyond(name, setting, surrogate) for name in place.outside]
        if setting.color_map:
            reasons.append("these colours were never trained")
        function = _function(setting, surrogate)
        reasons += [] if function is None else self.new_in(function)
        if family is None:
            reasons.append(
                "no measured picture shows the like"
                if self.families
                else "no picture was kept from training to measure with"
                if self.members
                else "the pictures that it learnt from are not here"
            )
        elif not reasons and not family.shows(place.values[len(surrogate.space) :]):
            reasons.append("no measured picture shows the field in so different a way")
        elif not reasons and not family.reaches(place.values):
            reasons.append("this lies farther from every measured setting than those lie from each other")
        return reasons

    def new_in(self, function: TransferFunction) -> list[str]:
        """Why nothing is known under a transfer function: how much of what it shows training never did; nothing for little."""
        new = 0.0 if self.seen is None else self.seen.novelty(function)
        return [f"{100.0 * new:.0f} % of what is shown was never visible in training"] if new > NEW else []

    def _nearest_member(self, place: Place, surrogate: Surrogate) -> dict[str, Any]:
        if not len(self.training):
            return {}
        distance, index = self._tree.query(place.values[: len(surrogate.space)])
        member = self.members[int(index)]
        values = [_said(p, member.parameters[p.name]) for p in surrogate.space.parameters]
        listed = f" ({', '.join(values)})" if 0 < len(values) <= NAMED else ""
        return {
            "training_member": f"{member.name}{listed}",
            "training_distance": float(distance),
            "training_spacing": self.training_spacing,
        }

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.training)


def _function(setting: Setting, surrogate: Surrogate) -> TransferFunction | None:
    """The transfer function that a setting asks for; None where it asks for none, or for one that can't be."""
    if base_function(surrogate) is None or not (
        setting.color_map or set(setting.visualization) & set(POINT_PARAMETERS)
    ):
        return None
    with suppress(ValueError):  # control points that cross, which `outside` names already
        return setting.transfer_function(surrogate)
    return None


def _beyond(name: str, setting: Setting, surrogate: Surrogate) -> str:
    """That a parameter lies out of bounds; control points, which a setting holds as displacements, without their values."""
    if name in surrogate.space.names or name == ISOVALUE:
        spaces = [surrogate.space, *(v.variation.space for v in surrogate.visualizations)]
        of = next(p for space in spaces for p in space.parameters if p.name == name)
        unit = f" {of.unit}" if of.unit else ""
        return f"{_said(of, float(setting.values[name]))} lies outside {of.low:g} to {of.high:g}{unit}"
    return f"{name.replace('_', ' ')} lies outside what training showed"


def _said(parameter: Parameter, value: float) -> str:
    return f"{parameter.name} {value:.4g} {parameter.unit}".rstrip()


@one_torch_thread()
def measure(run: Run, progress: Report = lambda *_: None) -> Expectation:
    """What to expect of a run, nothing without a catalog.  Takes some seconds unless it was measured before, see `measurements`."""
    return _told_by(measurements(run, progress), run)


def known(run: Run) -> Expectation | None:
    """What was measured before; None where that would have to be done."""
    kept = kept_measurements(run)
    return None if kept is None else _told_by(kept, run)


def _told_by(measured: Sequence[Measurement], run: Run) -> Expectation:
    views = Views.of(run.cameras, run.middle) if measured else None
    seen = None if run.catalog is None or not measured else SeenValues.of_training(run.catalog, run.surrogate)
    return Expectation.of(measured, run.surrogate, run.members, views, seen)
