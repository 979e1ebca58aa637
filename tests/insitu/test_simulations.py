"""The register of bundled simulations."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from insitu.simulations import simulation


def test_a_simulation_says_its_name_and_parameters():
    found = simulation("taylor_green")
    assert (found.name, found.parameters) == ("taylor_green", ("Re",))


def test_an_unknown_simulation_names_the_known():
    with pytest.raises(ValueError, match=r"no simulation 'tailor_green'; bundled are: .*taylor_green"):
        simulation("tailor_green")


def test_the_register_loads_no_numerics():
    script = "import sys, insitu.simulations; sys.exit('numpy' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], cwd=Path(__file__).parents[2]).returncode == 0
