"""
Read a catalog
==============

A catalog is a Cinema database: a table, and pictures in folders. ``Catalog`` reads both.

The run of these examples has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
from blobs import make_run

from catalogs import Catalog

catalog = Catalog.open(make_run() / "blobs.cdb")
print("\n".join((catalog.path / "data.csv").read_text().splitlines()[:3]))
member = catalog.members[0]
print(member)
coarse = member.coarse_fields()[""]
print(f"a coarse field of {coarse.values.shape} samples")

# %%
# One view of the first members.

figure, axes = plt.subplots(1, 4, figsize=(8, 2.2))
for axis, member in zip(axes, catalog.members, strict=False):
    picture = catalog.image(member, "blobs", 0, dtype="float32")
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set_title(", ".join(f"{value:.2g}" for value in member.parameters.values()))
    axis.axis("off")
