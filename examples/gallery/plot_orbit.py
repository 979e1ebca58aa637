"""
Cameras all around
==================

``orbit`` puts cameras on an icosphere around a sphere, evenly from all sides. Catalogs have 252 of them by default.
"""

import matplotlib.pyplot as plt
import numpy as np

from catalogs import TransferFunction, VolumeRendering, orbit
from render import render_views, to_grid

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 32)], indexing="ij")
field = np.exp(-8 * ((x - 0.5) ** 2 + y**2 + z**2)) + 0.6 * np.exp(-8 * (x**2 + (y - 0.5) ** 2 + (z + 0.4) ** 2))
grid = to_grid(field, spacing=(2 / 31,) * 3, origin=(-1,) * 3)
colors = ((0.1, 0.2, 0.3, 0.8), (0.6, 0.9, 0.8, 0.4), (1.0, 0.8, 0.1, 0.1))
appearance = VolumeRendering("blobs", TransferFunction(colors, ((0.1, 0), (1, 0.9)), opacity_unit_distance=0.2))

cameras = orbit((0, 0, 0), 1.0, width=64, height=64, frequency=1)  # 10 * frequency² + 2
figure, axes = plt.subplots(3, 4, figsize=(6, 4.5))
for axis, picture in zip(axes.flat, render_views(grid, appearance, cameras, float_output=True), strict=True):
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.axis("off")
