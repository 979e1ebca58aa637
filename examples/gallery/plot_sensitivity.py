"""
The change of a picture by each parameter
=========================================

``sensitivity`` is the change of each pixel over the range of each parameter. ``surrogate ask matters`` draws the same.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
import numpy as np
from blobs import CAMERA, make_run

from surrogate import Surrogate
from surrogate.answers.sensitivity import sensitivity

surrogate = Surrogate.load(make_run() / "surrogate")
answer = sensitivity(surrogate, {"separation": 0.8, "width": 0.3}, CAMERA)

figure, axes = plt.subplots(1, 3, figsize=(7, 2.6))
axes[0].imshow(answer.picture)
for axis, name, change in zip(axes[1:], surrogate.space.names, answer.maps, strict=True):
    axis.imshow(np.abs(change).mean(axis=-1), cmap="magma")  # [H, W]
    axis.set_title(name)
for axis in axes:
    axis.axis("off")
