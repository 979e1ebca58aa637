"""The examples in C and Fortran, compiled and run, with and without MPI."""

from __future__ import annotations

import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from insitu.bindings.build import BuildError, build
from render.quality import psnr
from tests.support.embedded import Library, built, run

EXAMPLE = Path(__file__).parents[3] / "examples" / "embedding"
BESIDE = Path(sys.executable).parent  # where the mpich wheel puts its commands


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return built(tmp_path_factory.mktemp("library"))


@pytest.mark.slow
def test_programs_in_c_and_fortran_and_ranks_of_mpi_render_the_same(library: Library, tmp_path: Path) -> None:
    programs: dict[str, list[object]] = {"c": [library.program(EXAMPLE / "waves.c")]}
    if shutil.which("gfortran"):
        programs["fortran"] = [library.program(EXAMPLE / "waves.f90", compiler="gfortran")]
    mpicc = BESIDE / "mpicc"
    if mpicc.is_file() and find_spec("mpi4py"):
        program = library.program(EXAMPLE / "waves.c", "-DWITH_MPI", compiler=str(mpicc))
        programs["mpi"] = [BESIDE / "mpiexec", "-n", "3", program]
    for name, program in programs.items():
        done = run(*program, EXAMPLE / "scene.toml", tmp_path / f"{name}.cdb")
        assert (done.returncode, done.stdout) == (0, "2 members\n"), done.stderr
    first, *others = (Catalog.open(tmp_path / f"{name}.cdb") for name in programs)
    assert sorted(m.parameters["time"] for m in first.members) == [0.0, 0.5]
    for other in others:
        for member in first.members:
            pictures = zip(*(c.images(member.name, "waves", dtype="float32") for c in (first, other)), strict=True)
            assert min(psnr(a, b) for a, b in pictures) >= 80.0
    again = run(*programs["c"], EXAMPLE / "scene.toml", tmp_path / "c.cdb")  # all there: skipped
    assert (again.returncode, again.stdout) == (0, "2 members\n"), again.stderr


@pytest.mark.slow
def test_a_program_is_told_what_is_wrong(library: Library, tmp_path: Path) -> None:
    done = run(library.program(EXAMPLE / "waves.c"), tmp_path / "none.toml", tmp_path / "c.cdb")
    assert done.returncode == 1
    assert "waves: FileNotFoundError: scene " in done.stderr
    assert not (tmp_path / "c.cdb").exists()


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ("insitu.bindings.build.find_spec", "needs cffi and setuptools: pip install 'gs-surrogate\\[embedding\\]'"),
        ("insitu.bindings.build.shutil.which", "needs a C compiler"),
        ("insitu.bindings.build.sysconfig.get_config_var", "built without its shared library"),
    ],
)
def test_what_is_missing_is_named(missing, message, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(missing, lambda *_: None)
    with pytest.raises(BuildError, match=message):
        build(tmp_path / "lib")
    assert not (tmp_path / "lib").exists()
