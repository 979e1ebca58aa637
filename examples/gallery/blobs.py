"""The run that examples share: two blobs in a box, their pictures, and an emulator of their fields.

A script of yours makes it once, as `make_run` does; then the commands and `Run.open` take its folder.
"""

import io
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path

import numpy as np

import insitu
from catalogs import Camera
from surrogate.cli import main

CAMERA = Camera.look_at((2.5, -3.5, 2.0), (0, 0, 0), vertical_fov_degrees=28, width=128, height=128)
COLORS = ((0.1, 0.2, 0.3, 0.8), (0.6, 0.9, 0.8, 0.4), (1.2, 0.8, 0.1, 0.1))  # value, red, green, blue
OPACITIES = ((0.1, 0.0), (1.0, 0.9))
APPEARANCE = insitu.VolumeRendering("blobs", insitu.TransferFunction(COLORS, OPACITIES, opacity_unit_distance=0.3))
PLACE = {"spacing": (2 / 23,) * 3, "origin": (-1,) * 3}  # of the samples, x, y, z


def simulate(separation: float, width: float) -> np.ndarray:
    """A "simulation": two blobs along x in the box [-1, 1]³, on 24³ samples [z, y, x]."""
    z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 24)], indexing="ij")
    sides = (-separation / 2, separation / 2)
    return sum(np.exp(-((x - side) ** 2 + y**2 + z**2) / width**2) for side in sides)


def simulate_field(parameters: dict[str, float]) -> insitu.Field:
    """The same with its place, as ensembles call it in worker processes."""
    return insitu.Field(simulate(**parameters), **PLACE)


@cache
def make_run() -> Path:
    """The folder of the run: a catalog of 20 members, and what `surrogate train blobs.cdb --model field` makes of it."""
    folder = Path(tempfile.mkdtemp()) / "blobs"  # its name is the title of pages
    folder.mkdir()
    plan = {
        "space": {"separation": (0.6, 1.0), "width": (0.2, 0.4)},
        "appearances": APPEARANCE,
        "views": insitu.ViewPlan(frequency=1, width=64, height=64),
    }
    with insitu.Session(folder / "blobs.cdb", **plan) as session:
        for number in range(20):
            separation, width = 0.6 + 0.4 * (number + 0.5) / 20, 0.2 + 0.2 * (0.618 * number % 1)
            session.render_member(
                simulate(separation, width),
                {"separation": separation, "width": width},
                split="validation" if number % 4 == 2 else "train",
                **PLACE,
            )
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        main(
            ["train", str(folder / "blobs.cdb"), "--model", "field", "--steps", "1000", "-o", str(folder)],
            standalone_mode=False,
        )
    return folder
