"""Which parameters draw a picture: a posterior whose likelihood holds the surrogate's own error.

The error of a picture is the surrogate's, alike in neighbouring pixels, so pixels can't be counted as independent.  With c the
mean square of residuals the likelihood is exp(-c / (2 t)).  There is one factor t for each number of pictures: with it the
intervals hold the parameters of validation members.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import truncnorm

from catalogs.store.catalog import Catalog
from catalogs.vocabulary import numbers
from surrogate.answers.doubt import key_of
from surrogate.answers.inverse import SCAN_SIDE, Fit, best_fits, residuals_of
from surrogate.answers.targets import Target, smallest, stored_target
from surrogate.answers.unseen import untested_views
from surrogate.emulation.validation import NORMAL, SHARE, conformal_rank
from surrogate.evaluation.scoring import spread
from surrogate.model import Surrogate
from surrogate.model.judged import judged
from surrogate.storage.records import Provenance, Record

FILE = Path("answers") / "inverse-{}.json"
RECORD, VERSION = "inverse", 1
WIDE = 0.4  # of the range: an interval wider than that does not identify a parameter
FOREIGN = 2.0  # times the largest residual of validation members
MOST, FEWEST = 8, 4  # validation members
SAMPLES, SWEEPS, CHECKED = 400, 40, 48
AGREE = 0.3  # the share of samples that count, below which the normal approximation is replaced by weighted samples
RIDGE = 1e-12

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InverseCalibration:
    """The factor of a likelihood, from members that nobody learnt from.

    Attributes
    ----------
    factor : the mean square of residuals that counts as one independent observation.
    residual : the largest root mean square of validation members' pictures at their solutions.
    members : that calibrated it.
    """

    factor: float
    residual: float
    members: int


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
        return text if self.identified else f"{text}: not shown by the pictures"


@dataclass(frozen=True)
class Inverse:
    """The parameters that draw pictures.

    Attributes
    ----------
    parameters : each with its interval, by the best solution and all that is as likely.
    solutions : distinct ones, best first, values by name.
    residual_ratio : of the best solution's root mean square residual to the largest of validation members.
    sampled : True where the posterior was not normal, and weighted samples gave the intervals.
    calibration : of the likelihood.
    """

    parameters: tuple[ParameterAnswer, ...]
    solutions: tuple[Mapping[str, float], ...]
    residual_ratio: float
    sampled: bool
    calibration: InverseCalibration

    @property
    def foreign(self) -> bool:
        """True where no parameters draw such a picture: another field, function, or camera."""
        return self.residual_ratio > FOREIGN

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
                f"No parameters draw such a picture: it is {self.residual_ratio:.1f} times as far off as pictures of "
                "validation members are at most. Another field, function or camera?",
            )
        return said

    def __repr__(self) -> str:
        return "<Inverse: " + "; ".join(self.sentences) + ">"

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes, `foreign`, and of each parameter `identified`."""
        each = [asdict(one) | {"identified": one.identified} for one in self.parameters]
        own = {"parameters": each, "solutions": [dict(one) for one in self.solutions], "foreign": self.foreign}
        return own | {
            "residual_ratio": self.residual_ratio,
            "sampled": self.sampled,
            "calibration": asdict(self.calibration),
        }


def invert(surrogate: Surrogate, targets: Sequence[Target], catalog: Catalog, folder: Path | None = None) -> Inverse:
    """The simulation's parameters that draw the targets together, with intervals that validation members calibrate.

    The calibration is measured the first time for each number of pictures, and kept in the run's `folder`.
    Raises ValueError for no targets, and where fewer than four validation members calibrate.
    """
    if not targets:
        raise ValueError("invert takes at least one picture")
    calibration = calibration_of(surrogate, catalog, len(targets), folder)
    return solved(surrogate, targets, catalog, calibration)


def solved(
    surrogate: Surrogate, targets: Sequence[Target], catalog: Catalog, calibration: InverseCalibration
) -> Inverse:
    """Like `invert`, by a calibration."""
    background, space = catalog.plan.background, surrogate.space
    fits = distinct(best_fits(surrogate, targets, background), calibration.factor)
    samples = np.concatenate([normal_samples(fit, calibration.factor, seed) for seed, fit in enumerate(fits)])
    weights = np.full(len(samples), 1.0 / len(samples))
    # Checked by pictures at some of the samples: weights are the likelihood over the normal approximation's.
    chosen = np.random.default_rng(0).choice(len(samples), CHECKED, replace=False)
    costs = (residuals_of(surrogate, smallest(targets, SCAN_SIDE), background)(samples[chosen]) ** 2).mean(1)
    away = samples[chosen][None] - np.stack([fit.point for fit in fits])[:, None]  # [K, C, P]
    expected = np.array([f.cost for f in fits])[:, None] + np.einsum(
        "kcp,kpq,kcq->kc", away, np.stack([f.curvature for f in fits]), away
    )
    log = -(costs - expected.min(0)) / (2.0 * calibration.factor)
    ratios = np.exp(log - log.max())
    sampled = bool(ratios.sum() ** 2 / (ratios**2).sum() < AGREE * CHECKED)
    if sampled:
        samples, weights = samples[chosen], ratios / ratios.sum()
    answers = []
    for j, parameter in enumerate(space.parameters):
        low, high = weighted_interval(samples[:, j], weights)
        low, high = min(low, fits[0].point[j]), max(high, fits[0].point[j])
        low_value, value, high_value = (parameter.at((x + 1.0) / 2.0) for x in (low, fits[0].point[j], high))
        answers.append(ParameterAnswer(parameter.name, value, low_value, high_value, float(high - low) / 2.0))
    solutions = tuple(dict(zip(space.names, map(float, space.denormalize(fit.point)), strict=True)) for fit in fits)
    ratio = math.sqrt(fits[0].cost) / calibration.residual
    return Inverse(tuple(answers), solutions, ratio, sampled, calibration)


def distinct(fits: Sequence[Fit], factor: float) -> list[Fit]:
    """Those that are about as likely as the best, and lie outside each other's 90 % sets."""
    from scipy.stats import chi2

    most = chi2.ppf(SHARE, len(fits[0].point))
    solutions: list[Fit] = []
    for fit in fits:
        apart = [(fit.point - one.point) @ one.curvature @ (fit.point - one.point) / factor for one in solutions]
        if (fit.cost - fits[0].cost) / factor < most and all(distance > most for distance in apart):
            solutions.append(fit)
    return solutions


def normal_samples(fit: Fit, factor: float, seed: int = 0) -> Array:
    """(S, P) of the normal distribution of a fit, cut to the bounds, by Gibbs sampling (Robert 1995)."""
    random, parameters = np.random.default_rng(seed), len(fit.point)
    precision = fit.curvature / factor + RIDGE * np.eye(parameters)
    samples = np.tile(fit.point, (SAMPLES, 1))
    for _ in range(SWEEPS):
        for j in range(parameters):
            others = np.delete(np.arange(parameters), j)
            pull = (samples[:, others] - fit.point[others]) @ precision[j, others] / precision[j, j]
            mean, deviation = fit.point[j] - pull, min(1.0 / math.sqrt(precision[j, j]), 100.0)
            bounds = (-1.0 - mean) / deviation, (1.0 - mean) / deviation
            values = truncnorm.rvs(*bounds, loc=mean, scale=deviation, size=SAMPLES, random_state=random)
            samples[:, j] = np.clip(values, -1.0, 1.0)
    return samples


def weighted_interval(values: Array, weights: Array) -> tuple[float, float]:
    """The interval that holds 90 % of weighted values, with as much below as above."""
    order = values.argsort()
    total = weights[order].cumsum()
    low, high = np.interp([(1.0 - SHARE) / 2.0, (1.0 + SHARE) / 2.0], total, values[order])
    return float(low), float(high)


def calibration_of(surrogate: Surrogate, catalog: Catalog, pictures: int, folder: Path | None) -> InverseCalibration:
    """The calibration for a number of pictures, as kept in the run's folder, else measured and kept there."""
    key, file = key_of(surrogate, catalog) | {"pictures": pictures}, Path(str(FILE).format(pictures))
    record = None if folder is None else Record.load(folder / file, RECORD, VERSION, key)
    if record is not None:
        with suppress(KeyError, TypeError, ValueError):
            values = {name: numbers.finite(record.values[name], name) for name in ("factor", "residual")}
            return InverseCalibration(**values, members=numbers.count(record.values["members"], "members"))
    started = time.process_time()
    measured = measure(surrogate, catalog, pictures)
    if folder is not None:
        with suppress(OSError):
            Record(RECORD, VERSION, key, asdict(measured), Provenance.now(time.process_time() - started)).save(
                folder / file
            )
    return measured


def measure(surrogate: Surrogate, catalog: Catalog, pictures: int) -> InverseCalibration:
    """The factor for which 90 % of validation members' parameters lie in their intervals."""
    unseen = [member for member in catalog.members if member.split == "validation"]
    if len(unseen) < FEWEST:
        raise ValueError(
            f"{catalog.path} has {len(unseen)} validation members, and at least {FEWEST} must calibrate intervals"
        )
    fair = judged(surrogate, catalog)
    needed, residuals = [], []
    for number in spread(len(unseen), MOST):
        member = unseen[number]
        views = untested_views(member)
        first = number % len(views)  # another view of each member
        chosen = [views[(first + step) % len(views)] for step in spread(len(views), pictures)]
        targets = [stored_target(catalog, member.name, view) for view in chosen]
        fit = best_fits(fair, targets, catalog.plan.background)[0]
        truth = fair.space.normalize(fair.space.values(member.parameters, outside="allow"))
        variances = np.diag(np.linalg.inv(fit.curvature + RIDGE * np.eye(len(truth))))
        needed += list((fit.point - truth) ** 2 / variances / NORMAL**2)
        residuals.append(math.sqrt(fit.cost))
    factor = float(np.sort(needed)[conformal_rank(len(needed)) - 1])
    return InverseCalibration(factor, max(residuals), len(residuals))
