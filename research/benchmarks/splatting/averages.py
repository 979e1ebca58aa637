"""Time of averages of a transfer function on one core, and their error against quadrature in float64.

    python -m research.benchmarks.splatting.averages [--quick] [--seconds 2]

Gaussians that carry values are rendered with a function's extinction and emission averaged under normal distributions.
The error is that of the worst of the four, relative to the averaged extinction or to 1 % of the function's largest.
Prints Markdown.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from native import kernels
from research.benchmarks.page import PROJECT, command_line, made_by, table
from research.benchmarks.splatting.setup import limited_to
from research.benchmarks.timing import measured
from research.studies.stress.functions import gray, needle, quadrature
from surrogate.appearance.averages import LEAST_SPREAD, MOST_SPREAD, NEGLIGIBLE, averages_reference, resampled
from surrogate.appearance.transferred import LEAST_DEPTH, RANGES, AverageTable, apply, logit_of_depth

SPREADS = (LEAST_SPREAD, 0.01, 0.04, 0.15, MOST_SPREAD)
SIZES = (20_000, 60_000)  # Gaussians
STEP = 1e-12  # width of a step


def scene_function(scene: str) -> TransferFunction:
    """The function of the first appearance in scenes/."""
    record = tomllib.loads((PROJECT / "scenes" / f"{scene}.toml").read_text(encoding="utf-8"))
    return TransferFunction(**record["appearance"][0]["transfer_function"])


def random_function(points: int) -> TransferFunction:
    """Random colours and opacities at random values, all of them opaque in part."""
    random = np.random.default_rng(points)
    values = np.sort(random.random(points))
    colors, opacities = random.random((points, 3)), random.random(points)
    return TransferFunction(
        tuple((v, *c) for v, c in zip(values, colors.tolist(), strict=True)),
        tuple(zip(values, opacities, strict=True)),
        1.0,
    )


def functions() -> dict[str, tuple[TransferFunction, NDArray[np.float64]]]:
    """Functions, and the knots of the scale on which values lie, by name."""
    scenes = {scene: scene_function(scene) for scene in ("cloverleaf", "tgv", "tgv-tf")}
    on_points = {name: (f, np.array([p[0] for p in f.opacity_points])) for name, f in scenes.items()}
    even = {
        "12 random points": random_function(12),
        "60 random points": random_function(60),
        "ramp to the opaque": gray((0.0, 0.0), (1.0, 1.0)),
        "step": gray((0.0, 0.1), (0.4, 0.1), (0.4 + STEP, 0.8), (1.0, 0.8)),
        "steps to and from the transparent": gray(
            (0.0, 0.0), (0.3, 0.0), (0.3 + STEP, 0.9), (0.6, 0.9), (0.6 + STEP, 0.0), (1.0, 0.0)
        ),
        "needle, half as wide as the least spread": needle(0.5, 0.001),
        "needle of a millionth": needle(0.5, 1e-6),
        "100 needles": gray(*((k / 200.0, 0.9 * (k % 2)) for k in range(201))),
    }
    return on_points | {name: (function, np.linspace(0.0, 1.0, 9)) for name, function in even.items()}


def by_kernel(made: AverageTable, values: NDArray[np.float32], spread: float) -> NDArray[np.float64]:
    """The four averages (M, 4) of Gaussians whose depth is 10 where the extinction is largest; NaN where it is clipped."""
    depth = torch.full((len(values),), 10.0 / float(made.nodes.columns[:, 0].max()))  # [M], where the extinction is 1
    logits = logit_of_depth(depth)  # [M]
    latents = torch.from_numpy(np.stack([values, np.full_like(values, np.log(spread))], axis=1))  # [M, 2]
    drawn, colors = apply(made, logits, latents)
    depths = torch.nn.functional.softplus(drawn.double())  # [M]
    depths = torch.where(depths > 1.001 * LEAST_DEPTH, depths, torch.nan)
    extinctions = depths / torch.nn.functional.softplus(logits.double())  # [M]
    return torch.cat([extinctions[:, None], extinctions[:, None] * colors], dim=1).numpy()


def errors(function: TransferFunction, knots: NDArray[np.float64], count: int) -> tuple[int, list[float], list[float]]:
    """The number of nodes, and for each spread the largest error of the nodes' closed form, and of the kernel."""
    unit = function.opacity_unit_distance
    made = AverageTable.of(resampled(function, unit, knots))
    random = np.random.default_rng(0)
    exact, drawn = [], []
    for spread in SPREADS:
        near = random.choice(made.nodes.places, count // 2) + spread * random.normal(0.0, 2.0, count // 2)
        values = np.concatenate([random.uniform(-0.2, 1.2, count - len(near)), near.clip(-0.5, 1.5)]).astype(np.float32)
        at = values.astype(np.float64)
        true = np.stack([quadrature(function, knots, made.nodes.places, value, spread) for value in at])
        unit_of = np.maximum(true[:, :1], NEGLIGIBLE * made.nodes.columns[:, 0].max())  # [M, 1]
        closed = averages_reference(made.nodes, *(torch.from_numpy(a) for a in (at, np.full_like(at, np.log(spread)))))
        exact.append(float((np.abs(closed.numpy() - true) / unit_of).max()))
        wrong = np.abs(by_kernel(made, values, spread) - true) / unit_of  # [M, 4]
        drawn.append(float(np.nanmax(wrong, initial=0.0)))
    return len(made.nodes), exact, drawn


def accuracy(count: int) -> str:
    """A table of the errors by function and spread."""
    rows = []
    for name, (function, knots) in functions().items():
        nodes, exact, drawn = errors(function, knots, count)
        rows.append([name, str(nodes), *(f"{d:.1e} ({e:.1e})" for d, e in zip(drawn, exact, strict=True))])
    header = ["function", "nodes", *(f"s = {spread:g}" for spread in SPREADS)]
    said = (
        f"Largest error of {count} averages as they are drawn (0: none is thick enough), in brackets of the nodes' closed "
        "form in float64:"
    )
    return f"{said}\n\n{table(header, rows)}"


def passes(made: AverageTable, count: int) -> dict[str, Callable[[], object]]:
    """The timed calls on `count` Gaussians, by name."""
    random = torch.Generator().manual_seed(0)
    logits, means, log_spreads = (torch.rand(count, generator=random) for _ in range(3))
    values = torch.stack([means, -1.0 - 4.0 * log_spreads], dim=1)  # [N, 2]
    leaves = logits.clone().requires_grad_(), values.clone().requires_grad_()
    shown = apply(made, *leaves)
    upstream = tuple(torch.randn(tensor.shape, generator=random) for tensor in shown)

    def forward() -> object:
        with torch.no_grad():
            return apply(made, logits, values)

    return {"forward": forward, "backward": lambda: torch.autograd.grad(shown, leaves, upstream, retain_graph=True)}


def speed(name: str, seconds: float) -> str:
    """A table of milliseconds on one core under the function of a scene, beside the largest error."""
    function, knots = functions()[name]
    nodes = resampled(function, function.opacity_unit_distance, knots)
    made = AverageTable.of(nodes)
    rows = [
        ["nodes of a function", measured(lambda: resampled(function, 1.0, knots), seconds)],
        ["table of the nodes", measured(lambda: kernels.averages(nodes.places, nodes.columns, RANGES), seconds)],
    ]
    for count in SIZES:
        rows += [
            [f"{what}, {count:,} Gaussians", measured(call, seconds)] for what, call in passes(made, count).items()
        ]
    worst = max(errors(function, knots, 200)[2])
    said = f"`{name}`, {len(nodes)} nodes, a table of {made.cells.nbytes / 1e3:.0f} kB; largest error {worst:.1e}:"
    header = ["", "ms, one core: median (fastest to slowest)"]
    return f"{said}\n\n{table(header, [[what, str(taken)] for what, taken in rows])}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print both tables."""
    options = command_line("splatting.averages", __doc__)
    options.add_argument("--quick", action="store_true", help="few averages and calls: does it run?")
    options.add_argument("--seconds", type=float, default=2.0, help="for each of the times (default 2)")
    given = options.parse_args(arguments)
    torch.set_num_threads(1)
    with limited_to(1):
        print(speed("cloverleaf", 0.01 if given.quick else given.seconds))
    print(accuracy(20 if given.quick else 400))
    print(
        f"<sub>{made_by('splatting.averages', 'surrogate', 'research/benchmarks')}, kernels {kernels.instruction_sets()[0]}.</sub>"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    main()
