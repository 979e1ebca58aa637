"""A complete ensemble, from the loop to the explorer: Gray-Scott patterns in 3D over feed rate, kill rate and time.

python examples/gray_scott.py
surrogate train gray_scott.cdb --hold-out 0.2
surrogate explore runs/gray_scott
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insitu

SPACE = insitu.ParameterSpace(
    (insitu.Parameter("F", 0.02, 0.045), insitu.Parameter("k", 0.055, 0.062), insitu.Parameter("time", 500.0, 1600.0))
)
LOOK = insitu.VolumeRendering(
    "dvr",
    insitu.TransferFunction(
        color_points=((0.05, 0.1, 0.3, 0.8), (0.2, 0.9, 0.85, 0.4), (0.4, 0.8, 0.1, 0.1)),  # value, red, green, blue
        opacity_points=((0.08, 0.0), (0.2, 0.35), (0.4, 0.8)),
        opacity_unit_distance=3.0,
    ),
)


def gray_scott(
    feed: float, kill: float, dumps: tuple[int, ...], size: int
) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """The concentration v (z, y, x) at some times; Pearson, Science 261 (1993), on a periodic grid with unit spacing."""
    u, v = np.ones((size,) * 3, np.float32), np.zeros((size,) * 3, np.float32)
    middle = tuple(slice(size // 2 - half, size // 2 + half) for half in (size // 13, size // 8, size // 8))
    u[middle], v[middle] = 0.5, 0.25

    def diffused(a: NDArray[np.float32]) -> NDArray[np.float32]:
        return sum(np.roll(a, shift, axis) for axis in range(3) for shift in (-1, 1)) - 6.0 * a

    for step in range(max(dumps) + 1):
        if step in dumps:
            yield step, v
        reaction = u * v * v
        u += 0.16 * diffused(u) - reaction + feed * (1.0 - u)
        v += 0.08 * diffused(v) + reaction - (feed + kill) * v


def main(catalog: Path, size: int = 40, views: insitu.ViewPlan | None = None) -> None:
    """Twelve runs with two dumps each, whose times differ from run to run."""
    views = views or insitu.ViewPlan(frequency=3, width=128, height=128)
    runs = [(feed, kill) for feed in (0.022, 0.03, 0.037, 0.043) for kill in (0.056, 0.0585, 0.061)]
    with insitu.Session(catalog, space=SPACE, appearances=LOOK, views=views, target_decibels=45.0) as session:
        for number, (feed, kill) in enumerate(runs):
            for time, v in gray_scott(feed, kill, (500 + 40 * number, 1200 + 30 * number), size):
                print(session.render_member(v, {"F": feed, "k": kill, "time": time}, spacing=(1.0, 1.0, 1.0)))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "gray_scott.cdb"))
