"""CloverLeaf's dumps: ranks joined, never resampled, and the numbers those that are printed."""

from __future__ import annotations

import gzip
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.fields.location import FieldLocation
from insitu.readers.cloverleaf import recognizes
from insitu.readers.files import read_data, read_field
from insitu.readers.reader import Sampling
from render.datasets import to_grid
from tests.support.cloverleaf_files import printed, write_dump
from tests.support.damage import damaged, memory_at_most, read_or_refused

CELLS = (5, 4, 7)  # z, y, x


def arrays(cells: tuple[int, ...] = CELLS) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    random = np.random.default_rng(0)
    points = tuple(n + 1 for n in cells)
    on_cells = {
        name: random.normal(size=cells) * 10.0 ** random.integers(-9, 9, cells) for name in ("density", "energy")
    }
    return on_cells, {"x_vel": random.normal(size=points)}


def even(cells: tuple[int, ...] = CELLS, spacing: tuple[float, ...] = (0.3, 0.15625, 1 / 3)) -> list[np.ndarray]:
    """Coordinates of the points along x, y and z."""
    return [step * np.arange(n + 1) for step, n in zip(spacing, cells[::-1], strict=True)]


def dump(folder: Path, cuts: tuple[tuple[int, ...], ...] = ((3,), (), (1, 2))) -> Path:
    return write_dump(folder, 40, even(), *arrays(), cuts)[0]


def test_the_ranks_make_one_field_on_cells_and_on_points(tmp_path: Path) -> None:
    path = dump(tmp_path)
    assert len(list(tmp_path.iterdir())) == 6
    on_cells, on_points = arrays()
    energy, speed = (read_data(path, array=name) for name in ("energy", "x_vel"))
    assert np.array_equal(energy.values, printed(on_cells["energy"]))
    assert np.array_equal(speed.values, printed(on_points["x_vel"]))
    assert energy.spacing == pytest.approx((0.3, 0.15625, 1 / 3), rel=3e-4)  # of a box that is printed with 4 digits
    assert energy.origin == pytest.approx((0.15, 0.078125, 1 / 6), rel=3e-4)
    assert speed.origin == (0, 0, 0)
    grid = to_grid(energy)
    assert (grid.shape, grid.notes) == (CELLS, ())


def test_vtk_reads_the_same_from_each_rank(tmp_path: Path) -> None:
    import pyvista

    paths = write_dump(tmp_path, 3, even(), *arrays(), ((), (2,), (3,)))
    whole = read_data(paths[0], array="density").values
    for path, z, y in zip(paths, (0, 0, 3, 3), (0, 2, 0, 2), strict=True):
        block = pyvista.read(path)
        nx, ny, nz = (n - 1 for n in block.dimensions)
        theirs = block.cell_data["density"].reshape(nz, ny, nx)
        assert np.array_equal(whole[z : z + nz, y : y + ny, :nx], theirs)


@settings(max_examples=15)
@given(st.data())
def test_any_number_of_ranks_gives_the_same(data: st.DataObject) -> None:
    cuts = tuple(tuple(sorted(data.draw(st.sets(st.integers(1, n - 1), max_size=2)))) for n in CELLS[::-1])
    with tempfile.TemporaryDirectory() as name:
        found = read_data(dump(Path(name), cuts), array="energy")
        assert np.array_equal(found.values, printed(arrays()[0]["energy"]))


def test_a_mesh_that_is_uneven_indeed_is_resampled_and_says_so(tmp_path: Path) -> None:
    axes = even()
    axes[1] = np.array([0.0, 0.1, 0.3, 0.6, 1.0])
    (path,) = write_dump(tmp_path, 1, axes, {"energy": np.ones(CELLS)}, {})
    assert "unevenly spaced" in read_field(path).notes[0]


def test_packed_files_are_unpacked(tmp_path: Path) -> None:
    for path in write_dump(tmp_path, 40, even(), *arrays(), ((2,), (), ())):
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    found = read_data(tmp_path / "clover.00001.00040.vtk.gz", array="energy")
    assert np.array_equal(found.values, printed(arrays()[0]["energy"]))


def test_other_names_are_asked_for(tmp_path: Path) -> None:
    path = dump(tmp_path, ((), (), ())).rename(tmp_path / "last.vtk")
    assert not recognizes(path)
    assert not recognizes(tmp_path / "clover.visit")
    found = read_data(path, array="energy", reader="cloverleaf")
    assert np.array_equal(found.values, printed(arrays()[0]["energy"]))
    with pytest.raises(ValueError, match=r"there is no reader 'clover', there are .*cloverleaf"):
        read_data(path, reader="clover")


def test_what_a_dump_does_not_have_is_told(tmp_path: Path) -> None:
    path = dump(tmp_path)
    with pytest.raises(ValueError, match=r"name the array to render \(--array\): the file has density, energy, x_vel"):
        read_data(path)
    with pytest.raises(ValueError, match="no array 'temperature': the file has density, energy, x_vel"):
        read_data(path, array="temperature")
    with pytest.raises(ValueError, match="say where their values lie: leave spacing out; this one has"):
        read_data(path, array="energy", location=FieldLocation(spacing=(1, 1, 1)))
    with pytest.raises(ValueError, match="files of cloverleaf are not resampled: leave resolution out"):
        read_data(path, array="energy", sampling=Sampling((2, 2, 2)))


def without_a_rank(folder: Path) -> None:
    (folder / "clover.00002.00040.vtk").unlink()


def without_the_last_rank(folder: Path) -> None:
    for path in sorted(folder.iterdir()):
        (folder / path.name.replace("00040", "00030")).write_bytes(path.read_bytes())
    (folder / "clover.00006.00040.vtk").unlink()


def with_another_runs_rank(folder: Path) -> None:
    (folder / "clover.00007.00040.vtk").write_bytes((folder / "clover.00001.00040.vtk").read_bytes())


def edited(folder: Path, old: str, new: str) -> None:
    path = folder / "clover.00001.00040.vtk"
    path.write_text(path.read_text().replace(old, new, 1))


def test_exponents_of_three_digits_have_no_letter(tmp_path: Path) -> None:
    """VTK takes 0.1584-100 for two numbers."""
    random = np.random.default_rng(1)
    energy = random.normal(size=CELLS) * 10.0 ** random.integers(-300, 300, CELLS)
    axes = [1e-120 * axis for axis in even()]
    path = write_dump(tmp_path, 40, axes, {"energy": energy}, {}, ((3,), (), (1, 2)))[0]
    assert "-120\n" in path.read_text()
    found = read_data(path, array="energy")
    assert np.array_equal(found.values, printed(energy))
    assert found.spacing == pytest.approx((3e-121, 1.5625e-121, 1e-120 / 3), rel=3e-4)


@pytest.mark.parametrize("kept", [(1,), (1, 2), (1, 2, 3, 4)])
def test_a_rank_that_is_missing_at_every_step_shows_by_the_list_of_files(tmp_path: Path, kept: tuple[int, ...]) -> None:
    """The ranks that are left fill a box, and are numbered without a gap."""
    path = dump(tmp_path, ((3,), (), (1, 2)))
    for chunk in set(range(1, 7)) - set(kept):
        (tmp_path / f"clover.{chunk:05d}.00040.vtk").unlink()
    read_data(path, array="energy")
    (tmp_path / "clover.visit").write_text("!NBLOCKS     6\nclover.00001.00040.vtk\n")
    with pytest.raises(ValueError, match=f"chunk {max(kept) + 1} of step 40 is missing, of 6 or more"):
        read_data(path, array="energy")


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (without_a_rank, "chunk 2 of step 40 is missing"),
        (without_the_last_rank, "chunk 6 of step 40 is missing"),
        (with_another_runs_rank, "do not fill one box"),
        (lambda folder: edited(folder, "ASCII", "BINARY"), "00001.*'BINARY' in place of 'ASCII'"),
        (lambda folder: edited(folder, "           4 ", " 99999999999 "), "claims .* more than its"),
        (
            lambda folder: edited(folder, "0.3000E+00", "0.9000E+00"),
            "00001.*coordinates must be at least 2 and increase",
        ),
        (lambda folder: edited(folder, "0.9000E+00", "0.8000E+00"), "make no mesh along x: they overlap"),
        (lambda folder: edited(folder, "energy 1", "energy 3"), "array of 12 single values must follow, got 'energy 3"),
        (lambda folder: edited(folder, "energy 1", "temp 1"), "no array 'energy'"),
        (lambda folder: edited(folder, "0.6000E+00", "0.6O00E+00"), "00001.*coordinates must be numbers"),
    ],
)
def test_a_step_that_is_not_whole_is_one_error(tmp_path: Path, harm: object, message: str) -> None:
    path = dump(tmp_path)
    harm(tmp_path)  # type: ignore[operator]
    with pytest.raises(ValueError, match=message) as caught:
        read_data(path, array="energy")
    assert str(path) in str(caught.value)


def test_a_file_that_is_cut_short_within_its_last_array_is_refused(tmp_path: Path) -> None:
    path = dump(tmp_path, ((), (), ()))
    path.write_bytes(path.read_bytes()[:-20])
    assert read_data(path, array="energy").values.shape == CELLS
    with pytest.raises(ValueError, match="it ends within 'x_vel', of which 2 lines are missing"):
        read_data(path, array="y_vel")
    with pytest.raises(ValueError, match="x_vel must have 240 lines"):
        read_data(path, array="x_vel")


@pytest.mark.slow
@settings(max_examples=200)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = dump(Path(name), ((), (), ()))
        path.write_bytes(data.draw(damaged(path.read_bytes(), 2000)))
        found = read_or_refused(lambda: read_data(path, array="energy"), path)
        assert found is None or found.values.ndim == 3


def test_a_huge_claim_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "clover.00001.00040.vtk"
    head = "# vtk DataFile Version 3.0\nvtk output\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS 99999 99999 99999\n"
    path.write_text(head + "X_COORDINATES 99999 double\n" + "  0.0000E+00\n" * 1000)
    with memory_at_most(1 << 20), pytest.raises(ValueError, match="claims"):
        read_data(path, array="energy")


@pytest.mark.slow
def test_the_codes_own_dump_comes_out_the_same_from_eight_ranks(tmp_path: Path, shared_data: Path) -> None:
    """Its printed words, dealt out to eight files as eight ranks would have printed them."""
    words = gzip.decompress((shared_data / "clover.00001.00040.vtk.gz").read_bytes()).decode().split("\n")
    axes = [np.array(words[first : first + 65], dtype=float) for first in (6, 72, 138)]
    energy = np.array(words[262351 : 262351 + 64**3], dtype=float).reshape(64, 64, 64)
    paths = write_dump(tmp_path, 40, axes, {"energy": energy}, {}, ((32,), (17,), (40,)))
    assert len(paths) == 8
    ours, whole = read_field(paths[0]), read_field(shared_data / "clover.00001.00040.vtk.gz", array="energy")
    assert np.array_equal(ours.values, energy)
    assert np.array_equal(whole.values, energy)
    assert ours.spacing == whole.spacing == (0.15625, 0.15625, 0.15625)
    assert ours.notes == whole.notes == ()
