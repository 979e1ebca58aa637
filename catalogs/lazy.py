"""Public names of a package that load when first used, so that importing the package costs nothing.

The stub `__init__.pyi` beside the package is the table of its names, for type checkers and at run time.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from catalogs.extras import remedy

# The extra that brings the dependencies of each package, and one of them, which may be needed later than at import.
NEEDED = {"insitu": ("insitu", "vtkmodules"), "render": ("insitu", "vtkmodules"), "surrogate": ("surrogate", "torch")}


def public_names(package: str, path: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """`__all__`, `__getattr__` and `__dir__` of the package whose `__init__.py` lies at `path`.

    Each line `from MODULE import NAME as NAME` of its stub gives one name.  `__version__` is the distribution's.
    Loading one raises ModuleNotFoundError naming the extra that brings a missing dependency.
    """
    with open(f"{path}i", encoding="utf-8") as stub:
        lines = [line.split() for line in stub if line.startswith("from ")]
    homes = {words[-1]: words[1] for words in lines if "as" in words}

    def load(name: str) -> Any:
        if name == "__version__":
            return import_module("catalogs.version").version()
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}; it has {', '.join(homes)}")
        extra, needed = NEEDED.get(homes[name].partition(".")[0], ("", ""))
        try:
            value = getattr(import_module(homes[name]), name)
            if needed and find_spec(needed) is None:
                raise ModuleNotFoundError(name=needed)
        except ModuleNotFoundError as error:
            extra = "explore" if ".explore." in homes[name] else extra
            raise ModuleNotFoundError(remedy(error, f"{package}.{name}", extra), name=error.name) from error
        return value

    return list(homes), load, lambda: [*homes, "__version__"]
