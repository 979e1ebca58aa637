"""
A parameter over powers of ten
==============================

With the scale "log" a parameter is learnt, and moved by the page's slider, in its logarithm. Here a blob spreads by diffusion.
"""

import tempfile
from html import escape
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import HTML

import insitu
from surrogate import TrainingSettings, train
from surrogate.cli import main as command

squares = sum(axis**2 for axis in np.meshgrid(*3 * [np.linspace(-1, 1, 24)]))
colors, opacities = ((0.1, 0.2, 0.3, 0.8), (1.0, 0.9, 0.5, 0.1)), ((0.1, 0.0), (1.0, 0.9))
heat = insitu.VolumeRendering("heat", insitu.TransferFunction(colors, opacities, opacity_unit_distance=0.3))
space = [insitu.Parameter("diffusivity", 1e-3, 1e-1, "m²/s", "log")]
path, views = Path(tempfile.mkdtemp()) / "heat.cdb", insitu.ViewPlan(frequency=1, width=64, height=64)
place = {"spacing": (2 / 23,) * 3, "origin": (-1,) * 3}
with insitu.Session(path, space=space, appearances=heat, views=views) as session:
    for value in np.geomspace(1e-3, 1e-1, 8):
        session.render_member(np.exp(-squares / (0.1 + 4 * value)), {"diffusivity": value}, **place)
catalog, model, page = insitu.Catalog.open(path), path.with_name("heat"), path.with_name("heat.html")
surrogate = train(TrainingSettings(), catalog, model, only_field=True)
figure, axes = plt.subplots(1, 3, figsize=(7, 2.6))
for axis, value in zip(axes, (2e-3, 2e-2, 9e-2), strict=True):
    axis.imshow(surrogate.at(diffusivity=value).render(catalog.plan.cameras[4], background=(1, 1, 1)))
    axis.set(title=f"{value:g} m²/s", xticks=(), yticks=())

# %%
# In a shell: ``surrogate export heat -o heat.html``.
command(["export", str(model), "-o", str(page)], standalone_mode=False)
HTML(f'<div><iframe srcdoc="{escape(page.read_text())}" style="width: 100%; height: 600px"></iframe></div>')
