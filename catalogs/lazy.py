"""Public names of a package that load when first used, so that importing the package costs nothing.

The stub `__init__.pyi` beside the package is the table of its names, for type checkers and at run time.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import click

EXTRAS = {"insitu": "insitu", "render": "insitu", "surrogate": "surrogate"}  # what brings their dependencies


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
        try:
            return getattr(import_module(homes[name]), name)
        except ModuleNotFoundError as error:
            extra = "explore" if ".explore." in homes[name] else EXTRAS.get(package, "all")
            remedy = f"{package}.{name} needs the package {error.name}: pip install 'gs-surrogate[{extra}]'"
            raise ModuleNotFoundError(remedy, name=error.name) from error

    return list(homes), load, lambda: [*homes, "__version__"]


def with_remedy(command: click.Command, extra: str) -> click.Command:
    """The same command, which reports a missing package in one sentence that names the extra."""
    import click

    run = command.callback
    assert run is not None

    @wraps(run)
    def reported(*arguments: Any, **options: Any) -> Any:
        try:
            return run(*arguments, **options)
        except ModuleNotFoundError as error:
            remedy = f"`{command.name}` needs the package {error.name}: pip install 'gs-surrogate[{extra}]'"
            raise click.ClickException(remedy) from error

    command.callback = reported
    return command
