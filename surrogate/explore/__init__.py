"""Fly through a trained surrogate in a browser: any view, parameter, transfer function and isovalue, live."""
