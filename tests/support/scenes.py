"""Scenes that tests write: what nearly all of them begin with, and from a text to a scene."""

from __future__ import annotations

from pathlib import Path

from catalogs.vocabulary.scene import Scene

SIMULATED = """
[source]
kind = "simulation"
simulation = "taylor_green"
"""
REYNOLDS = """
[[parameters]]
name = "Re"
low = 100.0
high = 200.0
"""


def scene(folder: Path, text: str) -> Scene:
    """The scene of a text, from a file in `folder`."""
    path = folder / "scene.toml"
    path.write_text(text)
    return Scene.load(path)
