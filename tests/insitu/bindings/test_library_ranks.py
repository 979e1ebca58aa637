"""The library on ranks of MPI: a mistake of one rank is an error on all, and none waits for ever."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from tests.support.embedded import built, run

SCENE = Path(__file__).parents[3] / "examples" / "embedding" / "scene.toml"
BESIDE = Path(sys.executable).parent  # where the mpich wheel puts its commands

PROGRAM = """
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include "insitu.h"
static FILE *out;
static int rank, ranks;
static double values[12 * 12 * 12];
static int whole[12 * 12 * 12];
static const int shape[3] = {12, 12, 4};
static const double step[3] = {0.1, 0.1, 0.1};
static void say(const char *what, int status) { fprintf(out, "%s: %d %s\\n", what, status, insitu_error()); }
static int set(void) { return insitu_set_field_double("", values, shape); }
int main(int count, char **arguments) {
  (void)count;
  int early = insitu_initialize_mpi(arguments[1], arguments[2], 0);
  char early_error[2000];
  snprintf(early_error, sizeof early_error, "%s", insitu_error());
  MPI_Init(&count, &arguments);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &ranks);
  const int odd = rank == 1;
  char name[4000];
  snprintf(name, sizeof name, "%s/rank-%d.txt", arguments[3], rank);
  out = fopen(name, "w");
  fprintf(out, "early: %d %s\\n", early, early_error);
  const double origin[3] = {0, 0, 0.4 * rank};
  for (int i = 0; i < 12 * 12 * 4; ++i) {
    values[i] = (i % 12) / 6.0 - 1 + 0.01 * rank;
    whole[i] = i % 2;
  }
  const int world = (int)MPI_Comm_c2f(MPI_COMM_WORLD);
  say("null", insitu_initialize_mpi(arguments[1], arguments[2], (int)MPI_Comm_c2f(MPI_COMM_NULL)));
  say("no scene", insitu_initialize_mpi(odd ? NULL : arguments[1], arguments[2], world));
  say("other scene", insitu_initialize_mpi(odd ? "none.toml" : arguments[1], arguments[2], world));
  say("no catalog", insitu_initialize_mpi(arguments[1], odd ? NULL : arguments[2], world));
  say("forbidden", insitu_initialize_mpi(arguments[1], "/dev/null/a.cdb", world));
  say("initialize", insitu_initialize_mpi(arguments[1], arguments[2], world));
  say("twice", insitu_initialize_mpi(arguments[1], arguments[2], world));
  insitu_set_grid(step, origin);
  if (insitu_set_parameter(odd ? "K" : "k", 2) != odd) return 3;
  set();
  say("parameter", insitu_render(0));
  insitu_set_parameter("k", 2);
  if (insitu_set_field_double("", odd ? NULL : values, shape) != odd) return 4;
  say("values", insitu_render(0));
  set();
  if (insitu_set_grid(odd ? NULL : step, origin) != odd) return 5;
  say("grid", insitu_render(0));
  insitu_set_grid(step, origin);
  set();
  say("time", insitu_render(odd ? 0.5 : 0.0));
  if (odd) insitu_copy_field("", whole, INSITU_INT, shape, NULL); else set();
  say("types", insitu_render(0));
  const int layers[3] = {0, 0, odd}, none[3] = {0, 0, 0};
  insitu_set_ghosts(layers);
  set();
  say("ghosts", insitu_render(0));
  insitu_set_ghosts(none);
  say("has", insitu_has(odd ? 0.5 : 0.0));
  set();
  say("render", insitu_render(0));
  say("stored", insitu_has(0));
  say("finalize", insitu_finalize());
  MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_ARE_FATAL);
  fclose(out);
  MPI_Finalize();
  return 0;
}
"""

SAID = [
    "early: 1 ValueError: insitu_initialize_mpi must be called between MPI_Init and MPI_Finalize",
    "null: 1 ValueError: the communicator must have this process in it, got MPI_COMM_NULL",
    "no scene: 1 ValueError: rank 1 of 3: scene must be a path, got NULL",
    "other scene: 1 OSError: rank 1 of 3: scene none.toml does not exist",
    "no catalog: 1 ValueError: rank 1 of 3: catalog must be a path, got NULL",
    "forbidden: 1 NotADirectoryError: [Errno 20] Not a directory",
    "initialize: 0 ",
    "twice: 1 ValueError: rank 0 of 3: insitu_initialize was called twice",
    "parameter: 1 ValueError: rank 0 gives parameters = {'k': 2.0}, rank 1 {}",
    "values: 1 ValueError: rank 1 of 3: field '': values must be given, got NULL",
    "grid: 1 ValueError: rank 1 of 3: spacing, three numbers (x, y, z), must be given, got NULL",
    "time: 1 ValueError: rank 0 gives time = 0.0, rank 1 0.5",
    "types: 1 ValueError: the blocks must have one type of numbers, but rank 0 has float64, rank 1 has int32",
    "ghosts: 1 ValueError: the blocks fill no grid (",
    "has: -1 ValueError: rank 0 gives time = 0.0, rank 1 0.5",
    "render: 0 ",
    "stored: 1 ",
    "finalize: 0 ",
]


@pytest.mark.slow
def test_a_mistake_of_one_rank_is_an_error_on_all(tmp_path: Path) -> None:
    mpicc = BESIDE / "mpicc"
    if not mpicc.is_file() or find_spec("mpi4py") is None:
        pytest.skip("needs mpi4py and mpich")
    program = built(tmp_path).program(PROGRAM, "-Wall", "-Wextra", "-Werror", compiler=str(mpicc))
    done = run(BESIDE / "mpiexec", "-n", "3", program, SCENE, tmp_path / "a.cdb", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    told = [(tmp_path / f"rank-{n}.txt").read_text().splitlines() for n in range(3)]
    assert [a[: len(b)] for a, b in zip(told[0], SAID, strict=True)] == SAID
    assert told[0] == told[1] == told[2]
    assert [m.name for m in Catalog.open(tmp_path / "a.cdb").members] == ["k-2.0_time-0.0"]
