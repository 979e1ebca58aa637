"""
Join catalogs
=============

Machines that render parts of an ensemble need no common disk. ``catalogs merge all.cdb part0.cdb part1.cdb`` joins the parts.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import insitu
from catalogs.tools.merge import merge

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 24)], indexing="ij")
colors, opacities = ((0.1, 0.2, 0.3, 0.8), (1.0, 0.9, 0.5, 0.1)), ((0.1, 0.0), (1.0, 0.9))
plan = {
    "space": {"length": (0.2, 0.8)},
    "appearances": insitu.VolumeRendering("dvr", insitu.TransferFunction(colors, opacities, opacity_unit_distance=0.3)),
    "views": insitu.ViewPlan(frequency=1, width=96, height=96),
    "sample_distance": 0.05,  # else each part chooses its own, and parts must be alike
}
folder = Path(tempfile.mkdtemp())
parts = [folder / "part0.cdb", folder / "part1.cdb"]
for part, lengths in zip(parts, ((0.2, 0.3, 0.4, 0.5), (0.55, 0.6, 0.7, 0.8)), strict=True):
    with insitu.Session(part, **plan) as session:
        for length in lengths:
            field = np.exp(-((x / length) ** 2) - 8 * (y**2 + z**2))
            session.render_member(field, {"length": length}, spacing=(2 / 23,) * 3, origin=(-1,) * 3)
print(merge(folder / "all.cdb", parts))

catalog = insitu.Catalog.open(folder / "all.cdb")
figure, axes = plt.subplots(1, 4, figsize=(8, 2.2))
for axis, member in zip(axes, catalog.members[::2], strict=True):
    picture = catalog.image(member, "dvr", 4, dtype="float32")
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set(title=f"{member.parameters['length']:g}", xticks=(), yticks=())
