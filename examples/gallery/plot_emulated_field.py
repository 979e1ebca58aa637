"""
A picture that was never simulated
==================================

``surrogate train blobs.cdb --model field`` takes seconds. It learns the members' coarse fields, and draws them at any parameters.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it. Its members have separations from 0.6 to 1.
"""

import matplotlib.pyplot as plt
from blobs import APPEARANCE, CAMERA, make_run, simulate

from render import render_views, to_grid
from surrogate import Surrogate
from surrogate.evaluation.metrics import psnr

surrogate = Surrogate.load(make_run() / "surrogate")
print(surrogate)
predicted = surrogate.at(separation=0.83, width=0.27).render(CAMERA)

# %%
# Simulate the same, to compare. PSNR is that of the whole picture.

grid = to_grid(simulate(0.83, 0.27), spacing=(2 / 23,) * 3, origin=(-1,) * 3)
(truth,) = render_views(grid, APPEARANCE, [CAMERA], float_output=True)

figure, axes = plt.subplots(1, 2, figsize=(6, 3))
titles = "simulated", f"predicted, {psnr(truth, predicted):.0f} dB"
for axis, picture, title in zip(axes, (truth, predicted), titles, strict=True):
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set_title(title)
    axis.axis("off")
