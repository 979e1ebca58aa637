"""
Slices and boxes
================

What is drawn by the emulated field can be cut: ``within`` leaves a box, ``slice`` one plane.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
from blobs import CAMERA, make_run

from surrogate import Surrogate

member = Surrogate.load(make_run() / "surrogate").using("field").at(separation=0.8, width=0.38)
cuts = {
    "all": member,
    "y > 0": member.within((-1, 0, -1), (1, 1, 1)),
    "y = 0": member.slice("y", 0.0),
}
figure, axes = plt.subplots(1, 3, figsize=(7, 2.6))
for axis, (title, cut) in zip(axes, cuts.items(), strict=True):
    axis.imshow(cut.render(CAMERA, background=(1, 1, 1)))
    axis.set_title(title)
    axis.axis("off")
