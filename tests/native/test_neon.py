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

from catalogs.cameras import Camera
from surrogate.losses import image_loss_reference, structural_similarity
from surrogate.splatting import render_over
from surrogate.splatting.rendering import DILATION

COMPILER, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64"
SOURCES = ("kernels", "drawing", "bilinear", "loss", "parallel")
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
PROJECT = Path(__file__).resolve().parents[2]
COUNT, LATENT, BACKGROUND = 300, 16, (1.0, 0.5, 0.25)

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
    source, path = PROJECT / "native" / "src", tmp_path_factory.mktemp("neon") / "driver"
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
    latents, modes = random.normal(size=(COUNT, LATENT)), random.normal(size=(LATENT, 14))
    floats = [array.astype("<f4") for array in (*gaussians, gradient, target, latents, modes)]
    intrinsics = [camera.fx, camera.fy, camera.cx, camera.cy, 0.02, DILATION]
    view = np.concatenate([camera.rotation.ravel(), camera.world_to_camera[:3, 3], intrinsics]).astype("<f8")
    sizes = np.array([COUNT, camera.width, camera.height, threads, LATENT], "<i4")
    content = b"".join(array.tobytes() for array in (sizes, view, *floats))
    answer = subprocess.run([EMULATOR, str(program)], input=content, capture_output=True, check=True).stdout

    leaves = [torch.from_numpy(array).double().requires_grad_() for array in floats[:5]]
    picture = render_over(*leaves, camera, BACKGROUND, backend="reference")
    gradients = torch.autograd.grad((picture * torch.from_numpy(floats[5])).sum(), leaves)
    drawn, aim = picture.detach().float().double().requires_grad_(), torch.from_numpy(floats[6]).double()
    loss = image_loss_reference(drawn, aim)
    (by_picture,) = torch.autograd.grad(loss, drawn)
    values = [(drawn - aim).abs().mean().item(), structural_similarity(drawn, aim).mean().item()]
    moved = np.concatenate([array.reshape(COUNT, -1) for array in floats[:5]], axis=1) + latents @ modes
    rows = np.split(moved, np.cumsum([3, 3, 4, 1]), axis=1)
    expected = [picture.detach().numpy(), *(g.numpy() for g in gradients), np.array(values), by_picture.numpy(), *rows]

    got = np.split(np.frombuffer(answer, "<f4"), np.cumsum([array.size for array in expected])[:-1])
    for found, wanted in zip(got, expected, strict=True):
        assert np.abs(found - wanted.ravel()).max() < 1e-5 * np.abs(wanted).max()
