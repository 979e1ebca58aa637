"""A program with floating-point traps renders as any other, and has them afterwards."""

from __future__ import annotations

import ctypes
import math
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from insitu.hook.traps import no_traps
from tests.support.embedded import run

INVALID_ZERO_OVERFLOW = 1 | 4 | 8  # on x86

PROGRAM = """
import ctypes, sys
mathematics = ctypes.CDLL(None)
import insitu
from insitu.bindings.blueprint import initialize
if sys.argv[2] == "traps":
    mathematics.feenableexcept(13)
function = insitu.TransferFunction(((0.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.1, 0.0)), ((0.0, 0.0), (1.0, 0.8)), 0.4)
session = initialize(sys.argv[1], space={"p": (0, 1)}, appearances=[insitu.VolumeRendering("v", function, shaded=True)],
    views=insitu.ViewPlan(frequency=1, width=24, height=24))
values = [(i % 8) / 7 for i in range(512)]
mesh = {"coordsets/c/type": "uniform", "topologies/t/type": "uniform", "topologies/t/coordset": "c",
    "fields/f/association": "vertex", "fields/f/topology": "t", "fields/f/values": values}
mesh |= {f"coordsets/c/dims/{i}": 8 for i in "ijk"}
session.execute(mesh, {"p": 0.5})
session.finalize()
print(mathematics.fegetexcept())
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="sets traps as glibc does")
def test_a_loop_with_traps_renders_the_same_and_keeps_them(tmp_path: Path) -> None:
    for traps, left in (("none", "0\n"), ("traps", "13\n")):
        done = run(sys.executable, "-c", PROGRAM, tmp_path / f"{traps}.cdb", traps)
        assert (done.returncode, done.stdout) == (0, left), done.stderr
    one, other = (Catalog.open(tmp_path / f"{traps}.cdb") for traps in ("none", "traps"))
    name = one.members[0].name
    np.testing.assert_array_equal(one.images(name, "v"), other.images(name, "v"))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="sets traps as glibc does")
def test_traps_are_off_inside_and_back_after_an_error() -> None:
    mathematics = ctypes.CDLL(None)
    mathematics.feenableexcept(INVALID_ZERO_OVERFLOW)
    try:
        with suppress(KeyError), no_traps():
            assert mathematics.fegetexcept() == 0
            with np.errstate(all="ignore"):
                assert math.isinf((np.ones(9) / np.zeros(9))[8])
            raise KeyError
        assert mathematics.fegetexcept() == INVALID_ZERO_OVERFLOW
    finally:
        mathematics.fedisableexcept(INVALID_ZERO_OVERFLOW)


def test_without_such_functions_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda _: object())
    with no_traps():
        assert True
