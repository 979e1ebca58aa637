"""
The distance between samples
============================

Volumes are sampled along rays. ``choose_sample_distance`` finds the largest step whose pictures are good enough; catalogs do so
for their first member.
"""

import matplotlib.pyplot as plt
import numpy as np

from catalogs import TransferFunction, VolumeRendering, orbit
from render import choose_sample_distance, render_views, to_grid

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 32)], indexing="ij")
grid = to_grid(np.exp(-3 * (x**2 + y**2 + z**2)), spacing=(2 / 31,) * 3, origin=(-1,) * 3)
colors = ((0.3, 0.2, 0.3, 0.8), (1.0, 0.8, 0.1, 0.1))
thin = ((0.4, 0.0), (0.45, 0.8), (0.5, 0.0))  # a thin shell of values
appearance = VolumeRendering("shell", TransferFunction(colors, thin, opacity_unit_distance=0.1))
cameras = orbit((0, 0, 0), 1.0, width=96, height=96, frequency=1)

choice = choose_sample_distance(grid, appearance, cameras, target_decibels=50)
print(f"{choice.distance:.4f} between samples gives {choice.decibels:.1f} dB")

# %%
# Steps eight times as long miss parts of the shell.

figure, axes = plt.subplots(1, 2, figsize=(6, 3))
for axis, distance in zip(axes, (choice.distance, 8 * choice.distance), strict=True):
    (picture,) = render_views(grid, appearance, cameras[:1], sample_distance=distance, float_output=True)
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set_title(f"{distance:.3f}")
    axis.axis("off")
