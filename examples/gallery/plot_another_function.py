"""
Another transfer function, after training
=========================================

The emulated field has values, no colours. So ``under`` draws it by any transfer function.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
from blobs import CAMERA, make_run

from catalogs import TransferFunction
from surrogate import Surrogate

surrogate = Surrogate.load(make_run() / "surrogate")
colors = ((0.1, 0.1, 0.5, 0.3), (1.0, 0.9, 0.9, 0.2))  # value, red, green, blue
opacities = ((0.2, 0.0), (0.25, 0.7), (0.3, 0.0), (0.8, 0.0), (0.9, 0.95))
shells = TransferFunction(colors, opacities, opacity_unit_distance=0.1)

figure, axes = plt.subplots(1, 2, figsize=(6, 3))
members = surrogate.at(separation=0.9, width=0.35), surrogate.under(shells, separation=0.9, width=0.35)
for axis, member, title in zip(axes, members, ("as trained", "two shells"), strict=True):
    axis.imshow(member.render(CAMERA, background=(1, 1, 1)))
    axis.set_title(title)
    axis.axis("off")
