"""Import of images rendered by other programs, and export for them."""

from catalogs.exchange.export import export
from catalogs.exchange.nerf import import_nerf
from catalogs.exchange.records import ExchangeError

__all__ = ["ExchangeError", "export", "import_nerf"]
