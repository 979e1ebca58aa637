"""Rendering in another process while the simulation continues."""
