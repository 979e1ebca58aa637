"""
Gradients by parameters
=======================

``differentiable`` is a module of torch. So an optimizer can follow a picture to its parameters.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
import torch
from blobs import CAMERA, make_run

from surrogate import Surrogate

surrogate = Surrogate.load(make_run() / "surrogate")
model = surrogate.differentiable().requires_grad_(False)  # gradients by the arguments alone
camera = CAMERA.resized(48, 48)
target = model(torch.tensor([0.9, 0.25]), camera)
parameters = torch.tensor([0.7, 0.35], requires_grad=True)  # in the order and units of surrogate.space
optimizer = torch.optim.Adam([parameters], lr=0.01)
path = []
for _ in range(60):
    optimizer.zero_grad()
    loss = (model(parameters, camera) - target).square().mean()
    loss.backward()
    path.append(parameters.tolist())
    optimizer.step()

plt.figure(figsize=(5, 3.5), layout="tight")
plt.plot(*zip(*path, strict=True), ".-")
plt.plot(0.9, 0.25, "r*", markersize=14)
plt.xlabel(surrogate.space.names[0])
plt.ylabel(surrogate.space.names[1])
