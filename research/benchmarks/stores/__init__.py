"""Catalogs: scale, the page, packed members, Cinema clients."""
