"""
A shaded volume
===============

``shaded=True`` lights a volume from the camera by the gradients of its field. Shapes are easier to see, and colours darker.
"""

import matplotlib.pyplot as plt
import numpy as np

from catalogs import Camera, TransferFunction, VolumeRendering
from render import render_views, to_grid

z, y, x = np.meshgrid(*3 * [np.linspace(-np.pi, np.pi, 40)], indexing="ij")
gyroid = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
grid = to_grid(gyroid, spacing=(2 * np.pi / 39,) * 3, origin=(-np.pi,) * 3)
function = TransferFunction(
    color_points=((0.5, 0.9, 0.7, 0.3), (1.5, 0.9, 0.3, 0.1)),
    opacity_points=((0.5, 0.0), (0.8, 0.95)),
    opacity_unit_distance=0.3,
)
camera = Camera.look_at((11, -14, 9), (0, 0, 0), vertical_fov_degrees=32, width=160, height=160)

figure, axes = plt.subplots(1, 2, figsize=(6, 3))
for axis, shaded in zip(axes, (False, True), strict=True):
    appearance = VolumeRendering("gyroid", function, shaded=shaded)
    (picture,) = render_views(grid, appearance, [camera], float_output=True)
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set_title("shaded" if shaded else "not shaded")
    axis.axis("off")
