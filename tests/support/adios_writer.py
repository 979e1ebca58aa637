"""A simulation that writes with ADIOS2, in a process of its own:

    python -m tests.support.adios_writer NAME ENGINE STEPS SECONDS EVERY ATTRIBUTE Z Y X

Every step has `density` (z, y, x), random numbers drawn by the number of the step, and `time`, half that number.  The file says
`Re` and the spacing, and has a further ATTRIBUTE unless that is "-".  Where EVERY is above 1, steps 1, 1 + EVERY, ... alone have
`pressure`, ten times the density, the first has `mask`, and a number `nu`.
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
    name: Path,
    engine: str,
    steps: int,
    seconds: float = 0.0,
    shape: tuple[int, ...] = SHAPE,
    every: int = 1,
    attribute: str = "-",
) -> subprocess.Popen[bytes]:
    """Begin to write; the caller waits for it."""
    words = [str(name), engine, str(steps), str(seconds), str(every), attribute, *map(str, shape)]
    return subprocess.Popen([sys.executable, "-m", "tests.support.adios_writer", *words], cwd=PROJECT)


def write(name: Path, engine: str = "BP5", steps: int = 3, every: int = 1, attribute: str = "-") -> Path:
    assert start(name, engine, steps, every=every, attribute=attribute).wait() == 0
    return name


def main() -> None:
    sys.modules["torch"] = None  # type: ignore[assignment]  # which adios2 would load
    import adios2

    name, engine, steps, seconds, every, attribute, *counts = sys.argv[1:]
    shape = tuple(map(int, counts))
    io = adios2.Adios().declare_io("writer")
    io.set_engine(engine)
    with adios2.Stream(io, name, "w") as stream:
        for step, _ in enumerate(stream.steps(int(steps))):
            stream.write("density", density(step, shape), shape, [0, 0, 0], shape)
            stream.write("time", 0.5 * step)
            if int(every) > 1 and step % int(every) == 1:
                stream.write("pressure", 10 * density(step, shape), shape, [0, 0, 0], shape)
            if int(every) > 1 and step == 0:
                stream.write("mask", density(99, shape), shape, [0, 0, 0], shape)
                stream.write("nu", 0.25)
            if step == 0 and attribute != "-":
                stream.write_attribute(attribute, "1.1.0")
            if step == 0:
                stream.write_attribute("spacing", np.array(SPACING))
                stream.write_attribute("Re", np.array([1600.0]))
                stream.write_attribute("units", "kg/m3", "density")
                stream.write_attribute("words", "not a number")
            time.sleep(float(seconds))


if __name__ == "__main__":
    main()
