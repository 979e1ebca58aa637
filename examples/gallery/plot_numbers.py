"""
Numbers of a field
==================

Emulated fields have values with standard deviations: at places, along lines, over boxes.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
import numpy as np
from blobs import make_run

from surrogate import Surrogate

surrogate = Surrogate.load(make_run() / "surrogate")
field = surrogate.at(separation=0.83, width=0.27).field()
numbers = field.statistics(box=((-1, -1, -1), (0, 1, 1)), level=0.5)
print("mean", numbers.mean, "greatest", numbers.maximum, "share above 0.5", numbers.share_above)

# %%
# A profile through both blobs, and the histogram of all samples.

figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3), layout="tight")
profile = field.profile((-1, 0, 0), (1, 0, 0))
left.plot(profile.places[:, 0], profile.values)
left.set_xlabel("x")
histogram = field.histogram(np.linspace(0.1, 1.1, 11))
right.stairs(histogram.shares, histogram.edges, fill=True)
right.set_xlabel("value")
