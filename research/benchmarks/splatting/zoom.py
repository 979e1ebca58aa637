"""Pictures at other sizes than the trained one, and from nearer and farther, beside the simulation's own fields drawn so.

    python -m research.benchmarks.splatting.zoom RUN [RUN ...] [--members 4] [--views 4] [--write]

Each RUN is a folder whose catalog is there, with whole coarse fields.  Members of training and test are drawn from test views,
1/4 to 4 times the trained size, and from half and twice the distance.  Our ray caster draws the fields as `render` does, with the
catalog's sample distance.
PSNR is on white, mean over pictures, of the full frame.  `bicubic` is the picture of the trained size, enlarged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from catalogs.store.members import Member
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native.ray_casting import SampledField, SurfaceCaster, VolumeCaster
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from surrogate.evaluation.metrics import WHITE, composite, decibels, mean_squared_error
from surrogate.evaluation.scoring import spread
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

SIZES = (0.25, 0.5, 1.0, 2.0, 4.0)
DISTANCES = (0.5, 2.0)
HEADER = [
    "run",
    "members",
    "drawn by",
    *(f"{size:g} x" for size in SIZES),
    "bicubic 2 x",
    "4 x",
    *(f"{d:g} x as far" for d in DISTANCES),
]

Draw = Callable[[Camera], NDArray[np.float32]]


def farther(camera: Camera, factor: float, center: NDArray[np.float64]) -> Camera:
    """The view from `factor` times as far from a `center` (3,), world units, in the same direction."""
    matrix = np.array(camera.world_to_camera, dtype=float)
    matrix[:3, 3] = -matrix[:3, :3] @ (center + factor * (camera.position - center))
    return replace(camera, world_to_camera=matrix)


def resized(camera: Camera, factor: float) -> Camera:
    """The view `factor` times as large."""
    return camera.resized(round(factor * camera.width), round(factor * camera.height))


def enlarged(picture: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """A picture (H, W, 3), larger by a bicubic filter."""
    size = round(factor * picture.shape[1]), round(factor * picture.shape[0])
    channels = [np.asarray(Image.fromarray(picture[..., i]).resize(size, Image.Resampling.BICUBIC)) for i in range(3)]
    return np.stack(channels, -1).clip(0.0, 1.0)


def drawn_truth(run: Run, member: Member) -> Draw:
    """The member's own field, drawn; raises ValueError for one that is not whole, or has holes."""
    assert run.catalog is not None
    assert run.surrogate.field is not None
    name = run.surrogate.base_appearance
    (appearance,) = (one for one in run.catalog.plan.appearances if one.name == name)
    coarse = member.coarse_field(appearance.field)
    if coarse is None or not coarse.whole or not np.isfinite(coarse.values).all():
        raise ValueError(f"{member.path} keeps no whole field without holes")
    samples = SampledField(coarse.values, None, coarse.spacing, coarse.origin)
    if isinstance(appearance, VolumeRendering):
        distance = run.surrogate.field.sample_distances[name]
        return VolumeCaster.of(samples, appearance, sample_distance=distance).draw
    return SurfaceCaster.of(samples, appearance).draw


def errors(truth: Draw, prediction: Draw, camera: Camera, center: NDArray[np.float64]) -> list[float]:
    """Mean squared errors in the columns of the table."""

    def shown(draw: Draw, seen: Camera) -> NDArray[np.float32]:
        return composite(draw(seen), WHITE)

    right = {size: shown(truth, resized(camera, size)) for size in SIZES}
    drawn = {size: shown(prediction, resized(camera, size)) for size in SIZES}
    moved = [farther(camera, factor, center) for factor in DISTANCES]
    return [
        *(mean_squared_error(right[size], drawn[size]) for size in SIZES),
        *(mean_squared_error(right[size], enlarged(drawn[1.0], size)) for size in (2.0, 4.0)),
        *(mean_squared_error(shown(truth, seen), shown(prediction, seen)) for seen in moved),
    ]


def rows_of(run: Run, split: str, members: int, views: int) -> list[list[str]]:
    """Rows of the table, one for each representation."""
    assert run.catalog is not None
    tested = [member for member in run.catalog.members if member.split == split]
    center, rows = np.mean(run.catalog.plan.bounds, axis=0), []
    for representation in run.surrogate.representations:
        surrogate: Surrogate = run.surrogate.using(representation)
        values = []
        for number in spread(len(tested), members):
            member = tested[number]
            truth, prediction = drawn_truth(run, member), surrogate.at(**member.parameters).render
            own = [view for view, split in enumerate(member.view_splits) if split == "test"]
            values += [
                [decibels(error) for error in errors(truth, prediction, member.cameras[own[view]], center)]
                for view in spread(len(own), views)
            ]
        means = np.mean(values, axis=0)
        rows.append(
            [
                run.title if not rows else "",
                split if not rows else "",
                representation,
                *(f"{value:.1f}" for value in means),
            ]
        )
    return rows


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("splatting.zoom", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--members", type=int, default=4, metavar="N", help="of each split")
    parser.add_argument("--views", type=int, default=4, metavar="N", help="of each member")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/quality.md")
    options = parser.parse_args(arguments)
    report, rows = stopwatch(), []
    for path in options.runs:
        for split in ("train", "test"):
            rows += rows_of(Run.open(path), split, options.members, options.views)
            report(f"{path}, {split}")
    words = " ".join(map(str, options.runs))
    command = f"splatting.zoom {words} --members {options.members} --views {options.views}"
    publish(
        f"{table(HEADER, rows)}\n<sub>{made_by(command)}</sub>", RESULTS / "quality.md", "zoom", write=options.write
    )


if __name__ == "__main__":
    main()
