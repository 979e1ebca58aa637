"""A simulation that writes with ADIOS2, in a process of its own:

    python -m tests.support.adios_writer NAME ENGINE STEPS SECONDS Z Y X

Every step has `density` (z, y, x), random numbers drawn by the number of the step, and `time`, half that number; the file says
`Re` and the spacing.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

SHAPE = (4, 5, 6)
SPACING = (0.1, 0.2, 0.3)
PROJECT = Path(__file__).resolve().parents[2]


def density(step: int, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    return np.random.default_rng(step).random(shape, dtype=np.float32)


def start(
    name: Path, engine: str, steps: int, seconds: float = 0.0, shape: tuple[int, ...] = SHAPE
) -> subprocess.Popen[bytes]:
    """Begin to write; the caller waits for it."""
    words = [str(name), engine, str(steps), str(seconds), *map(str, shape)]
    return subprocess.Popen([sys.executable, "-m", "tests.support.adios_writer", *words], cwd=PROJECT)


def write(name: Path, engine: str = "BP5", steps: int = 3) -> Path:
    assert start(name, engine, steps).wait() == 0
    return name


def main() -> None:
    sys.modules["torch"] = None  # type: ignore[assignment]  # which adios2 would load
    import adios2

    name, engine, steps, seconds, *counts = sys.argv[1:]
    shape = tuple(map(int, counts))
    io = adios2.Adios().declare_io("writer")
    io.set_engine(engine)
    with adios2.Stream(io, name, "w") as stream:
        for step, _ in enumerate(stream.steps(int(steps))):
            stream.write("density", density(step, shape), shape, [0, 0, 0], shape)
            stream.write("time", 0.5 * step)
            if step == 0:
                stream.write_attribute("spacing", np.array(SPACING))
                stream.write_attribute("Re", np.array([1600.0]))
                stream.write_attribute("units", "kg/m3", "density")
                stream.write_attribute("words", "not a number")
            time.sleep(float(seconds))


if __name__ == "__main__":
    main()
