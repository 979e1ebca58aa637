"""A survey of the doubt all over the parameters, for pages that can't ask: expected PSNR at any place, in microseconds.

The doubt is asked at points that fill the box.  Between them its expectation follows how much the runs leave open there, which
is known everywhere, and a Gaussian process through what that leaves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary import numbers
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.answers import unseen
from surrogate.answers.doubt import SLACK, Doubt, key_of
from surrogate.answers.opinions import ProcessOpinions
from surrogate.emulation.processes import Processes
from surrogate.emulation.validation import SHARE
from surrogate.evaluation.scoring import Report
from surrogate.model.representation import FIELD, VIEW
from surrogate.randomness import sobol_points
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.records import Record

Array = NDArray[np.float64]

FILE = Path("answers") / "survey.json"
RECORD, VERSION = "survey", 2  # 1 had other points
POINTS = 128
LEAST_OPEN = 1e-9  # whose logarithm is still looked at
NAMES = ("points", "lengths", "noises")
SAME = 1e-6  # dB
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Expectation:
    """The PSNR to expect of one representation's pictures: by the logarithms of what runs leave open, and a rest.

    Attributes
    ----------
    constant, slopes : dB, and (S,) dB a unit of the logarithm of each of the survey's shares.
    rest : one process, dB.
    half : `share` of such pictures lie within that of the expectation, dB.
    source : the members that calibrated the doubt, in words.
    """

    constant: float
    slopes: Array
    rest: Processes
    half: float
    share: float
    source: str

    __repr__ = one_line

    @classmethod
    def of(cls, points: Array, shares: Array, expected: Array, half: float, share: float, source: str) -> Expectation:
        """Through what the doubt `expected` (N,) at `points` (N, P), where the runs leave `shares` (N, S) open.

        `half` is that of the doubt, which grows by how far such an expectation is off where it was not asked.
        """
        columns = np.column_stack([np.ones(len(points)), np.log(shares)])  # [N, 1 + S]
        slopes = np.linalg.lstsq(columns, expected, rcond=None)[0]
        rest = expected - columns @ slopes
        process = _process_through(points, rest - rest.mean())
        off = float(np.quantile(np.abs(process.left_out()), SHARE))
        return cls(float(slopes[0] + rest.mean()), slopes[1:], process, math.hypot(half, off), share, source)

    def at(self, point: Array, shares: Array) -> float:
        """The PSNR (dB) to expect at a point (P,), where the runs leave `shares` (S,) open."""
        return float(self.constant + self.slopes @ np.log(shares) + self.rest.means(point[None])[0, 0])

    def to_json(self) -> dict[str, Any]:
        """JSON values, by attribute."""
        rest = {name: getattr(self.rest, name).tolist() for name in (*NAMES, "coefficients", "groups")}
        numbers = {"constant": self.constant, "slopes": self.slopes.tolist(), "half": self.half, "share": self.share}
        return numbers | {"rest": rest, "source": self.source}

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> Expectation:
        """The one of which `to_json` gave this; raises ValueError, KeyError or TypeError for damage."""
        constant, half, share = (numbers.finite(record[name], name) for name in ("constant", "half", "share"))
        slopes = np.array([numbers.finite(slope, "slopes") for slope in record["slopes"]])
        arrays = {name: np.array(values) for name, values in record["rest"].items()}
        return cls(constant, slopes, Processes(**arrays), half, share, str(record["source"]))


@dataclass(frozen=True, eq=False)
class Survey:
    """Expectations of pictures in the trained appearance, by representation.

    Attributes
    ----------
    opens : the processes by whose variance the runs leave things open; the first are those of the doubt's words.
    like, between : shares up to which a place is like a run, and between runs.
    expectations : by representation.
    """

    opens: tuple[ProcessOpinions, ...]
    like: float
    between: float
    expectations: dict[str, Expectation]

    __repr__ = one_line

    @classmethod
    def of(
        cls,
        doubt: Doubt,
        catalog: Catalog,
        cameras: Sequence[Camera],
        folder: Path | None = None,
        progress: Report = lambda *_: None,
    ) -> Survey:
        """The survey of a doubt, as kept in a run's `folder`; else made now, in seconds, and kept there."""
        opens = _opens(doubt)
        own, most = opens[0].usual_shares
        key = {**key_of(doubt.surrogate, catalog), "points": POINTS}
        record = None if folder is None else Record.load(folder / FILE, RECORD, VERSION, key)
        if record is not None:
            try:
                each = {name: Expectation.from_json(one) for name, one in record.values["expectations"].items()}
                return cls(opens, own * SLACK, most, each)
            except (KeyError, TypeError, ValueError, AttributeError):
                pass  # it is damaged, and made anew
        began, each = time.process_time(), _expectations(doubt, opens, cameras, progress)
        values = {"expectations": {name: one.to_json() for name, one in each.items()}}
        Record.keep(folder and folder / FILE, RECORD, VERSION, key, values, began)
        return cls(opens, own * SLACK, most, each)

    def expected(self, point: Array, using: str) -> float:
        """The PSNR (dB) to expect at a normalized point (P,); raises KeyError for what nobody calibrated."""
        return self.expectations[using].at(point, _shares(self.opens, point))

    def to_json(self) -> dict[str, Any]:
        """All that a page needs to say the same."""
        opens = [_json_of(one.processes) for one in self.opens]
        each = {name: one.to_json() for name, one in self.expectations.items()}
        whole = {"opens": opens, "like": self.like, "between": self.between, "expectations": each}
        short: dict[str, Any] = _shortened(whole)
        return short


def _process_through(points: Array, values: Array) -> Processes:
    """One process through `values` (N,) at `points` (N, P); of values that are all the same, one that says so."""
    if np.abs(values).max() > SAME:
        return Processes.fit(points, values[:, None])
    one, noise = np.ones((1, points.shape[1])), np.ones(1)
    return Processes(points, np.zeros((len(points), 1)), one, noise, np.zeros(1, np.int64))


def _opens(doubt: Doubt) -> tuple[ProcessOpinions, ...]:
    both = (doubt.processes, None if doubt.embeddings is None else doubt.embeddings.opinions)
    return tuple(dict.fromkeys(one for one in both if one is not None))


def _shares(opens: Sequence[ProcessOpinions], point: Array) -> Array:
    """The shares (S,) that the runs leave open at a point (P,)."""
    return np.array([max(one.open_share(point), LEAST_OPEN) for one in opens])


@one_torch_thread()
def _expectations(
    doubt: Doubt, opens: Sequence[ProcessOpinions], cameras: Sequence[Camera], progress: Report
) -> dict[str, Expectation]:
    """Of all representations that are calibrated."""
    space, (camera, *_) = doubt.surrogate.space, cameras
    points = sobol_points(POINTS, len(space))  # [N, P]
    calibrated = [one for one in doubt.surrogate.representations if f"{VIEW} {one}" in doubt.calibrations]
    expected: dict[str, list[float]] = {one: [] for one in calibrated}
    for number, point in enumerate(points):
        parameters = dict(zip(space.names, space.denormalize(point).tolist(), strict=True))
        agreements: dict[bool, float] = {}  # whether by the emulated field alone
        for using in calibrated:
            member = doubt.at(parameters, using=using)
            assert member.calibration is not None
            alone = using == FIELD
            if alone not in agreements:
                agreements[alone] = unseen.agreement_of(member.opinions, camera, doubt.background)
            expected[using].append(float(member.calibration.line.expected(agreements[alone], member.point)))
        progress("what to expect all over", number + 1, POINTS)
    shares = np.array([_shares(opens, point) for point in points])
    each = {}
    for using in calibrated:
        one = doubt.calibrations[f"{VIEW} {using}"]
        source = f"{one.members} {'left-out' if using == FIELD else 'validation'} members"
        each[using] = Expectation.of(points, shares, np.array(expected[using]), one.half, one.share, source)
    return each


def _json_of(processes: Processes) -> dict[str, Any]:
    """The groups of processes, with the shares (G,) of the variance that is theirs."""
    whole = max(float(processes.variances.sum()), TINY)
    shares = [float(processes.variances[processes.groups == g].sum()) / whole for g in range(len(processes.noises))]
    return {name: getattr(processes, name).tolist() for name in NAMES} | {"variances": shares}


def _shortened(value: Any) -> Any:
    """JSON values whose numbers have seven digits, about as many as float32 holds."""
    if isinstance(value, float):
        return float(f"{value:.7g}")
    if isinstance(value, dict):
        return {name: _shortened(one) for name, one in value.items()}
    return [_shortened(one) for one in value] if isinstance(value, list) else value
