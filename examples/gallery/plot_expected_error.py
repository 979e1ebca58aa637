"""
The error to expect
===================

``Doubt`` says how far off a picture may be. Members that were not learnt from calibrate its interval; where predictions differ,
pixels are in doubt. ``surrogate ask sure`` draws the same.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
from blobs import make_run

from surrogate.answers.doubt import Doubt
from surrogate.answers.maps import error_map
from surrogate.explore.run import Run

run = Run.open(make_run())
doubt = Doubt.of(run.surrogate, run.catalog, run.folder)
parameters, camera = {"separation": 0.83, "width": 0.27}, run.catalog.plan.cameras[4]
print(doubt.interval(parameters, camera).sentence)

# %%
# The map ranks pixels; it is not calibrated.

figure, axes = plt.subplots(1, 2, figsize=(6, 3))
axes[0].imshow(run.surrogate.at(parameters).render(camera, background=(1, 1, 1)))
axes[1].imshow(error_map(doubt, parameters, camera), cmap="magma")  # [H, W]
for axis, title in zip(axes, ("picture", "doubt"), strict=True):
    axis.set_title(title)
    axis.axis("off")
