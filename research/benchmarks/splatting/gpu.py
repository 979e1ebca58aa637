"""Time drawing, a change of parameters and a training step on a GPU, beside their errors, and write docs/results/gpu.md.

    python -m research.benchmarks.splatting.gpu [--device cpu] [--quick] [--output DIRECTORY]

Takes a few minutes, most of them for the float64 reference on the CPU; the data are made here. `--device cpu` tries the
command without a GPU, and writes to runs/bench/.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch

from research.benchmarks.page import PROJECT, RESULTS, command_line, made_by, page_in, stopwatch, table, write_parts
from research.benchmarks.splatting.drawing import ERROR_HEADER, measure
from research.benchmarks.splatting.reference_patches import draw_patches
from research.benchmarks.splatting.workloads import FIXED, OTHERS, Workload
from research.benchmarks.timing import MeasuredTime, digits, measured
from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.gaussians import Gaussians
from surrogate.provenance import machine
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.splatting import Primitives
from surrogate.splatting.cuda import chosen_device
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.data import Example, TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.stages import simulation_stage

PAGE = "gpu.md"
LARGE = FIXED.at_size(512).with_count(160_000)
ASKED = {"a view change": 1.0, "a parameter change": 2.0}  # ms, 160k Gaussians at 512²
SETTINGS = TrainingSettings(relocation_interval=0)


def main() -> None:
    parser = command_line("splatting.gpu", __doc__)
    parser.add_argument("--device", default="cuda", choices=["cuda", "cpu"])
    parser.add_argument("--quick", action="store_true", help="small scenes, for a moment")
    parser.add_argument("--output", type=Path, help="folder of the page; default docs, or runs/bench without a GPU")
    arguments = parser.parse_args()
    try:
        device = chosen_device(arguments.device)
    except RuntimeError as error:
        sys.exit(str(error))
    official = device.type == "cuda" and not arguments.quick
    page, say = page_in(arguments.output or (RESULTS if official else PROJECT / "runs" / "bench"), PAGE), stopwatch()
    seconds = 0.2 if arguments.quick else 2.0
    parts = {"explore": explore, "draw": drawing, "train": training}
    with one_torch_thread():
        measured_parts = {name: partial(part, device, arguments.quick, seconds, say) for name, part in parts.items()}
        failed = write_parts(page, measured_parts, provenance(device), say)
    say(str(page))
    sys.exit(bool(failed))


def explore(device: torch.device, quick: bool, seconds: float, say: Callable[[str], None]) -> str:
    """Times of a view change and of a parameter change, with the image in main memory."""
    workload = _sized(LARGE, quick)
    gaussians, deformation = _model(workload, device)
    camera, rasterizer = workload.camera(), Rasterizer()
    places = itertools.cycle(torch.tensor([0.01 * i]) for i in range(100))

    @torch.no_grad()
    def look(at: Callable[[], Gaussians]) -> torch.Tensor:
        return rasterizer.draw_over(at(), camera, (1.0, 1.0, 1.0)).cpu()

    say(f"exploring {workload.title}")
    calls = {
        "a view change": lambda: look(lambda: gaussians),
        "a parameter change": lambda: look(lambda: deformation.deformed(gaussians, next(places))),
    }
    rows = []
    for name, call in calls.items():
        taken = measured(call, seconds, most=1000)
        rows.append([name, str(taken), f"{ASKED[name]:g}", "yes" if taken.median <= ASKED[name] else "no"])
    return f"{workload.title}; the picture is in main memory when the clock stops.\n\n" + table(
        ["", "ms", "asked for, ms", "reached"], rows
    )


def drawing(device: torch.device, quick: bool, seconds: float, say: Callable[[str], None]) -> str:
    """Forward and backward pass, and their errors against the float64 reference."""
    rows = []
    for workload in [FIXED, *OTHERS, LARGE][: 2 if quick else None]:
        workload = _sized(workload, quick)
        say(workload.title)
        view = workload.view()
        exact = draw_patches(view, 8 if quick else 48)
        moved = view._replace(scene=Primitives(*(tensor.to(device) for tensor in view.scene)))
        drawn = measure(moved, exact, seconds)
        rows.append([workload.title, *drawn.times(), *drawn.error_cells()])
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
        taken: MeasuredTime = measured(run.advance, seconds, most=1000)
        rows.append([workload.title, str(taken), digits(1e3 / taken.median)])
    return table(["scene", "a step, ms", "steps/s"], rows)


def provenance(device: torch.device) -> str:
    """The line under every table."""
    name = torch.cuda.get_device_name() if device.type == "cuda" else machine()["processor"]
    return f"{made_by('splatting.gpu', on=name)}, torch {torch.__version__}. Times: median (fastest to slowest)."


def _sized(workload: Workload, quick: bool) -> Workload:
    return workload.at_size(128).with_count(1000) if quick else workload


def _model(workload: Workload, device: torch.device) -> tuple[Gaussians, BilinearDeformation]:
    """The workload's Gaussians, and a deformation that moves all of them a little."""
    gaussians = workload.gaussians()
    deformation = BilinearDeformation.create(gaussians, 1, SETTINGS)
    torch.nn.init.normal_(deformation.weights_out, std=1e-3, generator=torch.Generator().manual_seed(0))
    return gaussians.to(device), deformation.to(device)


if __name__ == "__main__":
    main()
