"""Quality over the size of pictures: the same members, rendered and learnt at several sizes.

    python -m research.benchmarks.training.sizes SCENE [--sizes 128,256,512,1024] [--frequency 2] [--gaussians 40000]
        [--steps 6000] [--seed 0] [--runs runs] [--write]

Each member is simulated once, and rendered into one catalog for each size, from the viewpoints of the icosphere of that
frequency. A surrogate of the same number of Gaussians and steps learns each. Test images of its own size judge the
Gaussians at seen and at unseen parameters, and the emulated field. They judge the members' own stored fields of at most
64³ samples, too, which no emulator of these can do better than. Catalogs and runs are in RUNS/sizes/<scene>; what is
finished is not made again. Prints Markdown; `--write` puts it into docs/results/training.md.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.scene import PlannedMember, Scene
from insitu.ensembles.dumps import dumps_of, runs_of
from insitu.ensembles.sources import Ensemble, ensemble_of
from insitu.hook.session import Session
from insitu.members.planning import PlanOptions
from render import Grid, render_views
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from research.benchmarks.training.streaming import step_seconds
from research.studies.repeats.run import score_model
from surrogate.evaluation.tables import number
from surrogate.model import Surrogate
from surrogate.model.representation import FIELD, GAUSSIANS
from surrogate.settings import TrainingSettings
from surrogate.storage.runs import RunFolder

PAGE, PART, FOLDER = RESULTS / "training.md", "sizes", "sizes"
HEADER = (
    "pictures",
    "Gaussians, seen parameters, dB",
    "Gaussians, unseen parameters",
    "emulated field",
    "own field of 64³, drawn",
    "training, processor s",
    "a step, processor ms",
    "the same with as many Gaussians a pixel as at 512²",
)
LIKE, TIMED_STEPS = 512, 40  # pixels a side where both numbers of Gaussians are the same; steps that are timed
STEPS_PER_SAMPLE = 0.25  # of the stored fields, when they are drawn to be judged


def render(scene: Scene, folder: Path, sizes: Sequence[int], frequency: int, say: Callable[[str], None]) -> None:
    """Complete the catalogs of all sizes; raises what the source raises."""
    ensemble = ensemble_of(scene)
    members = scene.assigned(ensemble.members)
    with ExitStack() as stack:
        sessions = [stack.enter_context(_session(scene, ensemble, folder, size, frequency)) for size in sizes]
        for run in runs_of(ensemble.source, members):
            missing = [m for m in run if not all(_has(session, m) for session in sessions)]
            for dump in dumps_of(ensemble.source, missing, None):
                if dump.error is not None:
                    raise dump.error
                say(f"rendering {dump.member.name}")
                for session in sessions:
                    if not _has(session, dump.member):
                        how = {"name": dump.member.name, "split": dump.member.split}
                        session.render_member(dump.field, dump.member.parameters, **how)


def _session(scene: Scene, ensemble: Ensemble, folder: Path, size: int, frequency: int) -> Session:
    options = PlanOptions.of_scene(scene, ensemble.space)
    views = replace(scene.views, frequency=frequency, width=size, height=size)
    return Session(
        folder / f"{size}.cdb",
        space=ensemble.space,
        appearances=scene.appearances,
        views=views,
        target_decibels=options.target_decibels,
        sample_distance=options.sample_distance,
        backend=options.backend,
    )


def _has(session: Session, member: PlannedMember) -> bool:
    return session.catalog is not None and member.name in session.catalog


def trained(catalog: Catalog, run: Path, settings: Sequence[str]) -> Surrogate:
    """The surrogate of a run, trained unless it is; raises subprocess.CalledProcessError where that fails."""
    subprocess.run(
        [sys.executable, "-m", "surrogate", "train", str(catalog.path), "-o", str(run), *settings], check=True
    )
    return Surrogate.load(RunFolder.open(run).model)


def own_fields_drawn(catalog: Catalog) -> float:
    """Mean PSNR of pictures of test members' stored fields, beside their test images, over white."""
    scores = [score for m in catalog.members if m.split == "test" for score in _drawn(catalog, m)]
    return float(np.mean(scores))


def _drawn(catalog: Catalog, member: Member) -> Iterator[float]:
    appearance = catalog.plan.appearances[0]
    coarse = member.coarse_field()
    if coarse is None:
        raise ValueError(f"{catalog.path}: member {member.name} stores no field")
    grid = Grid(np.ascontiguousarray(coarse.values, np.float32), coarse.spacing, coarse.origin)
    views = [view for view, split in enumerate(member.view_splits) if split == "test"]
    distance = STEPS_PER_SAMPLE * min(coarse.spacing)
    cameras = [member.cameras[view] for view in views]
    for view, picture in zip(views, render_views(grid, appearance, cameras, sample_distance=distance), strict=True):
        truth = catalog.image(member, appearance.name, view)
        error = ((_over_white(np.asarray(picture)) - _over_white(truth)) ** 2).mean()
        yield -10.0 * float(np.log10(max(error, 1e-12)))


def _over_white(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """RGB (H, W, 3) in shares of a premultiplied 8-bit picture (H, W, 4)."""
    shares = picture / 255.0
    return shares[..., :3] + 1.0 - shares[..., 3:]  # type: ignore[no-any-return]


def steps_timed(catalog: Catalog, size: int, gaussians: int) -> tuple[float, float]:
    """Processor ms of a step with a number of Gaussians, and with as many a pixel as these are at 512²."""
    counts = (gaussians, max(1, round(gaussians * (size / LIKE) ** 2)))
    settings = (TrainingSettings(gaussians=n, canonical_steps=0, deformation_steps=TIMED_STEPS) for n in counts)
    same, dense = (1e3 * step_seconds(catalog.path, each, TIMED_STEPS)[0] for each in settings)
    return same, dense


def row(size: int, catalog: Catalog, surrogate: Surrogate, count: int) -> list[str]:
    """Of the table."""
    gaussians = score_model(surrogate.using(GAUSSIANS), catalog)["cells"]["psnr"]["unseen_views"]
    field = score_model(surrogate.using(FIELD), catalog)["cells"]["psnr"]["unseen_views"]
    scores = (gaussians["seen_parameters"], gaussians["unseen_parameters"], field["unseen_parameters"])
    spent = f"{surrogate.training['processor_seconds']:,.0f}"
    timed = (f"{each:.1f}" for each in steps_timed(catalog, size, count))
    return [f"{size}²", *map(number, scores), number(own_fields_drawn(catalog)), spent, *timed]


def main() -> None:
    """Render, train, score, print."""
    parser, say = command_line("training.sizes", __doc__), stopwatch()
    parser.add_argument("scene", type=Path, metavar="SCENE")
    parser.add_argument("--sizes", default="128,256,512,1024", help="Pixels a side, with commas between.")
    parser.add_argument("--frequency", type=int, default=2)
    parser.add_argument("--gaussians", type=int, default=40_000)
    parser.add_argument("--steps", type=int, default=6_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--write", action="store_true", help="into docs/results/training.md")
    given, rows = parser.parse_args(), list[list[str]]()
    try:
        scene, sizes = Scene.load(given.scene), [int(size) for size in given.sizes.split(",")]
        folder = given.runs / FOLDER / scene.name
        settings = {**scene.training, "gaussians": given.gaussians, "seed": given.seed}
        settings |= {"canonical_steps": 0, "deformation_steps": given.steps}
        words = [f"{key}={value}" for key, value in settings.items()]
        render(scene, folder, sizes, given.frequency, say)
        for size in sizes:
            say(f"training on {size}²")
            catalog = Catalog.open(folder / f"{size}.cdb")
            rows.append(row(size, catalog, trained(catalog, folder / str(size), words), given.gaussians))
            print(" | ".join(rows[-1]), flush=True)
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        parser.error(str(error))
    command = f"training.sizes {given.scene} --sizes {given.sizes} --frequency {given.frequency}"
    command += f" --gaussians {given.gaussians} --steps {given.steps} --seed {given.seed}"
    publish(f"{table(HEADER, rows)}\n<sub>{made_by(command)}</sub>", PAGE, PART, write=given.write)


if __name__ == "__main__":
    main()
