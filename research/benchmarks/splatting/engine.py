"""The fixed workload against the physical limit; other scenes; the plain-torch backend; the image loss."""

from __future__ import annotations

import numpy as np
import torch

from native import kernels
from research.benchmarks.page import table
from research.benchmarks.splatting.counting import Peak, Work, backward_work, forward_work
from research.benchmarks.splatting.drawing import ERROR_HEADER, TIMES, DrawingMeasurement, measure
from research.benchmarks.splatting.reference_patches import InteractionCounts, draw_patches
from research.benchmarks.splatting.setup import Setup, said
from research.benchmarks.splatting.workloads import FIXED, OTHERS, Workload
from research.benchmarks.timing import digits, measured
from surrogate.splatting import Primitives
from surrogate.training.losses import image_loss, image_loss_reference

SMALL = Workload("translucent", 64, 2_000, (2, 6), (0.02, 0.2))

# ---- the fixed workload ----------------------------------------------------------------------------------------


def fixed(setup: Setup) -> str:
    """256², 20k translucent Gaussians, by instruction set and threads, beside what the machine could do at most."""
    view = FIXED.view()
    setup.say("the float64 reference, every pixel")
    whole = draw_patches(view, gradients=False).counted
    exact = draw_patches(view, setup.patches)
    rows, limits = [], []
    for name in setup.instruction_sets:
        for threads in setup.threads:
            setup.say(f"{FIXED.title}: {name}, {said(threads)}")
            peak = Peak.measure(name, threads, setup.seconds / 4)
            drawn = measure(view, exact, setup.seconds, threads=threads, instruction_set=name)
            ratio = f"{drawn.both.median / peak.loop_ms():.2f}"
            rows.append([name, str(threads), *drawn.times(), ratio, *drawn.error_cells()])
            rates = [f"{peak.gigaflops:.0f}", f"{peak.gigabytes:.0f}"]
            limits.append([name, str(threads), *rates, *_limit_cells(drawn, whole, peak)])
    header = ["instruction set", "threads", *TIMES, "sum / 10⁹ FMAs", *ERROR_HEADER]
    limit_header = ["instruction set", "threads", "peak, Gflop/s", "memory, GB/s"]
    for name in ("forward", "backward"):
        limit_header += [f"{name}: floor, ms", "times the floor", "of the peak"]
    return "\n".join([_described(whole), table(header, rows), "The physical limit:\n", table(limit_header, limits)])


def _described(whole: InteractionCounts) -> str:
    work = {"forward": forward_work(*_size(whole)), "backward": backward_work(*_size(whole))}
    needs = "; ".join(f"{name} {_billions(w)}" for name, w in work.items())
    return (
        f"Measured in the scene: {whole.interactions / 1e6:.2f} M (pixel, Gaussian) pairs, {whole.depth:.0f} Gaussians "
        f"per covered pixel; {100 * whole.lanes_used:.0f} % of the pixels in blocks of 4 x 4 that a Gaussian draws in. "
        f"Needed at least: {needs}.\n"
    )


def _size(whole: InteractionCounts) -> tuple[int, int, int]:
    return whole.interactions, FIXED.count, whole.pixels


def _billions(work: Work) -> str:
    return f"{work.flops / 1e9:.2f} Gflop in {work.instructions / 1e9:.2f} G instructions, {work.bytes / 1e6:.1f} MB"


def _limit_cells(drawn: DrawingMeasurement, whole: InteractionCounts, peak: Peak) -> list[str]:
    cells = []
    for taken, work in ((drawn.forward, forward_work(*_size(whole))), (drawn.backward, backward_work(*_size(whole)))):
        floor = peak.floor_ms(work)
        cells += [digits(floor), f"{taken.median / floor:.1f}", f"{100 * peak.share(work, taken.median):.0f} %"]
    return cells


# ---- other scenes, and plain torch ------------------------------------------------------------------------------


def others(setup: Setup) -> str:
    """Scenes of other kinds, with the best instruction set on one thread."""
    rows = []
    for workload in OTHERS[2:3] if setup.quick else OTHERS:
        setup.say(workload.title)
        view = workload.view()
        exact = draw_patches(view, setup.patches)
        drawn = measure(view, exact, setup.seconds, threads=1)
        pairs = exact.counted.interactions / exact.counted.pixels * workload.size**2  # spread over the frame
        counted = [digits(pairs / 1e6), f"{exact.counted.depth:.0f}"]
        rows.append([workload.title, *counted, *drawn.times(), *drawn.error_cells()])
    header = ["scene", "pairs, M", "per covered pixel", *TIMES, *ERROR_HEADER]
    return table(header, rows)


def backends(setup: Setup) -> str:
    """The kernels beside the plain-torch definition, on a scene that torch can manage."""
    workload = SMALL.with_count(500) if setup.quick else SMALL
    view = workload.view()
    exact = draw_patches(view)
    cases: list[tuple[str, Primitives, dict[str, object]]] = [
        (f"cpu, {name}", view.scene, {"threads": 1, "instruction_set": name}) for name in setup.instruction_sets
    ]
    cases.append(("reference, float32", view.scene, {"backend": "reference"}))
    cases.append(("reference, float64", Primitives(*(t.double() for t in view.scene)), {"backend": "reference"}))
    rows = []
    for name, tensors, options in cases:
        setup.say(f"{workload.title}: {name}")
        drawn = measure(view._replace(scene=tensors), exact, setup.seconds, **options)
        rows.append([name, *drawn.times(), *drawn.error_cells()])
    return f"{workload.title} Gaussians, one thread.\n\n" + table(["backend", *TIMES, *ERROR_HEADER], rows)


# ---- the image loss ----------------------------------------------------------------------------------------------


def loss(setup: Setup) -> str:
    """L1 + SSIM with its gradient, 256², for colours and for colours with alpha."""
    rows = [_loss_row(channels, name, setup.seconds) for channels in (3, 4) for name in setup.instruction_sets]
    return table(
        ["picture", "instruction set", "value and gradient, ms", "value error", "largest gradient error"], rows
    )


def _loss_row(channels: int, instruction_set: str, seconds: float) -> list[str]:
    random = np.random.default_rng(3)
    pictures = [random.random((256, 256, channels), dtype=np.float32) for _ in range(2)]
    taken = measured(lambda: kernels.image_loss(*pictures, 0.2, 1, instruction_set), seconds)
    image, target = (torch.from_numpy(picture) for picture in pictures)
    slow, fast = image.double().requires_grad_(), image.clone().requires_grad_()
    wanted, got = image_loss_reference(slow, target.double()), image_loss(fast, target)
    (by_slow,), (by_fast,) = torch.autograd.grad(wanted, slow), torch.autograd.grad(got, fast)
    error = float((by_fast - by_slow).abs().max() / by_slow.abs().max())
    return [f"256² x {channels}", instruction_set, str(taken), f"{abs(got.item() - wanted.item()):.0e}", f"{error:.0e}"]
