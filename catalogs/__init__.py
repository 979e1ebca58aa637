"""The vocabulary and the store: cameras, appearances, parameter spaces, scenes, Cinema databases."""

from catalogs.lazy import public_names

__all__, __getattr__, __dir__ = public_names(__name__, __file__)
