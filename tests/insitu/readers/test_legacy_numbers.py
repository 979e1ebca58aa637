"""Legacy VTK text with Fortran's exponents: VTK makes two numbers of 0.1584-100, and goes on with all others displaced."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from insitu.readers.files import read_data, read_field

VALUES = (np.arange(27) + 0.5).reshape(3, 3, 3)
HEAD = (
    "# vtk DataFile Version 3.0\nu\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 3 3\nORIGIN 0 0 0\nSPACING 1 1 1\n"
)


def written(path: Path, changes: dict[int, str], rest: str = "", separator: str = "\n") -> Path:
    words = [f"{value:.4f}" for value in VALUES.ravel()]
    for place, word in changes.items():
        words[place] = word
    array = "SCALARS u double 1\nLOOKUP_TABLE default\n"
    path.write_text(f"{HEAD}POINT_DATA 27\n{array}{separator.join(words)}\n{rest}")
    return path


MORE = "SCALARS v double 1\nLOOKUP_TABLE default\n" + "1.0 " * 27 + "\n"


@pytest.mark.parametrize("separator", ["\n", " "])
@pytest.mark.parametrize("rest", ["", MORE])
@pytest.mark.parametrize(
    "changes",
    [
        {5: "0.1584-100"},
        {0: "-0.1584-100"},
        {26: "0.1584+101"},
        {5: "0.5D+00", 7: "0.25D-02"},
        dict.fromkeys(range(27), "0.1000-150"),
    ],
)
def test_every_number_keeps_its_place(tmp_path: Path, changes: dict[int, str], rest: str, separator: str) -> None:
    expected = VALUES.copy()
    for place, word in changes.items():
        expected.ravel()[place] = float(word.replace("D", "E") if "D" in word else f"{word[:-4]}E{word[-4:]}")
    found = read_data(written(tmp_path / "a.vtk", changes, rest, separator), array="u")
    values = np.array([found.GetPointData().GetArray("u").GetValue(i) for i in range(27)])
    assert np.array_equal(values, expected.ravel())


def test_other_mistakes_stay_errors(tmp_path: Path) -> None:
    for changes in ({5: "1.5 2.5"}, {5: "O.5"}, {5: "0.1584-100 7"}):
        with pytest.raises(ValueError, match=r"a\.vtk: VTK says"):
            read_field(written(tmp_path / "a.vtk", changes))


def test_the_first_file_of_a_process_is_no_exception(tmp_path: Path) -> None:
    """pyvista takes VTK's messages to itself when it is imported."""
    path = written(tmp_path / "a.vtk", {5: "1.5 2.5"})
    program = f"from insitu.readers.files import read_field; read_field({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "a.vtk: VTK says" in done.stderr.strip().splitlines()[-1]
