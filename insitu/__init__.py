"""Rendering beside a running simulation: a field comes in, its pictures stay, the field may go.

`render_member` is the hook for a loop; `Session` holds a catalog open over many members; `run_ensemble` spreads
members over processes.  Their arguments are here as well: parameters, appearances and their families, viewpoints.
Names load on first use, so importing this package costs nothing.
"""

from importlib.util import find_spec
from os.path import dirname

for _name in ("catalogs", "native", "render"):
    if dirname(dirname(_origin := find_spec(_name).origin)) != dirname(dirname(__file__)):
        raise ImportError(
            f"{_origin} hides the package `{_name}` of gs-surrogate: rename it, or keep its folder from the path "
            "(python -P script.py)"
        )

from catalogs.lazy import public_names  # noqa: E402, once it is ours

__all__, __getattr__, __dir__ = public_names(__name__, __file__)
