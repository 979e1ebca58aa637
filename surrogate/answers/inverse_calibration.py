"""The factor of the likelihood of parameters, from members that nobody learnt from."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.vocabulary import numbers
from surrogate.answers.doubt import key_of
from surrogate.answers.inverse import Fit, best_fits
from surrogate.answers.number_targets import NumberResiduals, with_errors
from surrogate.answers.residuals import Residuals
from surrogate.answers.sampling import RIDGE, distinct, interval_ends, margins_of
from surrogate.answers.targets import Target, stored_target
from surrogate.answers.unseen import untested_views
from surrogate.emulation.validation import NORMAL, conformal_rank
from surrogate.evaluation.scoring import spread
from surrogate.model import Surrogate
from surrogate.model.judged import judged
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.records import Record

FILE = Path("answers") / "inverse-{}.json"
RECORD, VERSION = "inverse", 3
MOST, FEWEST = 8, 4  # validation members
MORE = 'train on 50 or more members, of which 8 % validate, or render some with split="validation"'

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InverseCalibration:
    """The factor of a likelihood.

    Attributes
    ----------
    factor : the mean square of residuals that counts as one independent observation.
    residual : the largest root mean square of validation members' pictures at their solutions.
    members : that calibrated it.
    margins : by which the interval of each parameter grows to either side, as shares of its width; none for all zero.
    """

    factor: float
    residual: float
    members: int
    margins: tuple[float, ...] = ()

    @classmethod
    def of(cls, fits: Sequence[Fit], truths: Sequence[Array]) -> InverseCalibration:
        """By the best fits to members, and these' normalized parameters (P,): 90 % of all lie in their intervals."""
        needed: list[float] = []
        for fit, truth in zip(fits, truths, strict=True):
            variances = np.diag(np.linalg.inv(fit.curvature + RIDGE * np.eye(len(truth))))
            needed += list((fit.point - truth) ** 2 / variances / NORMAL**2)
        factor = float(np.sort(needed)[conformal_rank(len(needed)) - 1])
        return cls(factor, max(math.sqrt(fit.cost) for fit in fits), len(fits))


def calibration_of(surrogate: Surrogate, catalog: Catalog, pictures: int, folder: Path | None) -> InverseCalibration:
    """The calibration for a number of pictures, as kept in the run's folder, else measured and kept there."""
    key, path = key_of(surrogate, catalog) | {"pictures": pictures}, folder and folder / str(FILE).format(pictures)
    record = None if path is None else Record.load(path, RECORD, VERSION, key)
    if record is not None:
        with suppress(KeyError, TypeError, ValueError):
            values = {name: numbers.finite(record.values[name], name) for name in ("factor", "residual")}
            margins = tuple(numbers.finite(value, "margins") for value in record.values["margins"])
            if len(margins) == len(surrogate.space):
                return InverseCalibration(
                    **values, members=numbers.count(record.values["members"], "members"), margins=margins
                )
    began = time.process_time()
    measured = measure(surrogate, catalog, pictures)
    Record.keep(path, RECORD, VERSION, key, asdict(measured), began)
    return measured


@one_torch_thread()
def measure(surrogate: Surrogate, catalog: Catalog, pictures: int) -> InverseCalibration:
    """By up to eight validation members; raises ValueError for fewer than four."""
    unseen = [member for member in catalog.members if member.split == "validation"]
    if len(unseen) < FEWEST:
        raise ValueError(
            f"{catalog.path} has {len(unseen)} validation members, and at least {FEWEST} must calibrate intervals: "
            f"{MORE}"
        )
    fair, read, truths = judged(surrogate, catalog), [], []
    for number in spread(len(unseen), MOST):
        targets = targets_for(catalog, unseen[number], untested_views(unseen[number]), pictures, number)
        residuals = Residuals.of(fair, targets, catalog.plan.background)
        read.append((residuals, best_fits(residuals)))
        truths.append(fair.space.normalize(fair.space.values(unseen[number].parameters, outside="allow")))
    own = InverseCalibration.of([fits[0] for _, fits in read], truths)
    ends = [interval_ends(residuals, distinct(fits, own.factor), own.factor)[0] for residuals, fits in read]
    return replace(own, margins=tuple(map(float, margins_of(np.stack(ends), np.stack(truths)))))


def numbers_calibrated(residuals: NumberResiduals, catalog: Catalog) -> tuple[NumberResiduals, InverseCalibration]:
    """(residuals by the errors at validation members, the calibration by these); raises ValueError for fewer than four."""
    judges = sum(m.split == "validation" and residuals.field in m.coarse_fields() for m in catalog.members)
    if judges < FEWEST:
        raise ValueError(
            f"{catalog.path} keeps the field of {judges} validation members, and at least {FEWEST} must calibrate intervals: "
            f"{MORE}"
        )
    fair, each, truths = with_errors(residuals.learning(catalog), catalog, "validation")
    some = spread(len(each), MOST)
    own = InverseCalibration.of([best_fits(each[i])[0] for i in some], [truths[i] for i in some])
    # Errors are known: one observation counts as much as its error, and a solution may be as far off.
    factor, residual = max(own.factor, 1.0 / len(residuals.values)), max(own.residual, 1.0)
    return replace(residuals, errors=fair.errors), InverseCalibration(factor, residual, own.members)


def targets_for(catalog: Catalog, member: Member, views: Sequence[int], pictures: int, number: int) -> list[Target]:
    """A member's pictures in as many of some views, spread, which begin elsewhere for each `number` of a member."""
    first = number % len(views)
    chosen = [views[(first + step) % len(views)] for step in spread(len(views), pictures)]
    return [stored_target(catalog, member.name, view) for view in chosen]
