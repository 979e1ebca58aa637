"""A catalog as one static page: a slider per parameter, the view by dragging; no server code, no network."""

from catalogs.browse.page import page_of, write_page
from catalogs.browse.server import CatalogServer, serve

__all__ = ["CatalogServer", "page_of", "serve", "write_page"]
