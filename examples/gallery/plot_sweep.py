"""
A sweep over a parameter
========================

``render`` draws many pictures at once: a list for a parameter, one value for the others. ``surrogate sweep RUN --over separation
-o film.mp4`` makes a film.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
from blobs import CAMERA, make_run

from surrogate import Surrogate

surrogate = Surrogate.load(make_run() / "surrogate")
separations = [0.6, 0.7, 0.8, 0.9, 1.0]
pictures = surrogate.render({"separation": separations, "width": 0.3}, CAMERA, background=(1, 1, 1))  # [5, H, W, 4]

figure, axes = plt.subplots(1, 5, figsize=(8, 2))
for axis, picture, separation in zip(axes, pictures, separations, strict=True):
    axis.imshow(picture)
    axis.set_title(f"{separation:g}")
    axis.axis("off")
