"""Pictures over one parameter, or two: what strips, grids and films are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.cameras import Camera
from catalogs.parameters import Parameter
from catalogs.variations import APPEARANCE
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate

LEAST_STEPS, MOST_STEPS = 2, 200
MOST_PICTURES = 400
MOST_PIXELS = 128 * 1024 * 1024  # of all pictures together: films keep theirs in memory, 3 bytes each
LEAST_DIGITS, MOST_DIGITS = 4, 17


@dataclass(frozen=True)
class Axis:
    """`count` values of one parameter at equal distances from `low` to `high`, both among them, in its unit.

    Attributes
    ----------
    name : of a simulation parameter, or of a visualization parameter such as `isovalue` or `c1_value`.
    low, high : finite, low < high.
    count : 2 to 200.
    """

    name: str
    low: float
    high: float
    count: int

    def __post_init__(self) -> None:
        if self.name == APPEARANCE or not self.name:
            raise ValueError(f"a sweep goes over a parameter that is a number, got {self.name!r}: name another one")
        if not np.isfinite([self.low, self.high]).all() or not self.low < self.high:
            raise ValueError(
                f"a sweep over {self.name} goes from a finite value to a larger one, got {self.low:g} to {self.high:g}"
            )
        if not LEAST_STEPS <= self.count <= MOST_STEPS:
            raise ValueError(
                f"a sweep over {self.name} has {LEAST_STEPS} to {MOST_STEPS} steps, got {self.count}: choose fewer or more"
            )

    @property
    def values(self) -> list[float]:
        """All of them, in order."""
        return [float(value) for value in np.linspace(self.low, self.high, self.count)]

    def labels(self, unit: str = "") -> list[str]:
        """Such as "Re = 1500", in as many digits as it takes to round values by less than a hundredth of their distance."""
        values, step = self.values, (self.high - self.low) / (self.count - 1)
        for digits in range(LEAST_DIGITS, MOST_DIGITS + 1):
            texts = [f"{value:.{digits}g}" for value in values]
            if all(abs(float(text) - value) <= 0.01 * step for text, value in zip(texts, values, strict=True)):
                break
        return [f"{self.name} = {text} {unit}".rstrip() for text in texts]


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

    def __len__(self) -> int:
        return self.columns.count * (1 if self.rows is None else self.rows.count)


def settings(sweep: Sweep) -> list[Setting]:
    """What each picture shows, row by row."""
    across, down = sweep.columns.values, [] if sweep.rows is None else sweep.rows.values
    return [_placed(sweep, *values) for values in (product(down, across) if down else ((None, v) for v in across))]


def check(sweep: Sweep, surrogate: Surrogate) -> None:
    """Raise ValueError saying what is wrong where the surrogate can't show the whole sweep.

    Its corners are tried: what is possible there, such as control points that don't cross, is possible between them.
    """
    down = (None,) if sweep.rows is None else (sweep.rows.low, sweep.rows.high)
    for row, column in product(down, (sweep.columns.low, sweep.columns.high)):
        try:
            _placed(sweep, row, column).gaussians(surrogate)
        except ValueError as error:
            at = f"{sweep.columns.name} = {column:g}"
            at += "" if sweep.rows is None or row is None else f", {sweep.rows.name} = {row:g}"
            raise ValueError(f"the sweep can't be shown at {at}: {error}") from error


def pictures(
    sweep: Sweep,
    surrogate: Surrogate,
    camera: Camera,
    background: Sequence[float],
    *,
    progress: Callable[[int, int], Any] | None = None,
) -> Iterator[NDArray[np.float32]]:
    """The pictures, opaque on `background`, (H, W, 3) each, row by row; each is drawn when it is asked for.

    `progress` is told how many of how many are drawn.  What it raises ends the sweep, which keeps nothing; so does closing the
    iterator.  Raises ValueError at once where the surrogate can't show the sweep, or the pictures are too large.
    """
    if len(sweep) * camera.width * camera.height > MOST_PIXELS:
        raise ValueError(
            f"{len(sweep)} pictures of {camera.width}x{camera.height} are more than {MOST_PIXELS:,} pixels: "
            "choose fewer steps or smaller pictures"
        )
    check(sweep, surrogate)
    return _drawn(settings(sweep), surrogate, camera, background, progress or (lambda done, total: None))


def parameter(surrogate: Surrogate, name: str) -> Parameter:
    """The simulation or visualization parameter of that name, with its bounds and unit; raises ValueError for no such number."""
    spaces = [surrogate.space, *(v.variation.space for v in surrogate.visualizations if v.variation.kind != "field")]
    known = {p.name: p for space in reversed(spaces) for p in space.parameters}
    if name not in known:
        raise ValueError(f"this surrogate has the parameters {sorted(known)}, got {name!r}")
    return known[name]


def _drawn(
    shown: Sequence[Setting],
    surrogate: Surrogate,
    camera: Camera,
    background: Sequence[float],
    progress: Callable[[int, int], Any],
) -> Iterator[NDArray[np.float32]]:
    for done, setting in enumerate(shown, start=1):
        picture = setting.gaussians(surrogate).render(camera, background=background)[..., :3]
        progress(done, len(shown))
        yield picture


def _placed(sweep: Sweep, row: float | None, column: float) -> Setting:
    placed = _with(sweep.base, sweep.columns.name, column)
    return placed if sweep.rows is None or row is None else _with(placed, sweep.rows.name, row)


def _with(setting: Setting, name: str, value: float) -> Setting:
    if name in setting.parameters:
        return replace(setting, parameters={**setting.parameters, name: value})
    return replace(setting, visualization={**setting.visualization, name: value})
