"""
Gaussians, as glTF for other viewers
====================================

Gaussians are fitted to the pictures alone. Here they are few and hardly trained: real ones take minutes.

The catalog has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

from html import escape

import matplotlib.pyplot as plt
from blobs import CAMERA, make_run
from IPython.display import HTML

from catalogs import Catalog
from surrogate import TrainingSettings, train
from surrogate.cli import main as command

catalog = Catalog.open(make_run() / "blobs.cdb")
settings = TrainingSettings(gaussians=200, canonical_steps=100, deformation_steps=300, validation_interval=0)
model = make_run() / "gaussians"
surrogate = train(settings, catalog, model).using("gaussians")

figure, axes = plt.subplots(1, 3, figsize=(7, 2.6))
for axis, separation in zip(axes, (0.6, 0.8, 1.0), strict=True):
    axis.imshow(surrogate.at(separation=separation, width=0.3).render(CAMERA, background=(1, 1, 1)))
    axis.set(title=f"{separation:g}", xticks=(), yticks=())

# %%
# In a shell: ``surrogate export gaussians -p separation=0.8 -o state.glb --refit 0``, and ``-o page.html``.

glb, page = model.with_suffix(".glb"), model.with_suffix(".html")
command(["export", str(model), "-p", "separation=0.8", "-o", str(glb), "--refit", "0"], standalone_mode=False)
command(["export", str(model), "-o", str(page), "--field-modes", "0"], standalone_mode=False)
print(f"{len(surrogate.gaussians)} Gaussians, {glb.stat().st_size:,} bytes, {glb.read_bytes()[:4]!r}")
HTML(f'<div><iframe srcdoc="{escape(page.read_text())}" style="width: 100%; height: 600px"></iframe></div>')
