"""
Render in a simulation's loop
=============================

The session renders each field that it gets. The loop may then forget the field.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import insitu
from catalogs import Catalog

field = np.random.default_rng(0).random((24, 24, 24))
colors, opacities = ((0.45, 0.2, 0.3, 0.8), (0.55, 0.9, 0.5, 0.1)), ((0.5, 0.0), (0.6, 0.9))
plan = {
    "space": {"time": (0, 30)},
    "appearances": insitu.VolumeRendering("heat", insitu.TransferFunction(colors, opacities, opacity_unit_distance=2)),
    "views": insitu.ViewPlan(frequency=1, width=96, height=96),
}
path = Path(tempfile.mkdtemp()) / "heat.cdb"
with insitu.Session(path, **plan) as session:
    for step in range(31):
        if step % 10 == 0:
            session.render_member(field, {}, time=step, spacing=(1, 1, 1))
        field += sum(0.1 * (np.roll(field, s, axis) - field) for s in (-1, 1) for axis in range(3))  # the "simulation"

catalog = Catalog.open(path)
figure, axes = plt.subplots(1, 4, figsize=(8, 2))
for axis, member in zip(axes, catalog.members, strict=True):
    picture = catalog.image(member, "heat", 4, dtype="float32")
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set_title(f"time {member.parameters['time']:g}")
    axis.axis("off")
