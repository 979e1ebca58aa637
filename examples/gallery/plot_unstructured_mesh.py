"""
An unstructured mesh
====================

Data sets of pyvista and VTK are taken as they are. Others than regular grids are resampled, and a warning says how.
"""

import warnings

import matplotlib.pyplot as plt
import numpy as np
import pyvista

from catalogs import Camera, TransferFunction, VolumeRendering
from render import render_views, to_grid

points = np.random.default_rng(0).normal(size=(2500, 3))
points *= (np.linspace(0.05, 1, 2500) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]  # in a ball of radius 1
mesh = pyvista.PolyData(points).delaunay_3d()  # tetrahedra
mesh["height"] = mesh.points[:, 2]

with warnings.catch_warnings(record=True) as given:
    warnings.simplefilter("always")
    grid = to_grid(mesh, array="height", nan="transparent")
print(given[0].message if given else "not resampled")

# %%
# What lies outside the mesh is transparent.

colors = ((-1, 0.1, 0.2, 0.8), (0, 0.9, 0.9, 0.7), (1, 0.8, 0.1, 0.1))
appearance = VolumeRendering("height", TransferFunction(colors, ((-1, 0.6), (1, 0.6)), opacity_unit_distance=0.2))
camera = Camera.look_at((2.5, -3.0, 1.5), (0, 0, 0), vertical_fov_degrees=34, width=160, height=160)
(picture,) = render_views(grid, appearance, [camera], float_output=True)
plt.imshow(picture[..., :3] + 1 - picture[..., 3:])
plt.axis("off")
