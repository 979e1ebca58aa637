"""Shared by the pages of this project: access to their servers, styles, vectors, elements."""

from __future__ import annotations

from pathlib import Path

ASSETS = Path(__file__).parent  # the folder of its styles and scripts, ES modules
