"""Say in one sentence which system packages are missing, before anything is built or crashes (no dependencies)."""

from __future__ import annotations

import ctypes.util
import importlib.util
import shutil
import sys

PACKAGES = {
    "a C++ compiler": "g++",
    "make": "make",
    "Python's venv module": "python3-venv",
    "Python's headers": "python3-dev",
    "the EGL library": "libegl1",
    "the OpenGL library": "libgl1",
    "Mesa's software renderer": "libgl1-mesa-dri",
    "the X11 library": "libx11-6",
}


def missing() -> list[str]:
    """The entries of `PACKAGES` that this machine lacks."""
    import sysconfig
    from pathlib import Path

    headers = Path(sysconfig.get_paths()["include"]) / "Python.h"
    drivers = [Path(root) for root in ("/usr/lib", "/usr/lib64", "/usr/local/lib") if Path(root).is_dir()]
    present = {
        "a C++ compiler": any(shutil.which(name) for name in ("c++", "g++", "clang++")),
        "make": shutil.which("make"),
        "Python's venv module": importlib.util.find_spec("ensurepip"),
        "Python's headers": headers.is_file(),
    }
    if sys.platform.startswith("linux"):
        present |= {
            "the EGL library": ctypes.util.find_library("EGL"),
            "the OpenGL library": ctypes.util.find_library("GL"),
            "Mesa's software renderer": any(
                next(root.glob(pattern), None)
                for root in drivers
                for pattern in ("*/dri/swrast_dri.so", "dri/swrast_dri.so", "*/libgallium*.so*", "libgallium*.so*")
            ),
            "the X11 library": ctypes.util.find_library("X11"),
        }
    return [name for name, found in present.items() if not found]


def main() -> int:
    if sys.version_info < (3, 11):  # noqa: UP036
        print(
            f"Python 3.11 or newer is needed, this is {sys.version.split()[0]}: set PYTHON=python3.11", file=sys.stderr
        )
        return 1
    lacking = missing()
    if lacking:
        print(
            f"Missing: {', '.join(lacking)}.  On Debian or Ubuntu: "
            f"sudo apt-get install {' '.join(PACKAGES[name] for name in lacking)}",
            file=sys.stderr,
        )
    return 1 if lacking else 0


if __name__ == "__main__":
    sys.exit(main())
