"""
Several fields
==============

Fields of one member are a mapping by name. Each appearance then says which of them it shows.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import insitu

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 24)], indexing="ij")
fields = {"density": np.exp(-4 * (x**2 + y**2 + z**2)), "speed": np.hypot(x, y) * np.exp(-4 * z**2)}


def appearance(field: str, low: float, high: float) -> insitu.VolumeRendering:
    colors, opacities = ((low, 0.2, 0.3, 0.8), (high, 0.9, 0.5, 0.1)), ((low, 0.0), (high, 0.8))
    function = insitu.TransferFunction(colors, opacities, opacity_unit_distance=0.3)
    return insitu.VolumeRendering(f"{field}-dvr", function, field=field)


path = Path(tempfile.mkdtemp()) / "flow.cdb"
plan = {
    "space": {"time": (0, 1)},
    "fields": {"density": "kg/m³", "speed": "m/s"},
    "appearances": [appearance("density", 0.1, 1.0), appearance("speed", 0.3, 1.2)],
    "views": insitu.ViewPlan(frequency=1, width=96, height=96),
}
insitu.render_member(fields, {}, time=0, catalog=path, spacing=(2 / 23,) * 3, origin=(-1,) * 3, **plan)
figure, axes = plt.subplots(1, 2, figsize=(6, 3))
catalog = insitu.Catalog.open(path)
for axis, name in zip(axes, catalog.appearance_names, strict=True):
    picture = catalog.image(catalog.members[0], name, 4, dtype="float32")
    axis.imshow(picture[..., :3] + 1 - picture[..., 3:])
    axis.set(title=name, xticks=(), yticks=())
