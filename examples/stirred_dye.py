"""A hard ensemble: a blob of dye, stirred into thin sheets that fill a twentieth of the pixels and hardly overlap between members.

python examples/stirred_dye.py
surrogate train stirred_dye.cdb --hold-out 0.2
surrogate explore runs/stirred_dye
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

import insitu

SPACE = insitu.ParameterSpace((insitu.Parameter("strength", 0.2, 2.0), insitu.Parameter("time", 0.3, 2.8, "s")))
LOOK = insitu.VolumeRendering(
    "dvr",
    insitu.TransferFunction(
        color_points=((0.0, 0.1, 0.2, 0.7), (0.5, 0.2, 0.8, 0.6), (1.0, 0.9, 0.3, 0.1)),  # value, red, green, blue
        opacity_points=((0.05, 0.0), (0.3, 0.15), (1.0, 0.7)),
        opacity_unit_distance=0.5,
    ),
)
STEP = 0.05  # of time


def stirred(strength: float, dumps: Sequence[float], size: int) -> Iterator[tuple[float, NDArray[np.float32]]]:
    """The concentration (z, y, x) at some times; a blob in an Arnold-Beltrami-Childress flow of period 2π, semi-Lagrangian."""
    x = np.arange(size) * 2.0 * np.pi / size
    places = np.stack(np.meshgrid(x, x, x, indexing="ij"))  # z, y, x
    z, y, x = places
    velocity = strength * np.stack(
        [0.7 * np.sin(y) + 0.9 * np.cos(x), 0.9 * np.sin(x) + np.cos(z), np.sin(z) + 0.7 * np.cos(y)]
    )
    departures = (places - STEP * velocity) * size / (2.0 * np.pi)
    dye = np.exp(-2.0 * ((x - 2.0) ** 2 + (y - 3.0) ** 2 + (z - 3.0) ** 2))
    for step in range(1, round(max(dumps) / STEP) + 1):
        dye = map_coordinates(dye, departures, order=3, mode="grid-wrap")
        for time in dumps:
            if round(time / STEP) == step:
                yield time, np.clip(dye, 0.0, 1.0).astype(np.float32)


def main(catalog: Path, size: int = 48, views: insitu.ViewPlan | None = None) -> None:
    """Seven runs with five dumps each, whose times differ from run to run."""
    views = views or insitu.ViewPlan(width=256, height=256)
    spacing = (2.0 * np.pi / size,) * 3
    with insitu.Session(catalog, space=SPACE, appearances=LOOK, views=views) as session:
        for number, strength in enumerate(np.linspace(0.2, 2.0, 7)):
            dumps = (0.3 + 0.1 * (number % 3), 0.9, 1.5 + 0.1 * (number % 2), 2.1, 2.8)
            for time, dye in stirred(float(strength), dumps, size):
                print(session.render_member(dye, {"strength": strength}, time=time, spacing=spacing))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "stirred_dye.cdb"))
