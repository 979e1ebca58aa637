"""Measurements of emulated fields."""
