"""
Two transfer functions of one field
===================================

A transfer function is fixed before the first member, in the field's own units. Where opacity begins decides what is in front.
"""

import matplotlib.pyplot as plt
import numpy as np

from catalogs import Camera, TransferFunction, VolumeRendering
from render import render_views, to_grid

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 32)], indexing="ij")
grid = to_grid(np.exp(-3 * (x**2 + y**2 + 2 * z**2)), spacing=(2 / 31,) * 3, origin=(-1,) * 3)
colors = ((0.1, 0.2, 0.3, 0.8), (0.5, 0.9, 0.9, 0.5), (1.0, 0.8, 0.1, 0.1))  # value, red, green, blue
haze = TransferFunction(colors, ((0.1, 0.0), (1.0, 0.9)), opacity_unit_distance=0.3)
shell = TransferFunction(
    colors, ((0.3, 0.0), (0.4, 0.5), (0.5, 0.0), (0.8, 0.0), (0.9, 0.9)), opacity_unit_distance=0.3
)
camera = Camera.look_at((2.5, -3.0, 1.5), (0, 0, 0), vertical_fov_degrees=30, width=128, height=128)

# %%
# The haze hides the core. The shell shows it, since values from 0.5 to 0.8 are transparent.

figure, axes = plt.subplots(2, 2, figsize=(6, 5), height_ratios=(1, 2))
values = np.linspace(0, 1, 200)
for name, function, (above, below) in zip(("haze", "shell"), (haze, shell), axes.T, strict=True):
    above.plot(values, function.opacities(values))
    above.set_title(name)
    (picture,) = render_views(grid, VolumeRendering(name, function), [camera], float_output=True)
    below.imshow(picture[..., :3] + 1 - picture[..., 3:])
    below.axis("off")
