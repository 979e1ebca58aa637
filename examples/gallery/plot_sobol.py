"""
Which parameter matters, over all of them
=========================================

Sobol indices are shares of the variance of a number, or of a picture. A total index counts what a parameter does together with
others as well.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
import numpy as np
from blobs import CAMERA, make_run

from surrogate import Surrogate
from surrogate.answers.sobol import field_response, picture_response, sobol_indices

surrogate = Surrogate.load(make_run() / "surrogate")
responses = {"mean": field_response(surrogate, "mean"), "picture": picture_response(surrogate, CAMERA)}

figure, axes = plt.subplots(1, 2, figsize=(6, 3), sharey=True)
places = np.arange(len(surrogate.space))
for axis, (title, response) in zip(axes, responses.items(), strict=True):
    indices = sobol_indices(surrogate.space, response, samples=64)  # parameters even within their bounds
    axis.bar(places - 0.2, indices.first, 0.4, label="first")
    axis.bar(places + 0.2, indices.total, 0.4, yerr=indices.total_half, label="total")
    axis.set_xticks(places, surrogate.space.names)
    axis.set_title(title)
axes[0].legend()
