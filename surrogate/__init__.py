"""Deformable Gaussians fitted to a Cinema catalog: any view, any parameter, in milliseconds."""

from importlib.util import find_spec
from os.path import dirname

for _name in ("native", "catalogs"):
    if dirname(dirname(_origin := find_spec(_name).origin)) != dirname(dirname(__file__)):
        raise ImportError(
            f"{_origin} hides the package `{_name}` of gs-surrogate: rename it, or keep its folder from the path "
            "(python -P script.py)"
        )

from catalogs.lazy import public_names  # noqa: E402, once it is ours

__all__, __getattr__, __dir__ = public_names(__name__, __file__)
