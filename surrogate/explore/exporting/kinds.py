"""Kinds of exports, their files, and their default lengths.

Nothing heavy is imported here, so that the commands' help can name it.
"""

from __future__ import annotations

KINDS = {  # the ending of a file and its media type, by the kind of export
    "png": ("png", "image/png"),
    "exr": ("exr", "image/x-exr"),
    "ply": ("ply", "application/octet-stream"),
    "glb": ("glb", "model/gltf-binary"),
    "spz": ("spz", "application/octet-stream"),
    "vti": ("vti", "application/xml"),
    "html": ("html", "text/html"),
    "python": ("py", "text/x-python"),
    "comparison": ("png", "image/png"),
    "sheet": ("png", "image/png"),
    "gif": ("gif", "image/gif"),
    "mp4": ("mp4", "video/mp4"),
}
SITE = "site"  # the ending of a folder for a web host
GAUSSIAN_KINDS = ("ply", "glb", "spz")
REFIT_STEPS = 3000  # by which Gaussians are fitted for other viewers
SHEET_STEPS, ROW_STEPS = 8, 5  # pictures of a strip; rows of a grid, and its columns
FILM_STEPS = 49  # both ends, the middle, and equal steps between; there and back lasts 8 s
FRAMES_PER_SECOND = 12.0
