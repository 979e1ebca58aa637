"""
Isosurfaces
===========

An ``Isosurface`` is where a field equals one value. It is lit by a lamp at the camera.
"""

import matplotlib.pyplot as plt
import numpy as np

from catalogs import Camera, Isosurface
from render import render_views, to_grid

z, y, x = np.meshgrid(*3 * [np.linspace(-1.2, 1.2, 40)], indexing="ij")
torus = np.sqrt((np.sqrt(x**2 + y**2) - 0.7) ** 2 + z**2)  # the distance from a circle
grid = to_grid(torus, spacing=(2.4 / 39,) * 3, origin=(-1.2,) * 3)
camera = Camera.look_at((2.5, -3.0, 2.5), (0, 0, 0), vertical_fov_degrees=32, width=128, height=128)

figure, axes = plt.subplots(1, 3, figsize=(6, 2.4))
for axis, isovalue in zip(axes, (0.1, 0.25, 0.4), strict=True):
    surface = Isosurface("torus", isovalue, color=(0.9, 0.6, 0.2))
    (picture,) = render_views(grid, surface, [camera], float_output=True, backend="cpu")
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set_title(f"{isovalue:g}")
    axis.axis("off")
