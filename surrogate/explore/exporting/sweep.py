"""Pictures over one parameter, or two: what strips, grids and films are made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import text
from catalogs.vocabulary.parameters import Parameter
from surrogate.explore.request import within
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting, listed
from surrogate.model import Surrogate

LEAST_STEPS, MOST_STEPS = 2, 200
MOST_PICTURES = 400
MOST_PIXELS = 128 * 1024 * 1024  # of all pictures together: films keep theirs in memory, 3 bytes each
LEAST_DIGITS, MOST_DIGITS = 4, 17


@dataclass(frozen=True)
class Axis:
    """`count` values of one parameter from `low` to `high`, both among them, in its unit.

    They lie at equal distances, of their logarithms where the scale is that.

    Attributes
    ----------
    name : of a simulation parameter, or of a visualization parameter such as `isovalue` or `c1_value`.
    low, high : finite, low < high.
    count : 2 to 200.
    unit : of the values; "" for none.
    scale : "linear" or "log".
    origin : what labels add to a value: for a displacement, so that they give the place.
    """

    name: str
    low: float
    high: float
    count: int
    unit: str = ""
    scale: str = "linear"
    origin: float = 0.0

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError(f"a sweep goes over a parameter that is a number, got {self.name!r}: name another one")
        if not -math.inf < self.low < self.high < math.inf:
            raise ValueError(
                f"a sweep over {self.name} goes from a finite value to a larger one, got {text(self.low)} to {text(self.high)}"
            )
        if not LEAST_STEPS <= self.count <= MOST_STEPS:
            raise ValueError(
                f"a sweep over {self.name} has {LEAST_STEPS} to {MOST_STEPS} steps, got {self.count}: choose fewer or more"
            )

    def __str__(self) -> str:
        return f"{self.name} {text(self.low + self.origin)}..{text(self.high + self.origin)}"

    @property
    def values(self) -> list[float]:
        """All of them, in order."""
        places = np.geomspace if self.scale == "log" else np.linspace
        return places(self.low, self.high, self.count).tolist()

    @property
    def labels(self) -> list[str]:
        """Such as "Re = 1500", in as many digits as it takes to round values by less than a hundredth of their distance."""
        values = [value + self.origin for value in self.values]
        step = min(later - value for value, later in pairwise(values))
        for digits in range(LEAST_DIGITS, MOST_DIGITS + 1):
            texts = [f"{value:.{digits}g}" for value in values]
            if all(abs(float(text) - value) <= 0.01 * step for text, value in zip(texts, values, strict=True)):
                break
        return [f"{self.name} = {text} {self.unit}".rstrip() for text in texts]


@dataclass(frozen=True)
class Sweep:
    """A base setting of which one parameter is varied, or two.

    Attributes
    ----------
    base : all other values.
    columns : the parameter that varies from picture to picture.
    rows : a second one, which varies from row to row of a grid; None for a single row.
    """

    base: Setting
    columns: Axis
    rows: Axis | None = None

    def __post_init__(self) -> None:
        if self.rows is not None and self.rows.name == self.columns.name:
            raise ValueError(f"a grid varies two different parameters, got {self.rows.name} twice")
        if len(self) > MOST_PICTURES:
            raise ValueError(f"a sweep has at most {MOST_PICTURES} pictures, got {len(self)}: choose fewer steps")

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Those that there are: the rows, which vary slowest, before the columns."""
        return (self.columns,) if self.rows is None else (self.rows, self.columns)

    def at(self, values: Sequence[float]) -> Setting:
        """The setting where the `axes` have these values."""
        parameters, visualization = dict(self.base.parameters), dict(self.base.visualization)
        for axis, value in zip(self.axes, values, strict=True):
            (parameters if axis.name in parameters else visualization)[axis.name] = value
        return replace(self.base, parameters=parameters, visualization=visualization)

    def __len__(self) -> int:
        return math.prod(axis.count for axis in self.axes)

    def __str__(self) -> str:
        return self.described()

    def described(self, origins: Mapping[str, float] | None = None) -> str:
        """In a line; control points are given by their places, see `Run.origins`."""
        over = " and ".join(str(axis) for axis in reversed(self.axes))
        rest = self.base.shown_as(listed(self.fixed, origins))
        return f"{len(self)} pictures over {over}" + (f", {rest}" if rest else "")

    @property
    def fixed(self) -> dict[str, float | str]:
        """All values of the base that don't vary."""
        varied = [axis.name for axis in self.axes]
        return {name: value for name, value in self.base.values.items() if name not in varied}


def settings(sweep: Sweep) -> list[Setting]:
    """The setting of each image, row by row."""
    return [sweep.at(values) for values in product(*(axis.values for axis in sweep.axes))]


def check(sweep: Sweep, surrogate: Surrogate) -> None:
    """Raise ValueError saying what is wrong where the surrogate can't show the whole sweep.

    Its corners are tried: what is possible there, such as control points that don't cross, is possible between them.
    """
    for corner in product(*((axis.low, axis.high) for axis in sweep.axes)):
        try:
            sweep.at(corner).member(surrogate)
        except ValueError as error:
            places = [
                f"{axis.name} = {text(value + axis.origin)}" for axis, value in zip(sweep.axes, corner, strict=True)
            ]
            raise ValueError(f"the sweep can't be shown at {', '.join(reversed(places))}: {error}") from error


def pictures(
    sweep: Sweep,
    surrogate: Surrogate,
    camera: Camera,
    background: Sequence[float],
    *,
    progress: Callable[[int, int], Any] = lambda done, total: None,
) -> Iterator[NDArray[np.float32]]:
    """The pictures, opaque on `background`, (H, W, 3) each, row by row; each is drawn when it is asked for.

    `progress` is called with how many of how many are drawn; an error that it raises ends the sweep, as closing the iterator does.
     Raises ValueError at once where the surrogate can't show the sweep, or the pictures are too large.
    """
    if len(sweep) * camera.width * camera.height > MOST_PIXELS:
        raise ValueError(
            f"{len(sweep)} pictures of {camera.width}x{camera.height} are more than {MOST_PIXELS:,} pixels: "
            "choose fewer steps or smaller pictures"
        )
    check(sweep, surrogate)
    all_settings = settings(sweep)

    def images() -> Iterator[NDArray[np.float32]]:
        for done, setting in enumerate(all_settings, start=1):
            picture = setting.member(surrogate).render(camera, background=background)[..., :3]
            progress(done, len(all_settings))
            yield picture

    return images()


def parameters_of(surrogate: Surrogate) -> dict[str, Parameter]:
    """The simulation and visualization parameters that are numbers, with their bounds and units, by name."""
    spaces = [surrogate.space, *(v.space for v in surrogate.variations if v.continuous)]
    return {p.name: p for space in reversed(spaces) for p in space.parameters}


def axis_of(run: Run, name: str, count: int, low: Any = None, high: Any = None) -> Axis:
    """The axis over a parameter's whole bounds, or from `low` to `high`, which for control points are displacements.

    Raises ValueError for unknown names, and for ends that are not numbers or too far out of bounds.
    """
    parameters = parameters_of(run.surrogate)
    if name not in parameters:
        raise ValueError(f"unknown parameter {name!r}: this surrogate has {', '.join(sorted(parameters)) or 'none'}")
    of, origin = parameters[name], run.origins.get(name, 0.0)
    first, last = (p if end is None else within(end, of, origin) for end, p in ((low, of.low), (high, of.high)))
    return Axis(name, first, last, count, of.unit, of.scale, origin)
