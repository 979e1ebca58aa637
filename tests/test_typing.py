"""Types as a user's checker sees them: `mypy --strict` over a program of his own, with the project installed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.installed import environment

PROGRAM = """
import numpy as np

import insitu
from catalogs import Camera, Catalog, orbit
from insitu import Session, TransferFunction, ViewPlan, VolumeRendering
from render import to_grid
from native import kernels
from surrogate import Surrogate

FUNCTION = TransferFunction(((0.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.2, 0.1)), ((0.0, 0.0), (1.0, 0.4)), 0.1)


def simulate(reynolds: float) -> Catalog:
    field = np.full((24, 24, 24), reynolds, dtype=np.float32)
    reveal_type(to_grid(field, spacing=(0.1, 0.1, 0.1)))  # render.grids.Grid
    volume = VolumeRendering("volume", FUNCTION)
    with Session("flow.cdb", space={"Re": (200, 1600)}, appearances=[volume], views=ViewPlan()) as session:
        reveal_type(session.render_member(field, {"Re": reynolds}, spacing=(0.1, 0.1, 0.1)))  # insitu.members.result.RenderedMember
    reveal_type(insitu.render_member(field, {"Re": 2.0 * reynolds}, catalog="flow.cdb"))  # insitu.members.result.RenderedMember
    return Catalog.open("flow.cdb")


def explore(catalog: Catalog, camera: Camera) -> None:
    reveal_type(catalog.members[0].parameters)  # Mapping[str, float]
    surrogate = Surrogate.load("runs/flow/surrogate")
    reveal_type(surrogate.at(Re=830.0))  # surrogate.model.deformed.DeformedGaussians
    reveal_type(surrogate.at(Re=830.0).render(camera))  # numpy.ndarray[
    five = [np.ones((2, columns), dtype=np.float32) for columns in (3, 3, 4, 1, 3)]
    size, constants = (camera.width, camera.height), [0.01, 0.3, 1 / 255, 0.99, 1e-4, 1.3, 1e-12]
    drawing = kernels.forward(five, camera.world_to_camera, (9.0, 9.0, 8.0, 8.0), size, constants, threads=1)
    reveal_type(kernels.backward(drawing, drawing.picture, threads=1))  # list[numpy.ndarray[


explore(simulate(400.0), orbit((0.0, 0.0, 0.0), 1.0, width=64, height=64)[0])
"""

# Reading torch, xarray and other libraries takes most of the time, and no type of the program comes from them.
OURS_AND_NUMPY = """
[mypy]
follow_imports = skip
[mypy-catalogs.*,insitu.*,native.*,numpy.*,render.*,surrogate.*]
follow_imports = normal
"""


@pytest.mark.slow(seconds=10)
def test_a_strict_program_has_no_error_and_its_results_have_types(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "mypy.ini").write_text(OURS_AND_NUMPY)
    command = [sys.executable, "-m", "mypy", "--strict", "--python-executable", str(installed / "python"), "program.py"]
    checked = subprocess.run(command, cwd=tmp_path, env=environment(installed), capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    revealed = re.findall('Revealed type is "(.*)"', checked.stdout)
    expected = re.findall("# (.*)", PROGRAM)
    assert len(revealed) == len(expected)
    assert [kind for kind, part in zip(revealed, expected, strict=True) if part not in kind] == []
