"""Arrays of Fortran, however they lie in memory: pictures are those of the same values in Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.scene import Scene
from insitu import Session
from insitu.members.planning import PlanOptions
from tests.support.embedded import Library, built, run

SCENE = """
name = "arrays"
[source]
kind = "loop"
[[parameters]]
name = "case"
low = 1.0
high = 99.0
[[appearance]]
kind = "volume"
name = "v"
field = "u"
[appearance.transfer_function]
color_points = [[-1.0, 0.1, 0.3, 0.9], [1.0, 0.9, 0.2, 0.1]]
opacity_points = [[-1.0, 0.0], [1.0, 0.9]]
opacity_unit_distance = 1.0
[views]
frequency = 1
width = 24
height = 20
[render]
sample_distance = 0.5
"""

PROGRAM = """
module arrays
  use insitu
  use, intrinsic :: iso_c_binding
  implicit none
  type cell
    real(c_float) :: a
    real(c_double) :: u
    integer(c_int) :: b
  end type
  integer :: cases = 0
contains
  subroutine render(failed)
    integer, intent(in) :: failed
    real(c_double), allocatable :: litter(:)
    integer :: i
    do i = 1, 20  ! what a temporary array left behind is overwritten
      allocate(litter(200 * i))
      litter = 0.125_c_double
      deallocate(litter)
    end do
    cases = cases + 1
    if (failed /= 0) print "(i0, 2a)", cases, " set: ", insitu_error()
    if (failed /= 0) return
    if (insitu_set_parameter("case", real(cases, c_double)) /= 0) print "(2a)", "parameter: ", insitu_error()
    if (insitu_render() /= 0) print "(i0, 2a)", cases, " render: ", insitu_error()
  end subroutine

  subroutine assumed(u)
    real(c_double), intent(in) :: u(:, :, :)
    call render(insitu_set_field("u", u(2:, :, ::2)))
  end subroutine

  subroutine explicit(u, nx, ny, nz)
    integer, intent(in) :: nx, ny, nz
    real(c_double), intent(in) :: u(nx, ny, nz)
    call render(insitu_set_field("u", u))
  end subroutine

  function doubled(u) result(twice)
    real(c_double), intent(in) :: u(:, :, :)
    real(c_double), allocatable :: twice(:, :, :)
    twice = 2 * u
  end function
end module

program main
  use arrays
  implicit none
  real(c_double), allocatable, target :: u(:, :, :)
  real(c_float), allocatable :: single(:, :, :)
  integer(c_int), allocatable :: whole(:, :, :)
  integer(c_long_long), allocatable :: long(:, :, :)
  type(cell), allocatable :: cells(:, :, :)
  real(c_double), pointer :: p(:, :, :)
  real(c_double) :: small(2, 3, 2), unit(3) = 1
  character(1024) :: scene, catalog
  integer :: i, j, k
  call get_command_argument(1, scene)
  call get_command_argument(2, catalog)
  if (insitu_initialize(scene, catalog) /= 0) print "(2a)", "initialize: ", insitu_error()
  if (insitu_set_grid(unit, 0 * unit) /= 0) print "(2a)", "grid: ", insitu_error()
  allocate(u(0:13, 0:11, -1:9))
  do k = -1, 9
    do j = 0, 11
      do i = 0, 13
        u(i, j, k) = mod(7 * i + 3 * j + 5 * (k + 1), 17) / 8.0_c_double - 1
      end do
    end do
  end do
  single = real(u, c_float)
  whole = nint(u)
  long = nint(u)
  allocate(cells(0:13, 0:11, -1:9))
  cells%a = -1; cells%b = 1; cells%u = u
  call render(insitu_set_field("u", u))
  call render(insitu_set_field("u", u(1:12, 1:10, 0:8)))
  call render(insitu_set_field("u", u(13:0:-1, :, 9:-1:-1)))
  call render(insitu_set_field("u", u(::2, :, ::3)))
  call render(insitu_set_field("u", 0.5_c_double * u))
  p => u(2:9:2, 3:, :)
  call render(insitu_set_field("u", p))
  p(0:, 0:, 0:) => u(:, 11:0:-2, :)
  call render(insitu_set_field("u", p))
  call render(insitu_set_field("u", single(1:12, 2:11, 2:10)))
  call render(insitu_set_field("u", whole(:, 12:1:-1, :)))
  call render(insitu_set_field("u", long(::3, :, :)))
  call render(insitu_set_field("u", u([1, 5, 3, 2], :, :)))
  call assumed(u(1:12, :, :))
  call explicit(u(1:12, 1:10, 0:8), 12, 10, 9)
  call render(insitu_set_field("u", reshape(u(0:9, :, :), [12, 10, 11], order=[2, 1, 3])))
  call render(insitu_set_field("u", cells%u))
  call render(insitu_set_field("u", cells(:, 11:1:-5, :)%u))
  call render(insitu_set_field("u", doubled(u(3:6, :, :))))
  small = u(0:1, 0:2, 0:1)
  i = insitu_set_field("u", small)
  small = 1e30_c_double                   ! published already
  call render(i)
  call render(insitu_set_field("u", u(3:2, :, :)))
  call render(insitu_set_field("u", u(3:3, :, :)))
  nullify(p)
  call render(insitu_set_field("u", p))
  if (insitu_set_grid(unit(:2), unit) /= 0) print "(2a)", "two: ", insitu_error()
  if (insitu_set_ghosts([1, 1, 1]) /= 0) print "(2a)", "ghosts: ", insitu_error()
  if (insitu_finalize() /= 0) print "(2a)", "finalize: ", insitu_error()
end program
"""

X, Y, Z = np.meshgrid(np.arange(14), np.arange(12), np.arange(11), indexing="ij")
U = ((7 * X + 3 * Y + 5 * Z) % 17) / 8.0 - 1.0  # [x, y, z]
ROUNDED = np.sign(U) * np.floor(np.abs(U) + 0.5)
EXPECTED = [
    U,
    U[1:13, 1:11, 1:10],
    U[::-1, :, ::-1],
    U[::2, :, ::3],
    0.5 * U,
    U[2:10:2, 3:, :],
    U[:, ::-2, :],
    U[:12, 1:11, 1:10].astype(np.float32),
    ROUNDED[:, ::-1, :].astype(np.int32),
    ROUNDED[::3].astype(np.int64),
    U[[1, 5, 3, 2]],
    U[2:13, :, ::2],
    U[1:13, 1:11, 1:10],
    U[:10].transpose(1, 0, 2),
    U,
    U[:, [11, 6, 1], :],
    2 * U[3:7],
    U[:2, :3, 1:3],
]
REFUSED = """\
19 set: ValueError: field 'u': values must be given, got NULL
20 set: ValueError: field 'u': shape must be at least 2 samples along x, y and z, got (1, 12, 11)
21 set: ValueError: field 'u': values must be given, got NULL
two: ValueError: spacing, three numbers (x, y, z), must be given, got NULL
ghosts: ValueError: layers (1, 1, 1) are of a rank's block"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return built(tmp_path_factory.mktemp("fortran"))


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    folder = tmp_path_factory.mktemp("python")
    (folder / "scene.toml").write_text(SCENE)
    scene = Scene.load(folder / "scene.toml")
    with Session(folder / "python.cdb", **vars(PlanOptions.of_scene(scene, scene.space))) as session:
        for case, values in enumerate(EXPECTED, 1):
            field = {"u": np.ascontiguousarray(values.transpose(2, 1, 0))}
            session.render_member(field, {"case": case}, spacing=(1, 1, 1), origin=(0, 0, 0))
    return Catalog.open(folder / "python.cdb")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*the member's box")
@pytest.mark.parametrize("options", [["-O0", "-fcheck=bounds,mem"], ["-O3", "-ffpe-trap=invalid,zero,overflow"]])
def test_any_array_is_rendered_as_it_was_when_it_was_set(library, expected, options, tmp_path: Path) -> None:
    program = library.program(PROGRAM, *options, compiler="gfortran", suffix=".f90")
    done = run(program, expected.path.parent / "scene.toml", tmp_path / "fortran.cdb")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [a[: len(b)] for a, b in zip(lines, REFUSED.splitlines(), strict=True)] == REFUSED.splitlines()
    catalog = Catalog.open(tmp_path / "fortran.cdb")
    assert len(catalog.members) == len(EXPECTED)
    for member in expected.members:
        name = member.name
        assert catalog.find(member.parameters) is not None, name
        np.testing.assert_array_equal(catalog.images(name, "v"), expected.images(name, "v"), err_msg=name)
