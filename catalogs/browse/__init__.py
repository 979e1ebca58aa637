"""A catalog as one static page: a slider per parameter, the view by dragging; no server code, no network."""

from catalogs.browse.page import write_page
from catalogs.browse.server import serve

__all__ = ["serve", "write_page"]
