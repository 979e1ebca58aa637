"""What error to expect at a setting: the median of the nearest measurements, adjusted to members that training never saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from catalogs.catalog import Member
from surrogate.evaluation.scoring import Report, spread
from surrogate.explore.reliability.calibration import (
    NEAREST,
    adjusted,
    generalization_gap,
    leave_one_out_error,
    predicted,
    tables_of,
)
from surrogate.explore.reliability.measuring import Measurement, measurements
from surrogate.explore.reliability.places import base_name, fractions_of, place_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

FAR = 1.25  # typical spacings between training members beyond which one is far from all of them


@dataclass(frozen=True)
class Expected:
    """What error to expect at a setting.  Distances are Euclidean, of parameters as fractions of their ranges.

    Attributes
    ----------
    training_distance : to the nearest training member, in simulation parameters; None without a catalog.
    training_spacing : the median distance of training members to their nearest neighbours; None for fewer than two.
    outside : names of the parameters that lie out of bounds.
    recolored : whether colours are shown that no picture was trained in.
    psnr : dB; None where nothing alike was measured, or for colours that no picture shows.
    error : dB, the leave-one-out error of such expectations for single pictures; None where too little was measured.
    neighbours : how many measurements it is the median of.
    seen_views : whether these are of views that training learnt from, so that others may be worse.
    """

    training_distance: float | None
    training_spacing: float | None
    outside: tuple[str, ...] = ()
    recolored: bool = False
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
        return self.far or bool(self.outside) or self.recolored

    @property
    def sentence(self) -> str:
        """All of it for a reader."""
        said = [self._decibels()]
        if self.training_distance is not None:
            far = ", farther than usual: likely worse" if self.far else ""
            said.append(f"nearest training member {self.training_distance:.2f} of the range away{far}")
        if self.outside:
            said.append(f"{', '.join(self.outside)} out of bounds: a guess")
        return "; ".join(said)

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes, `far`, `warning` and `sentence`."""
        return {**asdict(self), "far": self.far, "warning": self.warning, "sentence": self.sentence}

    def _decibels(self) -> str:
        if self.recolored:
            return "these colours were never trained: how good they are was not measured"
        if self.psnr is None:
            return "nothing like it was measured"
        about = "" if self.error is None else f" ± {self.error:.1f}"
        where = " at views like the stored ones" if self.seen_views else ""
        nearest = f"{self.neighbours} nearest measurements" if self.neighbours != 1 else "only measurement"
        return f"expected {self.psnr:.1f}{about} dB{where}, from the {nearest}"


@dataclass(frozen=True, eq=False, repr=False)
class Family:
    """What a lookup needs: places (R, P + V), and the PSNR (R,) there of members that training never saw."""

    places: NDArray[np.float64]
    psnr: NDArray[np.float64]
    error: float | None
    seen_views: bool


@dataclass(frozen=True, eq=False, repr=False)
class Expectation:
    """Measurements as a table to look up what is expected at any setting.

    Attributes
    ----------
    measured : of all families; empty where nothing could be measured.
    families : by `Place.family`.
    training : (N, P) training members' simulation parameters as fractions of their ranges.
    """

    measured: tuple[Measurement, ...]
    families: Mapping[str, Family]
    training: NDArray[np.float64]

    @classmethod
    def of(cls, measured: Sequence[Measurement], surrogate: Surrogate, members: Sequence[Member]) -> Expectation:
        """The expectation of these measurements; `members` are the catalog's."""
        tables = tables_of(measured, surrogate)
        gap = generalization_gap(tables[base_name(surrogate)]) if base_name(surrogate) in tables else None
        seen = {place_of(m.setting, surrogate).family for m in measured if m.seen_views}
        families = {
            name: Family(table.places, adjusted(table, gap), leave_one_out_error(table, gap), name in seen)
            for name, table in tables.items()
        }
        learnt = [m.parameters for m in members if m.split == "train"]
        return cls(tuple(measured), families, fractions_of(surrogate.space, learnt))

    @cached_property
    def training_spacing(self) -> float | None:
        """The median distance between a training member and its nearest neighbour; None for fewer than two."""
        if len(self.training) < 2:
            return None
        distances, _ = self._tree.query(self.training[spread(len(self.training), 1000)], k=2)  # [N, 2]
        return float(np.median(distances[:, 1]))

    def at(self, setting: Setting, surrogate: Surrogate) -> Expected:
        """What is expected of `surrogate`, the one that was measured, at `setting`: a lookup.

        Raises ValueError for parameters that are missing, unknown or not finite.
        """
        place = place_of(setting, surrogate)
        family = None if setting.color_map else self.families.get(place.family)
        distance = float(self._tree.query(place.values[: len(surrogate.space)])[0]) if len(self.training) else None
        found = Expected(distance, self.training_spacing, place.outside, recolored=bool(setting.color_map))
        if family is None:
            return found
        psnr, neighbours = predicted(family.places, family.psnr, place.values), min(NEAREST, len(family.psnr))
        return replace(found, psnr=psnr, error=family.error, neighbours=neighbours, seen_views=family.seen_views)

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.training)


@one_torch_thread()
def measure(run: Run, progress: Report = lambda *_: None) -> Expectation:
    """What to expect of a run, nothing without a catalog.  Takes some seconds unless it was measured before, see `measurements`."""
    return Expectation.of(measurements(run, progress), run.surrogate, run.members)
