"""Time of a parameter change on one core: of the simulation's alone, and with an isovalue or a transfer function.

    python -m research.benchmarks.splatting.changes [--gaussians 20000] [--seconds 5]

The models are synthetic, because the time does not depend on their numbers. They have the sizes that training starts
with, colours of degree 0 at the base and of degree 1 on isosurfaces. Every call goes to different parameters. Prints
Markdown.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import isovalue_family, transfer_function_family
from research.benchmarks.page import command_line, made_by, table
from research.benchmarks.splatting.setup import limited_to
from research.benchmarks.timing import measured
from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.deformation.values import VALUE_BINS
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians, Normalization
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings

SETTINGS = TrainingSettings()
MOST = 100_000  # calls of one kind, however short
PLACES = 1009  # number of different parameters
COLORS = ((0.0, 0.2, 0.3, 0.8), (1.0, 0.9, 0.9, 0.5), (3.0, 0.8, 0.1, 0.1))
BASE = VolumeRendering("dvr", TransferFunction(COLORS, ((0.0, 0.0), (1.0, 0.3), (2.0, 0.6), (3.0, 1.0)), 0.3))


def random_gaussians(count: int) -> Gaussians:
    random = torch.Generator().manual_seed(0)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, 3))
    return Gaussians(*(torch.randn(shape, generator=random) for shape in shapes))


def moving(gaussians: Gaussians, parameters: int, color_columns: int = 3) -> BilinearDeformation:
    """A deformation that moves everything a little."""
    made = BilinearDeformation.create(gaussians, parameters, SETTINGS, color_columns=color_columns)
    return replace(
        made, weights_out=0.1 * torch.randn(made.weights_out.shape, generator=torch.Generator().manual_seed(1))
    )


def made_up(count: int) -> Surrogate:
    """A model of one simulation parameter that follows isovalues and transfer functions."""
    gaussians = random_gaussians(count)
    simulation = moving(gaussians, 1)
    isovalues = isovalue_family(BASE.name, train=np.linspace(0.5, 2.5, 7).tolist()).variation
    functions = transfer_function_family(BASE, first_step=(0.3, 0.2), second_step=(0.3, 0.2)).variation
    steps = [parameter.high for parameter in functions.space.parameters]
    values = ValuesDeformation.create(gaussians, BASE.transfer_function, np.linspace(0.0, 3.0, VALUE_BINS), steps)
    return Surrogate(
        gaussians,
        simulation,
        ParameterSpace((Parameter("Re", 1500.0, 2500.0),)),
        Normalization(np.zeros(3), 1.0),
        Rasterizer(),
        visualizations=(
            Visualization(isovalues, moving(gaussians, 2, color_columns=12), simulation.copy(), color_degree=1),
            Visualization(functions, values),
        ),
    )


def random_places(space: ParameterSpace) -> Iterator[dict[str, float]]:
    """Uniformly random parameters within the bounds, repeated without end."""
    random, (low, high) = np.random.default_rng(0), np.array([(p.low, p.high) for p in space.parameters]).T
    drawn = random.uniform(low, high, (PLACES, len(space))).tolist()
    return itertools.cycle([dict(zip(space.names, place, strict=True)) for place in drawn])


def changes(surrogate: Surrogate) -> dict[str, Callable[[], object]]:
    """Calls that each go to different parameters, by what they change."""
    of_simulation = random_places(surrogate.space)
    calls: dict[str, Callable[[], object]] = {"simulation": lambda: surrogate.at(**next(of_simulation))}
    for visualization in surrogate.visualizations:
        of_vis = random_places(visualization.variation.space)

        def change(of_vis: Iterator[dict[str, float]] = of_vis) -> None:
            surrogate.at(**next(of_simulation), **next(of_vis))

        calls[f"simulation and {visualization.variation.name}"] = change
    return calls


def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("splatting.changes", __doc__)
    parser.add_argument("--gaussians", type=int, default=20_000)
    parser.add_argument("--seconds", type=float, default=5.0, help="for each kind of change")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    with limited_to(1):
        calls = changes(made_up(options.gaussians))
        rows = [[what, str(measured(call, options.seconds, most=MOST))] for what, call in calls.items()]
    sys.stdout.write(table([f"parameters of {options.gaussians:,} Gaussians", "ms"], rows))
    sys.stdout.write(f"\n{made_by('splatting.changes')}, one core. Times: median (fastest to slowest).\n")


if __name__ == "__main__":
    main()
