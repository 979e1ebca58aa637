"""Fields drawn along rays by C++ kernels: the images of `render`, without VTK."""

from catalogs.lazy import public_names

__all__, __getattr__, __dir__ = public_names(__name__, __file__)
