"""Builds the library, with cffi's embedding (https://cffi.readthedocs.io/en/stable/embedding.html)."""

from __future__ import annotations

import shutil
import site
import sysconfig
import tempfile
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from catalogs.files import durable

HEADER, MODULE, SOURCE, LIBRARY = "insitu.h", "insitu.f90", "insitu.c", "libinsitu.so"

# Functions of insitu/bindings/library.py that insitu.c calls.
CALLED = """
int insitu_python_initialize(const char *, const char *, int, int);
int insitu_python_set_parameter(const char *, double);
int insitu_python_set_grid(const double *, const double *);
int insitu_python_set_ghosts(const int *);
int insitu_python_set_field(const char *, const void *, int, const int *);
int insitu_python_copy_field(const char *, const void *, int, const int *, const long long *);
int insitu_python_render(double);
int insitu_python_has(double);
int insitu_python_finalize(void);
const char *insitu_python_error(void);
"""

# Runs once, in the interpreter within the library, at the first call.
START = """
import signal
from _insitu_library import ffi, lib
lib.insitu_keep_handlers()
import site
for folder in {folders!r}:
    site.addsitedir(folder)
from insitu.bindings.library import connect
connect(ffi)
"""


class BuildError(RuntimeError):
    """The library can't be built here; the text says what is missing."""


def build(folder: Path) -> list[Path]:
    """Write the library, its header and the Fortran module into a folder; returns their paths.

    Raises BuildError naming what is missing.
    """
    _check_environment()
    import cffi

    sources = {name: (files("insitu.bindings") / name).read_text() for name in (HEADER, MODULE, SOURCE)}
    builder = cffi.FFI()
    builder.embedding_api(CALLED)
    builder.cdef("static void insitu_keep_handlers(void);")
    folders = [sysconfig.get_path("purelib"), *site.getsitepackages()]
    builder.embedding_init_code(START.format(folders=list(dict.fromkeys(folders))))
    where = str(sysconfig.get_config_var("LIBDIR"))
    builder.set_source(
        "_insitu_library",
        CALLED + sources[SOURCE],
        extra_link_args=[f"-Wl,-rpath,{where}", "-pthread"],
        library_dirs=[where],
    )
    durable.make_folder(folder)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        Path(scratch, HEADER).write_text(sources[HEADER])
        try:
            library = Path(builder.compile(tmpdir=scratch, target=LIBRARY))
        except Exception as error:
            raise BuildError(f"the compiler failed: {error}") from error
        library.replace(folder / LIBRARY)
    for name in (HEADER, MODULE):
        (folder / name).write_text(sources[name])
    return [folder / name for name in (LIBRARY, HEADER, MODULE)]


def _check_environment() -> None:
    missing = [name for name in ("cffi", "setuptools") if find_spec(name) is None]
    if missing:
        raise BuildError(f"building the library needs {' and '.join(missing)}: pip install 'gs-surrogate[embedding]'")
    if not any(shutil.which(name) for name in ("cc", "gcc", "clang")):
        raise BuildError("building the library needs a C compiler, and there is none")
    if not sysconfig.get_config_var("Py_ENABLE_SHARED"):
        raise BuildError("this Python was built without its shared library (--enable-shared), which the library needs")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        raise BuildError("building the library needs Python's headers: install python3-dev")
