"""Sensitivities, local and global, against stored pictures, other seeds, other representations and the simulation itself.

    python -m research.benchmarks.answers.sensitivity RUN [RUN ...] [--trainings] [--write]

Each RUN is a folder whose catalog is there. Prints two tables in Markdown.

1. Maps at test members from a test view each. Their time is in pictures, without and with the comparison of two
   predictions. The Taylor-Green vortex itself is run as well, at parameters 1 % of the range above and below, and the
   ray caster draws its fields. Gradients are of mean colours by Gaussians, against differences of 1 %: median and
   largest relative errors, and those without the edges of Gaussians.
2. Sobol indices for parameters distributed as the members' are. First indices of stored pictures need no surrogate: each
   pixel is fitted by a cubic of one parameter over all members, and explained variances are summed over pixels.
   "Seeds" is the largest change with other Sobol points.

With `--trainings` one other table instead, of runs that were trained again with other seeds (`research.studies
repeat`): how far indices and maps by Gaussians differ between trainings. Seconds are processor seconds.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from insitu.simulations import Field
from insitu.simulations.taylor_green_fields import dumps
from native.ray_casting import draw_volume
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from surrogate.answers.sensitivity import STEP, Sensitivity, Steps, correlations, sensitivity
from surrogate.answers.sobol import SIDE, Distribution, SobolIndices, picture_response, sobol_indices
from surrogate.answers.targets import Target, stored_target
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.run import Run
from surrogate.model import DifferentiableSurrogate, Surrogate
from surrogate.model.representation import FIELD, GAUSSIANS
from surrogate.splatting.threads import one_torch_thread

Array = NDArray[Any]

MAPS = [
    "run",
    "maps, pictures (compared)",
    "allowed",
    "parameter",
    "mean change",
    "two predictions agree",
    "agrees with the simulation",
    "change / simulation's",
    "gradient's error (without edges)",
]
INDICES = [
    "run",
    "variance of",
    "parameter",
    "total",
    "first",
    "first, stored pictures",
    "seeds",
    "first, Gaussians / field",
    "total, even",
    "s",
]
TRAININGS = ["run", "trainings", "parameter", "total, pixels", "first, pixels", "maps of two agree"]
TURNS = 9
SOLVER = 192  # points a side, as the scene has it


def test_views(catalog: Catalog) -> list[tuple[Mapping[str, float], Camera]]:
    """Parameters and one test view of each test member."""
    pairs = []
    for number, member in enumerate(m for m in catalog.members if m.split == "test"):
        views = [view for view, split in enumerate(member.view_splits) if split == "test"]
        pairs.append((member.parameters, member.cameras[views[number % len(views)]]))
    return pairs


def times_in_pictures(surrogate: Surrogate, parameters: Mapping[str, float], camera: Camera) -> list[float]:
    """Times of the maps, without and with the comparison, in those of a picture: the medians of turns."""
    rows = Steps.about(surrogate.space, parameters, STEP).rows

    def pictures() -> None:
        for row in rows:
            surrogate.at(row, outside="allow").render(camera)

    actions = [
        pictures,
        lambda: sensitivity(surrogate, parameters, camera, compare=False),
        lambda: sensitivity(surrogate, parameters, camera),
    ]
    turns = []
    for _ in range(TURNS):
        each = []
        for action in actions:
            started = time.process_time()
            action()
            each.append(time.process_time() - started)
        turns.append(each)
    reference, alone, compared = np.median(turns, axis=0)
    return [len(rows) * alone / reference, len(rows) * compared / reference]


def simulated_maps(
    catalog: Catalog,
    space: ParameterSpace,
    pairs: Sequence[tuple[Mapping[str, float], Camera]],
    resolution: int = 64,
    solver: int = SOLVER,
) -> list[Array]:
    """The maps (2, H, W, 3) of the Taylor-Green vortex itself, by Re and time, at each place; a Reynolds number runs once."""
    appearance = catalog.plan.appearances[0]
    assert isinstance(appearance, VolumeRendering)
    steps = [Steps.about(space, parameters, STEP) for parameters, _ in pairs]
    moments: dict[float, set[float]] = {}
    for row in (row for each in steps for row in each.rows):
        moments.setdefault(row["Re"], set()).add(row["time"])
    fields: dict[tuple[float, float], Field] = {}
    for reynolds, wanted in moments.items():
        times = sorted(wanted)
        made = dumps(
            {"Re": reynolds}, fields=["q_criterion"], resolution=resolution, times=times, solver_resolution=solver
        )
        fields |= {(reynolds, moment): dump["q_criterion"] for moment, dump in zip(times, made, strict=True)}

    def pictures(rows: Sequence[Mapping[str, float]], camera: Camera) -> Array:
        shown = [fields[row["Re"], row["time"]] for row in rows]
        return np.stack(
            [draw_volume(f.values, None, f.spacing, f.origin, appearance, camera, threads=1) for f in shown]
        )

    background = catalog.plan.background or WHITE
    return [each.maps(pictures, camera, background) for each, (_, camera) in zip(steps, pairs, strict=True)]


def map_rows(title: str, surrogate: Surrogate, catalog: Catalog) -> list[list[str]]:
    """Rows of the first table, one for each parameter."""
    pairs, background = test_views(catalog), catalog.plan.background
    answers = [sensitivity(surrogate, at, camera, background=background) for at, camera in pairs]
    alone, compared = times_in_pictures(surrogate, *pairs[0])
    parameters = len(surrogate.space)
    truths: list[list[str]] = [["-", "-"]] * parameters
    if surrogate.space.names == ("Re", "time"):
        truths = _against_simulation(catalog, surrogate.space, pairs, answers)
    agreements = np.array([answer.agreements for answer in answers])
    changes = np.mean([answer.of_view for answer in answers], axis=0)
    own = [title, f"{alone:.1f} ({compared:.1f})", f"{2.2 * parameters + 1:.1f}"]
    errors = [np.array([gradient_error(surrogate, *pair, edges=edges) for pair in pairs]) for edges in (True, False)]
    with_edges, without = (f"{np.median(each):.1%} / {each.max():.1%}" for each in errors)
    return [
        [
            *(own if j == 0 else [""] * 3),
            name,
            f"{changes[j]:.3f}",
            f"{np.nanmedian(agreements[:, j]):.2f}",
            *truths[j],
            f"{with_edges} ({without})" if j == 0 else "",
        ]
        for j, name in enumerate(surrogate.space.names)
    ]


def training_rows(title: str, folder: Path, catalog: Catalog, view: int = 17) -> list[list[str]]:
    """Rows of the table of trainings, one for each parameter."""
    trained = [
        Surrogate.load(path).using(GAUSSIANS) for path in [folder / "surrogate", *folder.glob("seeds/*/surrogate")]
    ]
    camera, space, background = catalog.plan.cameras[view], trained[0].space, catalog.plan.background
    members = Distribution.of_members(space, catalog)
    answers = [sobol_indices(space, picture_response(one, camera, background=background), members) for one in trained]
    first, total = (np.array([getattr(answer, name) for answer in answers]) for name in ("first", "total"))
    each = []
    for at, seen_from in test_views(catalog):
        maps = [sensitivity(one, at, seen_from, background=background, compare=False).maps for one in trained[:2]]
        each.append(correlations(*maps))
    return [
        [
            *([title, str(len(trained))] if j == 0 else ["", ""]),
            name,
            " / ".join(f"{value:.2f}" for value in total[:, j]),
            " / ".join(f"{value:.2f}" for value in first[:, j]),
            f"{np.nanmedian(np.array(each)[:, j]):.2f}",
        ]
        for j, name in enumerate(space.names)
    ]


def gradient_error(surrogate: Surrogate, parameters: Mapping[str, float], camera: Camera, *, edges: bool) -> float:
    """The relative error of the gradient of the mean colour on white, by parameters as shares of their ranges."""
    model, space = surrogate.using(GAUSSIANS).differentiable(edges=edges).requires_grad_(False), surrogate.space
    assert isinstance(model, DifferentiableSurrogate)

    def mean(row: Any) -> Any:
        return model(row, camera, background=WHITE)[..., :3].double().mean()

    values = torch.tensor([float(parameters[name]) for name in space.names], dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(mean(values), values)
    steps, count = Steps.about(space, parameters, STEP), len(space)
    with torch.no_grad():
        means = [float(mean(torch.tensor([row[name] for name in space.names]))) for row in steps.rows]
    expected = (np.array(means[:count]) - means[count:]) / steps.widths
    tiny = [space.denormalize(space.normalize(values.detach().numpy()) + sign * 1e-6) for sign in (1.0, -1.0)]
    per_range = (tiny[0] - tiny[1]) / 1e-6  # of each parameter's value, where a range is 2
    return float(np.linalg.norm(gradient.numpy() * per_range - expected) / np.linalg.norm(expected))


def _against_simulation(
    catalog: Catalog,
    space: ParameterSpace,
    pairs: Sequence[tuple[Mapping[str, float], Camera]],
    answers: Sequence[Sensitivity],
) -> list[list[str]]:
    """Of each parameter, median and least correlation with the simulation's map, and the median ratio of mean changes."""
    maps = simulated_maps(catalog, space, pairs)
    each = np.array([correlations(answer.maps, true) for answer, true in zip(answers, maps, strict=True)])
    changes = np.array([np.abs(true).mean((1, 2, 3)) for true in maps])
    ratios = np.median([answer.of_view for answer in answers] / changes, axis=0)
    return [[f"{np.median(each[:, j]):.2f} (least {each[:, j].min():.2f})", f"{ratios[j]:.2f}"] for j in range(2)]


def stored_first(catalog: Catalog, space: ParameterSpace, view: int, region: tuple[int, int, int, int] | None) -> Array:
    """First indices (P,) of stored pictures: shares of the variance, over members, that a cubic of one parameter explains."""
    members = catalog.members
    points = space.normalize([space.values(member.parameters, outside="allow") for member in members])  # [M, P]
    if region is None:
        small: list[Target] = [stored_target(catalog, member.name, view).resized(SIDE) for member in members]
        values = np.stack([one.picture.ravel() for one in small])
    else:
        x0, y0, x1, y1 = region
        pictures = [stored_target(catalog, member.name, view).picture[y0:y1, x0:x1] for member in members]
        values = np.stack([picture.mean((0, 1)) for picture in pictures])
    values = values - values.mean(0)  # [M, K]
    count, degrees = len(members), 3
    shares = []
    for column in points.T:
        basis = np.linalg.qr(np.vander(column, degrees + 1))[0]
        explained = ((basis.T @ values) ** 2).sum() / (values**2).sum()
        shares.append(1.0 - (1.0 - explained) * (count - 1) / (count - 1 - degrees))
    return np.array(shares)


def index_rows(title: str, surrogate: Surrogate, catalog: Catalog, view: int = 17) -> list[list[str]]:
    """Rows of the second table, one for each quantity and parameter."""
    camera, space, background = catalog.plan.cameras[view], surrogate.space, catalog.plan.background
    members = Distribution.of_members(space, catalog)
    width, height = camera.width, camera.height
    centre = (width // 4, height // 4, width - width // 4, height - height // 4)
    rows = []
    for of, region in (("picture", None), ("colour", centre)):

        def answer(using: Surrogate = surrogate, of: str = of, region: Any = region, **options: Any) -> SobolIndices:
            response = picture_response(using, camera, of, region=region, background=background)
            return sobol_indices(space, response, options.pop("distribution", members), **options)

        started = time.process_time()
        own = answer()
        seconds = time.process_time() - started
        again, even = answer(seed=1), answer(distribution=None)
        pair = [answer(surrogate.using(name)).first for name in (GAUSSIANS, FIELD)]
        stored = stored_first(catalog, space, view, region)
        seeds = max(np.abs(again.first - own.first).max(), np.abs(again.total - own.total).max())
        for j, name in enumerate(space.names):
            head = [title if not rows else "", "centre's mean colour" if region else "pixels"] if j == 0 else ["", ""]
            rows.append(
                [
                    *head,
                    name,
                    f"{own.total[j]:.2f} ± {own.total_half[j]:.2f}",
                    f"{own.first[j]:.2f} ± {own.first_half[j]:.2f}",
                    f"{stored[j]:.2f}",
                    f"{seeds:.2f}" if j == 0 else "",
                    " / ".join(f"{first[j]:.2f}" for first in pair),
                    f"{even.total[j]:.2f}",
                    f"{seconds:.1f}" if j == 0 else "",
                ]
            )
    return rows


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("answers.sensitivity", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--trainings", action="store_true", help="compare trainings with other seeds instead")
    parser.add_argument("--write", action="store_true", help="write the tables into docs/results/answers.md")
    options = parser.parse_args(arguments)
    words = " ".join(map(str, options.runs))
    if options.trainings:
        rows = [row for run in map(Run.open, options.runs) for row in training_rows(run.title, run.folder, run.catalog)]
        body = f"{table(TRAININGS, rows)}\n<sub>{made_by(f'answers.sensitivity {words} --trainings')}</sub>"
        publish(body, RESULTS / "answers.md", "trainings", write=options.write)
        return
    report, maps, indices = stopwatch(), [], []
    for run in map(Run.open, options.runs):
        assert run.catalog is not None
        maps += map_rows(run.title, run.surrogate, run.catalog)
        report(f"{run.title}: maps")
        indices += index_rows(run.title, run.surrogate, run.catalog)
        report(f"{run.title}: indices")
    body = f"{table(MAPS, maps)}\n{table(INDICES, indices)}\n<sub>{made_by(f'answers.sensitivity {words}')}</sub>"
    publish(body, RESULTS / "answers.md", "sensitivity", write=options.write)


if __name__ == "__main__":
    main()
