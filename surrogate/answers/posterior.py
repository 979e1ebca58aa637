"""Which parameters draw pictures: a posterior whose likelihood holds the surrogate's own error.

The error of a picture is the surrogate's, alike in neighbouring pixels, so pixels can't be counted as independent.  With c the
mean square of residuals the likelihood is exp(-c / (2 t)).  There is one factor t for each number of pictures: with it the
intervals hold the parameters of validation members.  Errors don't pull at all parameters alike: the interval of each grows as
much as these members need.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from surrogate.answers.inverse import Fit, Problem, best_fits
from surrogate.answers.inverse_calibration import InverseCalibration, calibration_of, numbers_calibrated
from surrogate.answers.number_targets import NumberResiduals, Wanted
from surrogate.answers.residuals import Residuals
from surrogate.answers.sampling import distinct, interval_ends, widened
from surrogate.answers.targets import Target, views_of
from surrogate.emulation.measures import Box
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

WIDE = 0.4  # of the range: an interval wider than that does not identify a parameter


@dataclass(frozen=True)
class ParameterAnswer:
    """One parameter of a picture: its best value, the 90 % interval, and whether the picture shows it.

    `width` is the interval's share of the range, on the parameter's scale.
    """

    name: str
    value: float
    low: float
    high: float
    width: float

    @property
    def identified(self) -> bool:
        """True where the interval is at most 40 % of the range wide."""
        return self.width <= WIDE

    @property
    def sentence(self) -> str:
        """All of it for a reader."""
        text = f"{self.name} = {self.value:.4g} ({self.low:.4g} to {self.high:.4g})"
        return text if self.identified else f"{text}: not shown"


@dataclass(frozen=True, eq=False)
class Inverse:
    """The parameters that draw pictures.

    Attributes
    ----------
    parameters : each with its interval, by the best solution and all that is as likely.
    solutions : distinct ones, best first, values by name.
    cameras : of each solution, one for each picture.
    residual_ratio : of the best solution's root mean square residual to the largest of validation members.
    sampled : True where the posterior was not normal, and samples by pictures gave the intervals.
    calibration : of the likelihood.
    normalized : the intervals' ends (P, 2), low and high, as normalized parameters.
    """

    parameters: tuple[ParameterAnswer, ...]
    solutions: tuple[Mapping[str, float], ...]
    cameras: tuple[tuple[Camera, ...], ...]
    residual_ratio: float
    sampled: bool
    calibration: InverseCalibration
    normalized: NDArray[np.float64]

    @property
    def foreign(self) -> bool:
        """True where no parameters draw such a picture: another field, function, or camera.

        Of right pictures, drawn like those of n validation members, one in n + 1 is flagged too.
        """
        return self.residual_ratio > 1.0

    @property
    def values(self) -> dict[str, float]:
        """The best solution by name, as `Surrogate.at` takes it."""
        return dict(self.solutions[0])

    @property
    def sentences(self) -> list[str]:
        """All of it for a reader."""
        said = [one.sentence for one in self.parameters]
        if len(self.solutions) > 1:
            said.append(f"{len(self.solutions)} distinct solutions draw such pictures; the intervals span them")
        if self.foreign:
            said.insert(
                0,
                f"No parameters draw such a picture: it is {self.residual_ratio:.2f} times as far off as pictures of "
                "validation members are at most. Another field, function or camera?"
                if self.cameras[0]
                else "No parameters give such numbers: they are farther off than the emulator errs",
            )
        return said

    def __repr__(self) -> str:
        return "<Inverse: " + "; ".join(self.sentences) + ">"

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes, `foreign`, and of each parameter `identified`."""
        each = [asdict(one) | {"identified": one.identified} for one in self.parameters]
        own = {"parameters": each, "solutions": [dict(one) for one in self.solutions], "foreign": self.foreign}
        return own | {
            "cameras": [[camera.to_json() for camera in views] for views in self.cameras],
            "residual_ratio": self.residual_ratio,
            "sampled": self.sampled,
            "calibration": asdict(self.calibration),
        }


def invert(surrogate: Surrogate, targets: Sequence[Target], catalog: Catalog, folder: Path | None = None) -> Inverse:
    """The simulation's parameters that draw the targets together, with intervals that validation members calibrate.

    A target without a camera is searched among the catalog's views, from which its camera is refined; it may stand up to about
    30 degrees away from these.  The calibration is measured the first time for each number of pictures, and kept in the run's
    `folder`.  Raises ValueError for no targets, and where fewer than four validation members calibrate.

    Examples
    --------
    >>> from blobs import make_run
    >>> from catalogs import Catalog
    >>> from surrogate import Surrogate, invert
    >>> from surrogate.answers.targets import stored_target
    >>> surrogate, catalog = Surrogate.load(make_run() / "surrogate"), Catalog.open(make_run() / "blobs.cdb")
    >>> answer = invert(surrogate, [stored_target(catalog, catalog.members[2].name, 4)], catalog)
    >>> truth = catalog.members[2].parameters["separation"]
    >>> answer.parameters[0].low < truth < answer.parameters[0].high
    True
    """
    if not targets:
        raise ValueError("invert takes at least one picture")
    residuals = Residuals.of(surrogate, targets, catalog.plan.background, views_of(catalog))
    return solved(residuals, calibration_of(surrogate, catalog, len(targets), folder))


def invert_numbers(
    surrogate: Surrogate,
    wanted: Sequence[Wanted],
    catalog: Catalog,
    *,
    field: str | None = None,
    box: Box | None = None,
) -> Inverse:
    """The simulation's parameters at which a field has the numbers that are wanted, in a `box` or everywhere.

    Validation members say how far off the emulator's numbers are.  By default it is the field that is drawn.  Raises ValueError
    for no numbers, an unknown field, and where fewer than four validation members keep it.

    Examples
    --------
    >>> from blobs import make_run
    >>> from catalogs import Catalog
    >>> from surrogate import Surrogate, invert_numbers
    >>> from surrogate.answers.number_targets import Wanted
    >>> surrogate, catalog = Surrogate.load(make_run() / "surrogate"), Catalog.open(make_run() / "blobs.cdb")
    >>> answer = invert_numbers(surrogate, [Wanted("mean", (0.04,)), Wanted("maximum", (1.0,))], catalog)
    >>> [parameter.name for parameter in answer.parameters if parameter.identified]
    ['width']
    """
    return solved(*numbers_calibrated(NumberResiduals.of(surrogate, wanted, field, box), catalog))


@one_torch_thread()
def solved(residuals: Problem, calibration: InverseCalibration) -> Inverse:
    """Like `invert`, by a calibration."""
    return answer_of(residuals, best_fits(residuals), calibration)


def answer_of(residuals: Problem, local: Sequence[Fit], calibration: InverseCalibration) -> Inverse:
    """The answer by local solutions, best first."""
    space, fits = residuals.surrogate.space, distinct(local, calibration.factor)
    ends, sampled = interval_ends(residuals, fits, calibration.factor)
    ends, answers = widened(ends, np.array(calibration.margins or (0.0,) * len(space))), []
    for parameter, best, (low, high) in zip(space.parameters, fits[0].point[: len(space)], ends.tolist(), strict=True):
        low_value, value, high_value = (parameter.at((x + 1.0) / 2.0) for x in (low, best, high))
        answers.append(ParameterAnswer(parameter.name, value, low_value, high_value, (high - low) / 2.0))
    points = np.stack([fit.point[: len(space)] for fit in fits])
    solutions = tuple(dict(zip(space.names, map(float, row), strict=True)) for row in space.denormalize(points))
    cameras = tuple(residuals.seen_from(dict(enumerate(fit.cameras))).seen_by(fit.point) for fit in fits)
    ratio = math.sqrt(fits[0].cost) / calibration.residual
    return Inverse(tuple(answers), solutions, cameras, ratio, sampled, calibration, ends)
