"""AMReX: cells behind an embedded boundary are holes, numbers have the extremes that their headers print, any domain is read."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from insitu.readers.files import read_data, read_field
from insitu.readers.reader import Sampling
from tests.support.amrex_files import boxes_of, write_plotfile
from tests.support.damage import damaged, read_or_refused

COUNTS = (8, 6, 16)  # x, y, z
BOXES = boxes_of((0, 0, 0), COUNTS, 4)
BALL = sum((c - n / 2 + 0.5) ** 2 for c, n in zip(np.ogrid[:16, :6, :8], (16, 6, 8), strict=True)) < 9  # [z, y, x]


def values(seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).standard_normal(COUNTS[::-1])


def means(field: NDArray[np.float64], hidden: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Over blocks of 2 x 2 x 2 cells, of those that are not hidden, a block at a time."""
    found = np.full([n // 2 for n in field.shape], np.nan)
    for block in np.ndindex(found.shape):
        cells = tuple(slice(2 * i, 2 * i + 2) for i in block)
        if not hidden[cells].all():
            found[block] = field[cells][~hidden[cells]].mean()
    return found


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4"])
@pytest.mark.parametrize(
    ("stored", "share"), [(1e30, None), (-1e40 / 1e8, None), (1e35, None), (0.0, "vfrac"), (7.0, "volFrac")]
)
def test_covered_cells_are_holes(tmp_path: Path, kind: str, stored: float, share: str | None) -> None:
    level = {"rho": np.where(BALL, stored, values())}
    if share:
        level[share] = np.where(BALL, 0.0, 0.5)
    path = write_plotfile(tmp_path / "plt1", [level], [BOXES], kind=kind)
    found = read_data(path, array="rho").values
    assert np.array_equal(found, np.where(BALL, np.nan, values().astype(kind)), equal_nan=True)
    grid = read_field(path, nan="transparent", array="rho")
    assert grid.holes is not None
    with pytest.raises(ValueError, match="NaN"):
        read_field(path, array="rho")
    coarse = read_data(path, array="rho", sampling=Sampling((4, 3, 8))).values
    assert np.allclose(coarse, means(values().astype(kind), BALL), rtol=1e-6, atol=1e-6, equal_nan=True)
    if share:
        assert np.array_equal(read_data(path, array=share).values, level[share])


def test_large_values_are_no_holes(tmp_path: Path) -> None:
    level = {"pressure": 1e34 * (1.5 + values() ** 2)}  # of a neutron star, dyn/cm^2
    path = write_plotfile(tmp_path / "plt1", [level], [BOXES])
    assert np.array_equal(read_data(path).values, level["pressure"])


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">f4"])
def test_swapped_numbers_are_refused(tmp_path: Path, kind: str) -> None:
    path = write_plotfile(tmp_path / "plt1", [{"rho": values()}], [BOXES], kind=kind)
    size, file = int(kind[-1]), path / "Level_0" / "Cell_D_00001"
    data = file.read_bytes()
    begin = data.index(b"\n") + 1
    cells = np.frombuffer(data, kind, 64, begin)
    file.write_bytes(data[:begin] + cells.byteswap().tobytes() + data[begin + 64 * size :])
    with pytest.raises(
        ValueError, match=r"plt1: Level_0/Cell_H: box 1 lies from .* to .*, its numbers from .*: they are damaged"
    ):
        read_data(path)


@pytest.mark.parametrize("memory", [1, 8 * 8 * 6 * 3, 1 << 28])
@pytest.mark.parametrize("seed", range(3))
def test_extremes_that_disagree_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, memory: int, seed: int
) -> None:
    monkeypatch.setattr("insitu.readers.amrex.SLAB", memory)
    path = write_plotfile(tmp_path / "plt1", [{"rho": values(), "T": values(1)}], [BOXES])
    lines = (path / "Level_0" / "Cell_H").read_text().split("\n")
    rows = [i for i, line in enumerate(lines) if line.endswith(",")]
    row = int(np.random.default_rng(seed).choice(rows))
    rho, temperature, _ = lines[row].split(",")
    lines[row] = f"{float(rho) + 0.01!r},{temperature},"
    (path / "Level_0" / "Cell_H").write_text("\n".join(lines))
    with pytest.raises(ValueError, match="they are damaged, or in another order of bytes"):
        read_data(path, array="rho")
    assert np.array_equal(read_data(path, array="T").values, values(1))  # which is as its header says
    lines[row] = f"rho,{temperature},"
    (path / "Level_0" / "Cell_H").write_text("\n".join(lines))
    with pytest.raises(ValueError, match="must have numbers as its minima and maxima"):
        read_data(path, array="rho")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("printed", ["as written", "others'"])
def test_not_finite_numbers_are_no_damage(tmp_path: Path, bad: float, printed: str) -> None:
    field = values()
    field[2:9:3, 1, 1] = bad
    path = write_plotfile(tmp_path / "plt1", [{"rho": field}], [BOXES])
    if printed != "as written":  # a comparison passes NaN over
        head = (path / "Level_0" / "Cell_H").read_text().split("\n")
        rows = iter([i for i, line in enumerate(head) if line.endswith(",")])
        for which in (np.nanmin, np.nanmax):
            for first, last in BOXES:
                cells = field[tuple(slice(a, b + 1) for a, b in zip(first[::-1], last[::-1], strict=True))]
                head[next(rows)] = f"{float(which(cells))!r},"
        (path / "Level_0" / "Cell_H").write_text("\n".join(head))
    assert np.array_equal(read_data(path).values, field, equal_nan=True)


def test_a_header_without_extremes_is_read(tmp_path: Path) -> None:
    path = write_plotfile(tmp_path / "plt1", [{"rho": values()}], [BOXES])
    head = (path / "Level_0" / "Cell_H").read_text()
    whole, count = head.split(f"\n\n{len(BOXES)},1\n", 1)[0] + "\n", len(BOXES)
    (path / "Level_0" / "Cell_H").write_text(whole)
    assert np.array_equal(read_data(path).values, values())
    (path / "Level_0" / "Cell_H").write_text(head[: head.rindex(f"\n{count},1\n")])
    with pytest.raises(ValueError, match=f"the maxima of {count} boxes and 1 components must follow"):
        read_data(path)


CORNERS = [0.0, -0.1, 0.2, 0.3, -0.7, 1 / 3, 28.49002849, -20e-6, 10e-6, 1e-9, 3e-9, 1e6, 1e6 + 1e-3, 6.957e10, 1e25]


@pytest.mark.parametrize(("low", "high"), [(a, b) for a in CORNERS for b in CORNERS if a < b])
@pytest.mark.parametrize("digits", ["%.17g", "%.16e", "%.9g"])
def test_every_domain_is_read(tmp_path: Path, low: float, high: float, digits: str) -> None:
    path = write_plotfile(tmp_path / "plt1", [{"rho": values()}], [BOXES], low=(low,) * 3, high=(high,) * 3)
    lines = (path / "Header").read_text().split("\n")
    for number in (5, 6, 10):
        line = " ".join(digits % float(word) for word in lines[number + 1].split()) if number else ""
        lines[number + 1] = line
    (path / "Header").write_text("\n".join(lines))
    if float(digits % low) == float(digits % high):
        return  # as no code with so few digits writes it
    found = read_data(path)
    assert np.array_equal(found.values, values())
    assert found.spacing == pytest.approx([(high - low) / n for n in COUNTS], rel=1e-5 if digits == "%.9g" else 1e-12)


@st.composite
def damaged_numbers(draw: st.DrawFn, data: bytes) -> bytes:
    """Numbers of 8 bytes of which some were swapped, moved or replaced."""
    begin = data.index(b"\n") + 1
    cells = np.frombuffer(data, "<f8", 64, begin).copy()
    first = draw(st.integers(0, 63))
    last = draw(st.integers(first + 1, 64))
    harm = draw(st.sampled_from(["swap", "zero", "ones", "scale", "same"]))
    if harm == "swap":
        cells[first:last] = cells[first:last].byteswap()
    elif harm != "same":
        cells[first:last] = {"zero": 0.0, "ones": np.nan, "scale": 1e5 * cells[first:last]}[harm]
    return data[:begin] + cells.tobytes() + data[begin + 512 :]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_accepted_headers_give_the_writers_values(data: st.DataObject) -> None:
    """Whatever is changed in the headers of boxes, values that are read are those that were written."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_plotfile(Path(folder, "plt1"), [{"rho": values()}], [BOXES])
        file = path / "Level_0" / "Cell_H"
        file.write_bytes(data.draw(damaged(file.read_bytes())))
        found = read_or_refused(lambda: read_data(path, array="rho", reader="amrex"), path)
        assert found is None or np.array_equal(found.values, values())


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_accepted_numbers_lie_within_the_printed_extremes(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write_plotfile(Path(folder, "plt1"), [{"rho": values()}], [BOXES])
        file = path / "Level_0" / "Cell_D_00000"
        file.write_bytes(data.draw(damaged_numbers(file.read_bytes())))
        found = read_or_refused(lambda: read_data(path, array="rho", reader="amrex"), path)
        if found is not None:
            for first, last in BOXES:
                cells = tuple(slice(a, b + 1) for a, b in zip(first[::-1], last[::-1], strict=True))
                read, written = found.values[cells], values()[cells]
                assert np.nanmin(read) == pytest.approx(written.min(), rel=1.1e-5)
                assert np.nanmax(read) == pytest.approx(written.max(), rel=1.1e-5)
