"""The library in a C program: wrong arguments, threads, signals and floating-point traps of the program."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from insitu.bindings.build import CALLED
from tests.support.embedded import ENVIRONMENT, Library, built, run

SCENE = Path(__file__).parents[3] / "examples" / "embedding" / "scene.toml"

START = """
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <fenv.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "insitu.h"
static float values[24 * 24 * 24];
static const int shape[3] = {24, 24, 24};
static const double step[3] = {0.1, 0.1, 0.1}, origin[3] = {0, 0, 0};
static void say(const char *what, int status) {
  printf("%s: %d %s\\n", what, status, insitu_error());
  fflush(stdout);
}
static void begin(char **arguments) {
  for (int i = 0; i < 24 * 24 * 24; ++i) values[i] = (float)((i % 24) / 12.0 - 1.0);
  say("initialize", insitu_initialize(arguments[1], arguments[2]));
  insitu_set_parameter("k", 2);
  insitu_set_grid(step, origin);
}
static int render(double time) { return insitu_set_field("", values, shape) || insitu_render(time); }
"""

WRONG = (
    START
    + """
int main(int count, char **arguments) {
  (void)count;
  const int none[3] = {-1, 24, 24};
  say("early", render(0));
  say("early has", insitu_has(0));
  say("no scene", insitu_initialize(NULL, arguments[2]));
  say("no catalog", insitu_initialize(arguments[1], NULL));
  say("empty", insitu_initialize(arguments[1], ""));
  say("file", insitu_initialize(arguments[1], arguments[1]));
  say("inside a file", insitu_initialize(arguments[1], "/dev/null/a.cdb"));
  say("forbidden", insitu_initialize(arguments[1], "/proc/a.cdb"));
  begin(arguments);
  say("twice", insitu_initialize(arguments[1], arguments[2]));
  say("no name", insitu_set_parameter(NULL, 1));
  say("other name", insitu_set_parameter("\\xe4", 1));
  say("no spacing", insitu_set_grid(NULL, origin));
  say("no origin", insitu_set_grid(step, NULL));
  say("no layers", insitu_set_ghosts(NULL));
  say("no field", insitu_render(0));
  say("unnamed", insitu_set_field(NULL, values, shape));
  say("no values", insitu_set_field("", NULL, shape));
  say("no double", insitu_set_field_double("", NULL, shape));
  say("no shape", insitu_set_field("", values, NULL));
  say("negative", insitu_set_field("", values, none));
  say("no type", insitu_copy_field("", values, 0, shape, NULL));
  say("other type", insitu_copy_field("", values, 17, shape, NULL));
  say("copy no values", insitu_copy_field("", NULL, INSITU_FLOAT, shape, NULL));
  const long long wrong[3] = {4, 0, 4}, far[3] = {4, 1LL << 60, 4};
  say("stride 0", insitu_copy_field("", values, INSITU_FLOAT, shape, wrong));
  say("stride far", insitu_copy_field("", values, INSITU_FLOAT, shape, far));
  char name[3001];
  memset(name, 'x', 3000);
  name[3000] = 0;
  say("long", insitu_set_parameter(name, 1));
  say("infinite", insitu_has(INFINITY));
  say("render", render(0.5));
  say("has", insitu_has(0.5));
  say("finalize", insitu_finalize());
  say("late", render(0.5));
  say("again", insitu_finalize());
  return 0;
}
"""
)

SAID = [
    "early: 1 ValueError: insitu_initialize must be called, and succeed, before",
    "early has: -1 ValueError: insitu_initialize must be called, and succeed, before",
    "no scene: 1 ValueError: scene must be a path, got NULL or an empty text",
    "no catalog: 1 ValueError: catalog must be a path, got NULL or an empty text",
    "empty: 1 ValueError: catalog must be a path, got NULL or an empty text",
    "file: 1 CatalogError: a Cinema database is a folder whose name ends with .cdb, got ",
    "inside a file: 1 NotADirectoryError: [Errno 20] Not a directory: no catalog can be written here",
    "forbidden: 1 FileNotFoundError: [Errno 2] No such file or directory: no catalog can be written here",
    "initialize: 0 ",
    "twice: 1 ValueError: insitu_initialize was called twice: call insitu_finalize before",
    "no name: 1 ValueError: the name of a parameter must be given, got NULL",
    "other name: 1 ValueError: the name of a parameter must be UTF-8 text, got b'\\xe4'",
    "no spacing: 1 ValueError: spacing, three numbers (x, y, z), must be given, got NULL",
    "no origin: 1 ValueError: origin, three numbers (x, y, z), must be given, got NULL",
    "no layers: 1 ValueError: layers, three numbers (x, y, z), must be given, got NULL",
    "no field: 1 TypeError: the member has no field: call insitu_set_field before insitu_render",
    "unnamed: 1 ValueError: the name of a field must be given, got NULL",
    "no values: 1 ValueError: field '': values must be given, got NULL",
    "no double: 1 ValueError: field '': values must be given, got NULL",
    "no shape: 1 ValueError: field '': shape, three numbers (x, y, z), must be given, got NULL",
    "negative: 1 ValueError: field '': shape must be three positive numbers (x, y, z), got (-1, 24, 24)",
    "no type: 1 ValueError: type must be INSITU_FLOAT, _DOUBLE, _INT or _LONG_LONG (1 to 4), got 0",
    "other type: 1 ValueError: type must be INSITU_FLOAT, _DOUBLE, _INT or _LONG_LONG (1 to 4), got 17",
    "copy no values: 1 ValueError: field '': values must be given, got NULL",
    "stride 0: 1 ValueError: field '': strides must be bytes between samples along x, y, z, got (4, 0, 4)",
    "stride far: 1 ValueError: field '': strides must be bytes between samples along x, y, z, got (4, 1152921504606846976, 4)",
    "long: 1 ValueError: parameters must be exactly k, time: missing none, unknown xxx",
    "infinite: -1 ValueError: time must be a finite number, got inf",
    "render: 0 ",
    "has: 1 ",
    "finalize: 0 ",
    "late: 1 ValueError: insitu_initialize must be called, and succeed, before",
    "again: 1 ValueError: insitu_initialize must be called, and succeed, before",
]

THREADS = (
    START
    + """
static pthread_mutex_t alone = PTHREAD_MUTEX_INITIALIZER;
static void *work(void *number) {
  for (int i = 0; i < 100; ++i) insitu_has(0.1 * i);
  pthread_mutex_lock(&alone);  /* setting a field and rendering it are two calls */
  int failed = render(*(double *)number);
  pthread_mutex_unlock(&alone);
  if (failed) say("thread", failed);
  return NULL;
}
int main(int count, char **arguments) {
  (void)count;
  pthread_t threads[4];
  double times[4] = {0.0, 0.5, 1.0, 1.5};
  pthread_create(&threads[0], NULL, (void *(*)(void *))begin, arguments);  /* not the first thread */
  pthread_join(threads[0], NULL);
  const char *none = insitu_error();
  int failed = insitu_set_parameter("K", 1);
  for (int i = 0; i < 4; ++i) pthread_create(&threads[i], NULL, work, &times[i]);
  for (int i = 0; i < 4; ++i) pthread_join(threads[i], NULL);
  printf("%s%d %s\\n", none, failed, insitu_error());
  say("render", render(2.0));
  say("finalize", insitu_finalize());
  return 0;
}
"""
)

KEPT = (
    START
    + """
static struct sigaction before[NSIG];
static void handler(int number) { (void)number; }
static void look(const char *when) {
  for (int n = 1; n < NSIG; ++n) {
    struct sigaction now;
    if (sigaction(n, NULL, &now) == 0 && now.sa_handler != before[n].sa_handler) printf("%s changed signal %d\\n", when, n);
  }
  sigset_t blocked;
  pthread_sigmask(SIG_SETMASK, NULL, &blocked);
  for (int n = 1; n < NSIG; ++n)
    if (sigismember(&blocked, n) == 1) printf("%s blocks signal %d\\n", when, n);
  if (fegetexcept() != (FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW)) printf("%s changed traps\\n", when);
  if (fegetround() != FE_UPWARD) printf("%s changed rounding\\n", when);
  if (fetestexcept(FE_ALL_EXCEPT) & ~FE_INEXACT) printf("%s left exceptions\\n", when);
}
int main(int count, char **arguments) {
  (void)count;
  signal(SIGTERM, handler);
  signal(SIGUSR1, SIG_IGN);
  for (int n = 1; n < NSIG; ++n) sigaction(n, NULL, &before[n]);
  feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
  fesetround(FE_UPWARD);
  begin(arguments);
  look("initialize");
  say("render", render(0.0));
  look("render");
  values[7] = NAN;
  say("NaN", render(0.5));
  look("a failure");
  say("finalize", insitu_finalize());
  look("finalize");
  return 0;
}
"""
)

LOOP = (
    START
    + """
static volatile sig_atomic_t stopped;
static void stop(int number) { stopped = number; }
int main(int count, char **arguments) {
  if (count == 4) signal(SIGINT, stop);
  begin(arguments);
  for (int i = 0; !stopped; ++i)
    if (render(0.001 * i)) return 3;
  say("stopped", insitu_finalize());
  return 0;
}
"""
)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return built(tmp_path_factory.mktemp("library"))


@pytest.mark.slow
@pytest.mark.parametrize(("compiler", "suffix"), [("cc", ".c"), ("g++", ".cpp")])
def test_every_mistake_has_a_status_and_a_sentence(
    library: Library, tmp_path: Path, compiler: str, suffix: str
) -> None:
    program = library.program(WRONG, "-Wall", "-Wextra", "-Werror", compiler=compiler, suffix=suffix)
    done = run(program, SCENE, tmp_path / "a.cdb")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line[: len(said)] for line, said in zip(lines, SAID, strict=True)] == SAID
    assert "Traceback" not in done.stderr
    assert len(next(line for line in lines if line.startswith("long"))) > 3000
    assert [m.name for m in Catalog.open(tmp_path / "a.cdb").members] == ["k-2.0_time-0.5"]


@pytest.mark.slow
def test_any_thread_may_call(library: Library, tmp_path: Path) -> None:
    done = run(library.program(THREADS), SCENE, tmp_path / "a.cdb")
    error = "ValueError: parameters must be exactly k, time: missing none, unknown K"
    assert done.stdout == f"initialize: 0 \n1 {error}\nrender: 0 \nfinalize: 0 \n", done.stderr
    assert sorted(m.parameters["time"] for m in Catalog.open(tmp_path / "a.cdb").members) == [0.0, 0.5, 1.0, 1.5, 2.0]


@pytest.mark.slow
def test_traps_rounding_and_signals_of_the_program_stay(library: Library, tmp_path: Path) -> None:
    done = run(library.program(KEPT), SCENE, tmp_path / "a.cdb", LP_NUM_THREADS="2")
    assert done.returncode == 0, (done.stdout, done.stderr)
    said = "initialize: 0 \nrender: 0 \nNaN: 1 ValueError: 1 of 13824 values are NaN"
    assert done.stdout.startswith(said)
    assert done.stdout.splitlines()[3:] == ["finalize: 0 "]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGPIPE])
def test_a_signal_ends_the_loop_as_without_the_library(library: Library, tmp_path: Path, number: int) -> None:
    process = started(library, tmp_path)
    process.send_signal(number)
    assert process.wait(30) == -number


@pytest.mark.slow
def test_a_handler_of_the_program_is_called(library: Library, tmp_path: Path) -> None:
    process = started(library, tmp_path, "handler")
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    assert (process.returncode, out) == (0, b"stopped: 0 \n")
    assert len(Catalog.open(tmp_path / "a.cdb").members) >= 2


def started(library: Library, folder: Path, *options: str) -> subprocess.Popen[bytes]:
    """The program of a loop that has rendered two members."""
    program = library.program(LOOP)
    process = subprocess.Popen(
        [program, SCENE, folder / "a.cdb", *options], stdout=subprocess.PIPE, env=ENVIRONMENT, start_new_session=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"initialize: 0 \n"
    until = time.monotonic() + 60.0
    while len(list((folder / "a.cdb" / "members").glob("*/member.json"))) < 2:
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    return process


@pytest.mark.slow
@pytest.mark.parametrize("locale", ["C", "C.UTF-8"])
def test_paths_are_any_bytes(library: Library, tmp_path: Path, locale: str) -> None:
    folder = os.fsencode(tmp_path) + b"/gr\xfc\xc3\xa4.cdb"
    done = run(library.program(LOOP.replace("!stopped", "i < 1")), SCENE, os.fsdecode(folder), LC_ALL=locale)
    assert done.stdout == "initialize: 0 \nstopped: 0 \n", done.stderr
    assert len(Catalog.open(Path(os.fsdecode(folder))).members) == 1


@pytest.mark.slow
@pytest.mark.parametrize("broken", ["PYTHONHOME", "PYTHONPATH"])
def test_a_library_whose_python_can_not_start_says_so(library: Library, tmp_path: Path, broken: str) -> None:
    (tmp_path / "numpy.py").write_text("raise ImportError('of another environment')")
    done = run(library.program(WRONG), SCENE, tmp_path / "a.cdb", **{broken: str(tmp_path)})
    assert done.returncode == 0
    lines = [line.split(": ")[1] for line in done.stdout.splitlines()]
    assert len(lines) == len(SAID)
    assert all(line.startswith(("1 the library's Python", "-1 the library's Python")) for line in lines)
    assert not (tmp_path / "a.cdb").exists()


def test_the_interpreter_defines_what_the_library_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    from insitu.bindings.library import connect

    defined: list[str] = []

    class Interface:
        def new(self, *_: object) -> bytes:
            return b""

        def def_extern(self, name: str, **_: object) -> object:
            defined.append(name)
            return lambda work: work

    connect(Interface())
    assert sorted(defined) == sorted(
        line.split("(")[0].split()[-1].lstrip("*") for line in CALLED.split("\n") if "(" in line
    )
