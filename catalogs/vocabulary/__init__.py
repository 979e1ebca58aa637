"""Cameras, appearances, parameters, variations and scenes: the terms that all packages share."""
