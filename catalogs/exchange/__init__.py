"""Images rendered by others, brought into a catalog; and a catalog's images for other programs."""

from catalogs.exchange.export import export
from catalogs.exchange.nerf import import_nerf
from catalogs.exchange.transforms import ExchangeError

__all__ = ["ExchangeError", "export", "import_nerf"]
