"""
Which parameters draw this picture
==================================

``invert`` finds the parameters of pictures, here of a stored one from a known camera. Validation members
calibrate its intervals.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
from blobs import make_run

from surrogate import invert
from surrogate.answers.targets import stored_target
from surrogate.explore.run import Run

run = Run.open(make_run())
member = next(member for member in run.catalog.members if member.split == "validation")
answer = invert(run.surrogate, [stored_target(run.catalog, member.name, 4)], run.catalog, run.folder)
for one in answer.parameters:
    print(f"{one.name}: {one.low:.3f} to {one.high:.3f}, truth {member.parameters[one.name]:.3f}")

stored = run.catalog.image(member, "blobs", 4, dtype="float32")
pictures = (
    stored[..., :3] + 1 - stored[..., 3:],
    run.surrogate.at(answer.values).render(member.cameras[4], background=(1, 1, 1)),
)
figure, axes = plt.subplots(1, 2, figsize=(6, 3))
for axis, picture, title in zip(axes, pictures, ("stored", "at the answer"), strict=True):
    axis.imshow(picture)
    axis.set_title(title)
    axis.axis("off")
