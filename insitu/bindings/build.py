"""Builds the library, with cffi's embedding (https://cffi.readthedocs.io/en/stable/embedding.html)."""

from __future__ import annotations

import re
import shutil
import site
import sysconfig
import tempfile
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

HEADER, MODULE, LIBRARY = "insitu.h", "insitu.f90", "libinsitu.so"

# Runs once, in the interpreter within the library, at the first call.
START = """
import site
for folder in {folders!r}:
    site.addsitedir(folder)
from _insitu_library import ffi
import numpy as np
from insitu.bindings.calls import LibraryCalls

calls, text = LibraryCalls(), ffi.new("char[]", b"")

def string(pointer):
    return ffi.string(pointer).decode(errors="replace")

def numbers(pointer, count, dtype):
    return np.frombuffer(ffi.buffer(pointer, count * dtype().itemsize), dtype=dtype)

@ffi.def_extern(error=1)
def insitu_initialize(scene, catalog):
    return calls.initialize(string(scene), string(catalog))

@ffi.def_extern(error=1)
def insitu_initialize_mpi(scene, catalog, communicator):
    try:
        from mpi4py import MPI
        comm = MPI.Comm.f2py(communicator)
    except Exception as error:
        calls.error = f"mpi4py can't be used: {{error}}"
        return 1
    return calls.initialize(string(scene), string(catalog), comm)

@ffi.def_extern(error=1)
def insitu_set_parameter(name, value):
    return calls.set_parameter(string(name), value)

@ffi.def_extern(error=1)
def insitu_set_grid(spacing, origin):
    return calls.set_grid(list(spacing[0:3]), list(origin[0:3]))

@ffi.def_extern(error=1)
def insitu_set_ghosts(layers):
    return calls.set_ghosts(list(layers[0:3]))

@ffi.def_extern(error=1)
def insitu_set_field(name, values, shape):
    return calls.set_field(string(name), list(shape[0:3]), lambda count: numbers(values, count, np.float32))

@ffi.def_extern(error=1)
def insitu_set_field_double(name, values, shape):
    return calls.set_field(string(name), list(shape[0:3]), lambda count: numbers(values, count, np.float64))

@ffi.def_extern(error=1)
def insitu_render(time):
    return calls.render(time)

@ffi.def_extern(error=-1)
def insitu_has(time):
    return calls.has(time)

@ffi.def_extern(error=1)
def insitu_finalize():
    return calls.finalize()

@ffi.def_extern()
def insitu_error():
    global text
    text = ffi.new("char[]", calls.error.encode())
    return text
"""


class BuildError(RuntimeError):
    """The library can't be built here; the text says what is missing."""


def build(folder: Path) -> list[Path]:
    """Write the library, its header and the Fortran module into a folder; returns their paths.

    Raises BuildError naming what is missing.
    """
    _check_environment()
    import cffi

    header = (files("insitu.bindings") / HEADER).read_text()
    builder = cffi.FFI()
    builder.embedding_api(declarations(header))
    folders = [sysconfig.get_path("purelib"), *site.getsitepackages()]
    builder.embedding_init_code(START.format(folders=list(dict.fromkeys(folders))))
    where = str(sysconfig.get_config_var("LIBDIR"))
    builder.set_source(
        "_insitu_library", f'#include "{HEADER}"', extra_link_args=[f"-Wl,-rpath,{where}"], library_dirs=[where]
    )
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        Path(scratch, HEADER).write_text(header)
        try:
            made = Path(builder.compile(tmpdir=scratch, target=LIBRARY))
        except Exception as error:
            raise BuildError(f"the compiler failed: {error}") from error
        made.replace(folder / LIBRARY)
    for name in (HEADER, MODULE):
        (folder / name).write_text((files("insitu.bindings") / name).read_text())
    return [folder / name for name in (LIBRARY, HEADER, MODULE)]


def declarations(header: str) -> str:
    """The functions that a C header declares, without comments and what the preprocessor reads."""
    plain = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    plain = re.sub(r'#ifdef __cplusplus\n(extern "C" \{|\})\n#endif', "", plain)
    return "\n".join(line for line in plain.splitlines() if line.strip() and not line.startswith("#"))


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
