"""
Values of cells
===============

Values that belong to cells are taken at the cells' centres. None is averaged with its neighbours.
"""

import matplotlib.pyplot as plt
import numpy as np
import pyvista

from catalogs import Camera, TransferFunction, VolumeRendering
from render import render_views, to_grid

mesh = pyvista.ImageData(dimensions=(25, 25, 25), spacing=(2 / 24,) * 3, origin=(-1,) * 3)
x, y, z = mesh.cell_centers().points.T
mesh.cell_data["pressure"] = np.exp(-4 * (x**2 + y**2)) * (1 + np.cos(4 * z))

grid = to_grid(mesh, array="pressure")
print(f"{mesh.dimensions} points make {grid.shape} samples, the first at {np.round(grid.origin, 3)}")

colors = ((0.2, 0.2, 0.3, 0.8), (1.0, 0.9, 0.9, 0.5), (2.0, 0.8, 0.1, 0.1))
appearance = VolumeRendering("pressure", TransferFunction(colors, ((0.2, 0), (2, 0.9)), opacity_unit_distance=0.2))
camera = Camera.look_at((2.5, -3.0, 1.5), (0, 0, 0), vertical_fov_degrees=34, width=160, height=160)
(picture,) = render_views(grid, appearance, [camera], float_output=True)
plt.imshow(picture[..., :3] + 1 - picture[..., 3:])
plt.axis("off")
