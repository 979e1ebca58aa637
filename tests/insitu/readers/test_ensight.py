"""EnSight Gold cases of one time: whole ones are read, and wherever a file is cut there is one sentence."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from insitu.readers.files import read_data, read_field
from insitu.readers.whole_files import check_whole
from tests.support.vtk_writers import COUNTS, VALUES

AXES = [np.arange(n, dtype="f4") for n in COUNTS]
POINTS = [axis.ravel() for axis in np.meshgrid(*AXES[::-1], indexing="ij")[::-1]]  # x, y, z in the order of VALUES
NUMBERS = np.arange(VALUES.size).reshape(VALUES.shape) + 1
CORNERS = ((0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0))
CELLS = np.stack([NUMBERS[z : z + 6, y : y + 7, x : x + 10].ravel() for z, y, x in CORNERS], axis=1)


class Writer:
    """Words, whole numbers and real ones, in text or in binary."""

    def __init__(self, binary: bool) -> None:
        self.binary, self.data = binary, b""

    def words(self, *lines: str) -> Writer:
        self.data += b"".join(t.encode().ljust(80) if self.binary else f"{t}\n".encode() for t in lines)
        return self

    def integers(self, values: Sequence[int], a_line: int = 1) -> Writer:
        if self.binary:
            self.data += struct.pack(f"<{len(values)}i", *values)
        else:
            rows = [values[i : i + a_line] for i in range(0, len(values), a_line)]
            self.data += "".join("".join(f"{v:10d}" for v in row) + "\n" for row in rows).encode()
        return self

    def reals(self, values: Sequence[float] | np.ndarray) -> Writer:
        text = np.asarray(values, "<f4").tobytes() if self.binary else "".join(f"{v:12.5e}\n" for v in values).encode()
        self.data += text
        return self


def write(folder: Path, kind: str, binary: bool) -> Path:
    """A case of one part with `VALUES` on its nodes, and their numbers on its cells."""
    geometry = Writer(binary).words(*(["C Binary"] if binary else []), "a", "b")
    geometry.words("node id given" if kind == "cells" else "node id off", "element id off")
    geometry.words("part").integers([1]).words("grid")
    if kind == "cells":
        geometry.words("coordinates").integers([VALUES.size]).integers(NUMBERS.ravel().tolist())
        geometry.reals(np.concatenate(POINTS))
        geometry.words("hexa8").integers([len(CELLS)]).integers(CELLS.ravel().tolist(), 8)
    else:
        geometry.words(f"block {kind}").integers(COUNTS, 3)
        geometry.reals(
            {
                "uniform": np.repeat([0.0, 1.0], 3),
                "rectilinear": np.concatenate(AXES),
                "curvilinear": np.concatenate(POINTS),
            }[kind]
        )
    (folder / "a.geo").write_bytes(geometry.data)
    on_nodes, on_cells = ("coordinates", "hexa8") if kind == "cells" else ("block", "block")
    nodes = Writer(binary).words("t", "part").integers([1]).words(on_nodes).reals(VALUES.ravel())
    cells = Writer(binary).words("c", "part").integers([1]).words(on_cells).reals(np.arange(len(CELLS)))
    (folder / "a.t").write_bytes(nodes.data)
    (folder / "a.c").write_bytes(cells.data)
    (folder / "a.case").write_text(
        "FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: a.geo\n"
        "VARIABLE\nscalar per node: t a.t\nscalar per element: c a.c\n"
    )
    return folder / "a.case"


@pytest.mark.parametrize("binary", [False, True], ids=["text", "binary"])
@pytest.mark.parametrize("kind", ["uniform", "rectilinear", "curvilinear", "cells"])
def test_a_cut_anywhere_is_one_sentence(tmp_path: Path, kind: str, binary: bool) -> None:
    path = write(tmp_path, kind, binary)
    if kind != "curvilinear":
        np.testing.assert_allclose(read_field(path, array="t").values, VALUES, rtol=1e-5)
    for part in (tmp_path / name for name in ("a.geo", "a.t", "a.c")):
        whole = part.read_bytes()
        end = len(whole) if binary else len(whole) - 1  # the last end of line is none of the values
        for cut in {*range(0, end, max(1, end // 97)), *range(end - 30, end)}:
            part.write_bytes(whole[:cut])
            with pytest.raises(ValueError, match=rf"{part.name}: it ends within part [01]: was it cut short\?"):
                check_whole(path)
        part.write_bytes(whole[: end // 2])
        with pytest.raises(ValueError, match=rf"a\.case: {part.name}: it ends within part"):
            read_data(path, array="t")
        part.write_bytes(whole)
    (tmp_path / "a.t").unlink()
    with pytest.raises(ValueError, match=r"there is no file a\.t, which it names"):
        read_data(path, array="t")


def test_sections_that_are_not_known_are_left_to_vtk(tmp_path: Path) -> None:
    path = write(tmp_path, "uniform", False)
    for name, before, after in (
        ("a.geo", "block uniform", "block uniform with_ghost"),
        ("a.t", "block", "block undef"),
    ):
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text.replace(before, after))
        check_whole(path)
        (tmp_path / name).write_text(text)
