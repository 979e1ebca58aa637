"""Images rendered by others, brought into a catalog."""

from catalogs.exchange.nerf import import_nerf
from catalogs.exchange.transforms import ExchangeError

__all__ = ["ExchangeError", "import_nerf"]
