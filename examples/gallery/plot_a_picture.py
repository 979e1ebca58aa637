"""
A picture of a field
====================

``render_views`` draws a regular grid from any camera. A field is an array ``[z, y, x]``; a transfer function gives each of its
values a colour and an opacity.
"""

import matplotlib.pyplot as plt
import numpy as np

from catalogs import Camera, TransferFunction, VolumeRendering
from render import render_views, to_grid

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 48)], indexing="ij")
field = np.exp(-6 * ((x - 0.3) ** 2 + y**2 + z**2)) + np.exp(-9 * ((x + 0.4) ** 2 + y**2 + z**2))
warm = VolumeRendering(
    "warm",
    TransferFunction(
        color_points=((0.0, 0.1, 0.3, 0.8), (1.0, 0.9, 0.2, 0.1)),  # value, red, green, blue
        opacity_points=((0.1, 0.0), (1.0, 0.8)),
        opacity_unit_distance=0.2,
    ),
)
camera = Camera.look_at((2.5, -3.0, 1.5), (0.0, 0.0, 0.0), vertical_fov_degrees=35, width=256, height=256)

# %%
# Colours are premultiplied: add the background times what the picture leaves of it.

grid = to_grid(field, spacing=(2 / 47,) * 3, origin=(-1.0,) * 3)
(picture,) = render_views(grid, warm, [camera], float_output=True)  # [256, 256, 4] premultiplied RGBA
plt.imshow(picture[..., :3] + 1.0 - picture[..., 3:])
plt.axis("off")
