"""
A field with holes
==================

NaN and infinity are refused, since they are mostly mistakes. ``nan="transparent"`` leaves out what has no value, such as land.
"""

import matplotlib.pyplot as plt
import numpy as np

from catalogs import Camera, TransferFunction, VolumeRendering
from render import render_views, to_grid

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 32)], indexing="ij")
temperature = 15 + 10 * x
island = (x + 0.2) ** 2 + y**2 < 0.3 * (1.2 - z)
temperature[island] = np.nan
temperature[z > 0.4] = np.nan
try:
    to_grid(temperature)
except ValueError as error:
    print(error)

# %%
# Each cell of the grid with such a corner is transparent.

grid = to_grid(temperature, spacing=(2 / 31,) * 3, origin=(-1,) * 3, nan="transparent")
colors = ((5, 0.1, 0.2, 0.8), (15, 0.9, 0.9, 0.7), (25, 0.8, 0.1, 0.1))
water = VolumeRendering("water", TransferFunction(colors, ((5, 0.5), (25, 0.9)), opacity_unit_distance=0.3))
camera = Camera.look_at((2.0, -3.0, 3.0), (0, 0, -0.2), vertical_fov_degrees=34, width=160, height=160)
(picture,) = render_views(grid, water, [camera], float_output=True)
plt.imshow(picture[..., :3] + 1 - picture[..., 3:])
plt.axis("off")
