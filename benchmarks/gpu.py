"""Time drawing, a change of parameters and a training step on a GPU, beside their errors, and write docs/gpu.md.

    python -m benchmarks.gpu [--device cpu] [--quick] [--output DIRECTORY]

A few minutes, most of them of the float64 twin on the CPU; the data are made here.  `--device cpu` tries the command where no
GPU is, and writes to runs/bench/.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch

from benchmarks.page import DOCS, PROJECT, commit, fill, table
from benchmarks.splatting.drawing import ERROR_HEADER, measure
from benchmarks.splatting.twin import ask, patches
from benchmarks.splatting.workloads import FIXED, OTHERS, Workload
from benchmarks.timing import Measured, digits, measured
from catalogs import durable
from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.gaussians import Gaussians
from surrogate.provenance import machine
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.splatting import Constants, Primitives
from surrogate.splatting.device import chosen
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.data import Example, TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.stages import simulation_stage

PAGE = "gpu.md"
LARGE = FIXED.at_size(512).with_count(160_000)
ASKED = {"a view change": 1.0, "a parameter change": 2.0}  # ms, 160k Gaussians at 512²
SETTINGS = TrainingSettings(relocation_interval=0)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu", description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--device", default="cuda", choices=["cuda", "cpu"])
    parser.add_argument("--quick", action="store_true", help="small scenes, for a moment")
    parser.add_argument("--output", type=Path, help="folder of the page; default docs, or runs/bench without a GPU")
    arguments = parser.parse_args()
    try:
        device = chosen(arguments.device)
    except RuntimeError as error:
        sys.exit(str(error))
    official = device.type == "cuda" and not arguments.quick
    output = arguments.output or (DOCS if official else PROJECT / "runs" / "bench")
    output.mkdir(parents=True, exist_ok=True)
    if output != DOCS:
        durable.replace(output / PAGE, (DOCS / PAGE).read_bytes())
    say = partial(_say, time.perf_counter())
    seconds = 0.2 if arguments.quick else 2.0
    with one_torch_thread():
        for part, body in (
            ("explore", explore(device, arguments.quick, seconds, say)),
            ("draw", drawing(device, arguments.quick, seconds, say)),
            ("train", training(device, arguments.quick, seconds, say)),
        ):
            fill(output / PAGE, part, f"{body.rstrip()}\n\n<sub>{provenance(device)}</sub>")
    say(str(output / PAGE))


def explore(device: torch.device, quick: bool, seconds: float, say: Callable[[str], None]) -> str:
    """What a change of the view and of the parameters take, as a user sees it: with the picture in main memory."""
    workload = _sized(LARGE, quick)
    gaussians, deformation = _model(workload, device)
    camera, rasterizer, places = workload.camera(), Rasterizer(), [torch.tensor([0.01 * i]) for i in range(100)]
    turn = iter(range(10**9))

    def look(seen: Gaussians) -> torch.Tensor:
        with torch.no_grad():
            return rasterizer.draw_over(seen, camera, (1.0, 1.0, 1.0)).cpu()

    say(f"exploring {workload.title}")
    calls = {
        "a view change": lambda: look(gaussians),
        "a parameter change": lambda: look(_at(deformation, gaussians, places[next(turn) % len(places)])),
    }
    rows = []
    for name, call in calls.items():
        taken = measured(call, seconds, most=1000)
        rows.append([name, str(taken), f"{ASKED[name]:g}", "yes" if taken.median <= ASKED[name] else "no"])
    return f"{workload.title}; the picture is in main memory when the clock stops.\n\n" + table(
        ["", "ms", "asked for, ms", "reached"], rows
    )


def drawing(device: torch.device, quick: bool, seconds: float, say: Callable[[str], None]) -> str:
    """Forward and backward, and their errors against the float64 twin."""
    rows = []
    for workload in [FIXED, *OTHERS, LARGE][: 2 if quick else None]:
        workload = _sized(workload, quick)
        say(workload.title)
        scene, camera, constants = workload.scene(), workload.camera(), Constants()
        twin = ask(scene, camera, constants, patches(camera.width, camera.height, 8 if quick else 48))
        moved = Primitives(*(tensor.to(device) for tensor in scene))
        drawn = measure(moved, camera, constants, twin, seconds)
        times = [str(taken) for taken in (drawn.forward, drawn.backward, drawn.both)]
        rows.append([workload.title, *times, *drawn.error_cells()])
    return table(["scene", "forward, ms", "backward, ms", "both, ms", *ERROR_HEADER], rows)


def training(device: torch.device, quick: bool, seconds: float, say: Callable[[str], None]) -> str:
    """Whole steps of stage 2: deform, draw, compare, differentiate, Adam."""
    rows = []
    for workload in (FIXED, LARGE):
        workload = _sized(workload, quick)
        say(f"training, {workload.title}")
        gaussians, deformation = _model(workload, device)
        with torch.no_grad():
            drawn = Rasterizer.of(SETTINGS).draw_over(gaussians, workload.camera(), (1.0, 1.0, 1.0))
        pixels = drawn[..., :3].clamp(0, 1).mul(255).round().to(torch.uint8).cpu().contiguous().numpy()
        example = Example(workload.camera(), torch.tensor([0.3]), pixels)
        stage = simulation_stage(gaussians, deformation, SETTINGS)
        run = StageRun(stage, SETTINGS, TrainingData([example], [], (1.0, 1.0, 1.0)))
        taken: Measured = measured(run.advance, seconds, most=1000)
        rows.append([workload.title, str(taken), digits(1e3 / taken.median)])
    return table(["scene", "a step, ms", "steps/s"], rows)


def provenance(device: torch.device) -> str:
    """The line under every table."""
    name = torch.cuda.get_device_name() if device.type == "cuda" else machine()["processor"]
    code = commit("native", "surrogate", "catalogs", "benchmarks")
    return f"`python -m benchmarks.gpu`, commit {code}, {name}, torch {torch.__version__}. Times: median (fastest to slowest)."


def _sized(workload: Workload, quick: bool) -> Workload:
    return workload.at_size(128).with_count(1000) if quick else workload


def _model(workload: Workload, device: torch.device) -> tuple[Gaussians, BilinearDeformation]:
    """The workload's Gaussians, and a deformation that moves all of them a little."""
    scene = workload.scene()
    gaussians = Gaussians(scene.means, scene.scales.log(), scene.quats, scene.opacities.logit(), scene.colors)
    deformation = BilinearDeformation.create(gaussians, 1, SETTINGS)
    torch.nn.init.normal_(deformation.weights_out, std=1e-3, generator=torch.Generator().manual_seed(0))
    return gaussians.to(device), deformation.to(device)


def _at(deformation: BilinearDeformation, gaussians: Gaussians, parameters: torch.Tensor) -> Gaussians:
    with torch.no_grad():
        return deformation.deformed(gaussians, parameters)


def _say(started: float, text: str) -> None:
    print(f"[{time.perf_counter() - started:5.0f} s] {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
