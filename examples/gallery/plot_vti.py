"""
A field for ParaView
====================

The emulated field at any parameters is saved as VTK image data, with its standard deviation. Here pyvista reads it back.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
import pyvista
from blobs import make_run

from surrogate import Surrogate

run = make_run()
Surrogate.load(run / "surrogate").at(separation=0.83, width=0.27).field().save(run / "field.vti")
data = pyvista.read(run / "field.vti")
print(data.dimensions, data.array_names)

# %%
# The middle plane of both arrays.

figure, axes = plt.subplots(1, 2, figsize=(6, 3))
for axis, name in zip(axes, data.array_names, strict=True):
    values = data[name].reshape(data.dimensions[::-1])  # [z, y, x]
    axis.imshow(values[12], origin="lower", extent=(-1, 1, -1, 1))
    axis.set(title=name, xlabel="x", ylabel="y")
