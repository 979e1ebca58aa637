"""The effect of each parameter of scene ocean on the temperature: members at its bounds, the others in the middle.

    .venv-ocean/bin/python examples/ocean/differences.py [scenes/ocean.toml] [--days 20 60]

Prints the root mean square and the largest difference over the water, in °C, after the given days, and the distance of the
temperature from that at rest.  Minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.scene import Scene

sys.path.insert(0, str(Path(__file__).parent))
from simulation import simulate

PROJECT = Path(__file__).resolve().parents[2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, nargs="?", default=PROJECT / "scenes" / "ocean.toml")
    parser.add_argument("--days", type=float, nargs="+", default=[20.0, 60.0])
    arguments = parser.parse_args()
    scene = Scene.load(arguments.scene)
    settings, days = scene.source["settings"], sorted(arguments.days)
    known = [p for p in scene.space.parameters if p.name != "time"]
    middle = {p.name: (p.low + p.high) / 2 for p in known}

    def run(parameters: dict[str, float], times: list[float]) -> list[NDArray[np.float32]]:
        return [field.values for field in simulate(parameters, times, **settings)]

    print("| changed | day | rms, °C | largest, °C |")
    print("| --- | --- | --- | --- |")
    start, *later = run(middle, [0.0, *days])
    for day, found in zip(days, later, strict=True):
        print(f"| time, from 0 | {day:g} | {told(found, start)} |", flush=True)
    for parameter in known:
        low, high = (run({**middle, parameter.name: bound}, days) for bound in (parameter.low, parameter.high))
        for day, *pair in zip(days, low, high, strict=True):
            print(
                f"| {parameter.name}, {parameter.low:g} to {parameter.high:g} | {day:g} | {told(*pair)} |", flush=True
            )


def told(first: NDArray[np.float32], second: NDArray[np.float32]) -> str:
    difference = (second - first)[np.isfinite(first)]
    return f"{np.sqrt(np.mean(difference**2)):.2f} | {np.abs(difference).max():.1f}"


if __name__ == "__main__":
    main()
