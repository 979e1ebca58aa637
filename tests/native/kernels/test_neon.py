"""The 4-wide kernels on ARM: cross-compiled, run on an emulated processor, and held against the float64 twins.

On an ARM machine the other tests do this natively; here Debian's `g++-aarch64-linux-gnu` and `qemu-user` stand in for one.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from surrogate.appearance.averages import Nodes
from surrogate.appearance.transferred import AverageTable, apply_reference
from surrogate.deformation.transfer import Transfer
from surrogate.gaussians import Gaussians
from surrogate.splatting import Constants, Primitives, draw_over
from surrogate.training.losses import image_loss_reference, structural_similarity

COMPILER, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64"
SOURCES = ("averages", "kernels", "deformation", "drawing", "loss", "parallel")
FLAGS = [
    "-std=c++17",
    "-O3",
    "-static",
    "-fno-tree-loop-vectorize",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=fast",
    "-Wno-psabi",
    "-DGS_KERNELS=kernels_baseline",
    "-DGS_LABEL=baseline",
    "-DGS_WIDTH=4",
]
PROJECT = Path(__file__).resolve().parents[3]
COUNT, LATENT, VALUES, BACKGROUND = 300, 16, 33, (1.0, 0.5, 0.25)
PALETTE = ((0.1, 0.0, 0.3), (0.8, 0.9, 0.5))

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        platform.machine() == "aarch64", reason="this is an ARM machine: every other test runs its kernels"
    ),
    pytest.mark.skipif(
        not (shutil.which(COMPILER) and shutil.which(EMULATOR)),
        reason="no cross-compiler or emulator: apt-get install g++-aarch64-linux-gnu qemu-user",
    ),
]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source, path = PROJECT / "native" / "kernels" / "src", tmp_path_factory.mktemp("neon") / "driver"
    files = [*(source / f"{name}.cpp" for name in SOURCES), Path(__file__).with_name("neon_driver.cpp")]
    subprocess.run([COMPILER, *FLAGS, f"-I{source}", *map(str, files), "-o", str(path), "-pthread"], check=True)
    return path


@pytest.mark.parametrize("threads", [1, 2])
def test_an_arm_processor_draws_and_differentiates_the_same(program: Path, threads: int) -> None:
    random = np.random.default_rng(0)
    camera = Camera.look_at((3, 0.6, 0.4), (0, 0, 0), vertical_fov_degrees=35.0, width=70, height=50)
    gaussians = [
        random.uniform(-0.6, 0.6, (COUNT, 3)),
        random.uniform(0.02, 0.2, (COUNT, 3)),
        random.normal(size=(COUNT, 4)),
        random.uniform(0.02, 0.9, COUNT),
        random.uniform(0.0, 1.0, (COUNT, 3)),
    ]
    gradient, target = random.normal(size=(50, 70, 4)), random.uniform(size=(50, 70, 4))
    factors = [random.normal(size=shape) for columns in (14, 23) for shape in ((COUNT, LATENT), (LATENT, columns))]
    changes = random.normal(0, 0.3, (VALUES, 4)) + np.array([0.2, 0, 0, 0])  # mostly thicker: no digits are lost
    asked = [random.normal(0, 0.3, (COUNT, VALUES)), changes, random.normal(size=COUNT)]
    upstream = [random.normal(size=COUNT), random.normal(size=(COUNT, 3))]
    carried = np.stack([random.uniform(0, 1, COUNT), random.uniform(-3, -1, COUNT)], axis=1)
    floats = [a.astype("<f4") for a in (*gaussians, gradient, target, *factors, *asked, *upstream, carried)]
    intrinsics = [camera.fx, camera.fy, camera.cx, camera.cy, Constants.near, Constants.dilation]
    view = np.concatenate([camera.rotation.ravel(), camera.world_to_camera[:3, 3], intrinsics]).astype("<f8")
    sizes = np.array([COUNT, camera.width, camera.height, threads, LATENT, VALUES], "<i4")
    content = b"".join(array.tobytes() for array in (sizes, view, *floats))
    answer = subprocess.run([EMULATOR, str(program)], input=content, capture_output=True, check=True).stdout

    leaves = [torch.from_numpy(array).double().requires_grad_() for array in floats[:5]]
    picture = draw_over(Primitives(*leaves), camera, BACKGROUND, Constants(), backend="reference")
    gradients = torch.autograd.grad((picture * torch.from_numpy(floats[5])).sum(), leaves)
    drawn, aim = picture.detach().float().double().requires_grad_(), torch.from_numpy(floats[6]).double()
    loss = image_loss_reference(drawn, aim)
    (by_picture,) = torch.autograd.grad(loss, drawn)
    values = [(drawn - aim).abs().mean().item(), structural_similarity(drawn, aim).mean().item()]
    moved = np.pad(np.concatenate([array.reshape(COUNT, -1) for array in floats[:5]], axis=1), ((0, 0), (0, 9)))
    moved = moved + np.pad(factors[0] @ factors[1], ((0, 0), (0, 9))) + factors[2] @ factors[3]
    rows = np.split(moved, np.cumsum([3, 3, 4, 1]), axis=1)
    changed = definition_of_transfer(*(torch.from_numpy(array).double() for array in (*floats[11:16], floats[4])))
    pictures = [picture.detach().numpy(), *(g.numpy() for g in gradients), np.array(values), by_picture.numpy()]
    averaged = definition_of_averages(*(torch.from_numpy(floats[k]).double() for k in (13, 16, 14, 15)))
    expected = [*pictures, *rows, *changed, *averaged]

    got = np.split(np.frombuffer(answer, "<f4"), np.cumsum([array.size for array in expected])[:-1])
    for found, wanted in zip(got, expected, strict=True):
        assert np.abs(found - wanted.ravel()).max() < 1e-5 * np.abs(wanted).max()


def definition_of_averages(
    logits: Tensor, carried: Tensor, by_logits: Tensor, by_colors: Tensor
) -> list[NDArray[np.float64]]:
    """New logits and colours under the function of the driver, and the gradients by logits and carried values."""
    nodes = Nodes(np.array([0.2, 0.8]), np.array([[0.5, 0.1, 0.2, 0.3], [0.1, 0.08, 0.02, 0.05]]))
    leaves = logits.requires_grad_(), carried.requires_grad_()
    shown, colors = apply_reference(AverageTable.of(nodes), *leaves)
    by = torch.autograd.grad((shown * by_logits).sum() + (colors * by_colors).sum(), leaves)
    return [tensor.detach().numpy() for tensor in (shown, colors, *by)]


def definition_of_transfer(
    weights: Tensor, changes: Tensor, logits: Tensor, by_logits: Tensor, by_colors: Tensor, colors: Tensor
) -> list[NDArray[np.float64]]:
    """New logits and colours, and the gradient by the weights."""
    still = torch.zeros(COUNT, 3, dtype=torch.float64)
    shown = Gaussians(still, still, torch.zeros(COUNT, 4, dtype=torch.float64), logits, colors)
    found = Transfer(changes.numpy(), PALETTE).offsets(shown, weights.requires_grad_()).applied_to(shown)
    loss = (found.opacity_logits * by_logits).sum() + (found.colors * by_colors).sum()
    (by_weights,) = torch.autograd.grad(loss, weights)
    return [tensor.detach().numpy() for tensor in (found.opacity_logits, found.colors, by_weights)]
