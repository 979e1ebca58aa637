"""
A page to send
==============

``surrogate export blobs -o blobs.html`` writes the explorer in one file. A browser opens it without a network or Python.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

from html import escape

import matplotlib.pyplot as plt
from blobs import CAMERA, make_run
from IPython.display import HTML

from surrogate import Surrogate
from surrogate.cli import main as command

run = make_run()
command(["export", str(run), "-o", str(run / "blobs.html")], standalone_mode=False)

# %%
# What the page draws, Python draws too.

plt.imshow(Surrogate.load(run / "surrogate").at(separation=0.8, width=0.3).render(CAMERA, background=(1, 1, 1)))
plt.axis("off")

# %%
# Any page can hold it in a frame. Drag to turn, and move the sliders.

page = (run / "blobs.html").read_text()
HTML(f'<div><iframe srcdoc="{escape(page)}" style="width: 100%; height: 600px"></iframe></div>')
