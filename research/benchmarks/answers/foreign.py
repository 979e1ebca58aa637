"""Pictures of another kind than a surrogate's, whose parameters are asked for: how many are flagged.

    python -m research.benchmarks.answers.foreign RUN [RUN ...] [--members 10] [--write]

Each RUN is a folder whose catalog is there, with whole coarse fields.  One stored picture of every validation and test member is
read back, by models that have learnt from neither.  So are pictures of some members' fields that are drawn anew, in other ways.
Eight members drawn at random say how far off pictures may be, many times: shares of the others that are flagged are means.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.members import Member
from catalogs.vocabulary.appearance import VolumeRendering
from native.ray_casting import draw_volume
from research.benchmarks.answers.inverse import SPLITS, Read, read_members
from research.benchmarks.page import RESULTS, command_line, made_by, publish, table
from surrogate.answers.inverse import best_fits
from surrogate.answers.inverse_calibration import MOST
from surrogate.answers.targets import Target
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.evaluation.scoring import spread
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.model.judged import judged
from surrogate.splatting.threads import one_torch_thread

Field = NDArray[np.float32]
Kind = Callable[[Field, VolumeRendering], tuple[Field, VolumeRendering]]


def times_opacity(factor: float) -> Kind:
    """The same field, with another opacity."""

    def drawn(field: Field, appearance: VolumeRendering) -> tuple[Field, VolumeRendering]:
        function = appearance.transfer_function
        points = tuple((value, min(factor * opacity, 1.0)) for value, opacity in function.opacity_points)
        return field, replace(appearance, transfer_function=replace(function, opacity_points=points))

    return drawn


def other_colors(field: Field, appearance: VolumeRendering) -> tuple[Field, VolumeRendering]:
    """The same field, with red and blue exchanged."""
    function = appearance.transfer_function
    points = tuple((value, blue, green, red) for value, red, green, blue in function.color_points)
    return field, replace(appearance, transfer_function=replace(function, color_points=points))


def steepness(field: Field, appearance: VolumeRendering) -> tuple[Field, VolumeRendering]:
    """The gradient's magnitude, over the same range."""
    slopes = np.sqrt(sum(slope**2 for slope in np.gradient(field)))
    return (field.min() + np.ptp(field) * slopes / slopes.max()).astype(np.float32), appearance


KINDS: dict[str, Kind] = {
    "the same, drawn anew": times_opacity(1.0),
    "0.85 x opacity": times_opacity(0.85),
    "1.2 x": times_opacity(1.2),
    "1.5 x": times_opacity(1.5),
    "red and blue exchanged": other_colors,
    "another field": steepness,
}

HEADER = ["run", "members; drawn anew", "stored pictures", *KINDS]


def residual_of(run: Run, surrogate: Surrogate, member: Member, read: Read, kind: Kind) -> float:
    """The root mean square by which the best parameters miss a picture of a `kind`; raises ValueError for a field with holes."""
    assert run.catalog is not None
    (appearance,), (target,) = run.catalog.plan.appearances, read.residuals.targets
    coarse = member.coarse_field()
    assert isinstance(appearance, VolumeRendering)
    assert surrogate.field is not None
    assert target.camera is not None
    if coarse is None or not coarse.whole or not np.isfinite(coarse.values).all():
        raise ValueError(f"{member.path} keeps no whole field without holes")
    values, changed = kind(coarse.values, appearance)
    steps = surrogate.field.sample_distances.get(appearance.name)
    image = draw_volume(values, None, coarse.spacing, coarse.origin, changed, target.camera, sample_distance=steps)
    picture = np.round(255.0 * composite(image, run.catalog.plan.background or WHITE)) / 255.0
    residuals = replace(read.residuals, targets=(Target(picture.astype(np.float32), target.camera),))
    return math.sqrt(best_fits(residuals)[0].cost)


def row_of(run: Run, members: int) -> list[str]:
    """A row of the table."""
    assert run.catalog is not None
    surrogate = judged(run.surrogate, run.catalog)
    read = read_members(surrogate, run.catalog, 1)
    unseen = [one for one in run.catalog.members if one.split in ("validation", "test")]
    right = np.array([math.sqrt(one.fits[0].cost) for one in read])
    some = spread(len(read), members)
    others = {
        name: np.array([residual_of(run, surrogate, unseen[i], read[i], kind) for i in some])
        for name, kind in KINDS.items()
    }
    random, false, flagged = np.random.default_rng(0), [], []
    for _ in range(SPLITS):
        order = random.permutation(len(right))
        most = right[order[:MOST]].max()
        false.append(np.mean(right[order[MOST:]] > most))
        flagged.append([np.mean(each > most) for each in others.values()])
    shares = (np.mean(false), *np.mean(flagged, axis=0))
    return [run.title, f"{len(right)}; {len(some)}", *(f"{share:.0%}" for share in shares)]


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("answers.foreign", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--members", type=int, default=10, metavar="N", help="members that are drawn anew")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/answers.md")
    options = parser.parse_args(arguments)
    rows = [row_of(run, options.members) for run in map(Run.open, options.runs)]
    words = " ".join(map(str, options.runs))
    body = f"{table(HEADER, rows)}\n<sub>{made_by(f'answers.foreign {words}')}</sub>"
    publish(body, RESULTS / "answers.md", "foreign", write=options.write)


if __name__ == "__main__":
    main()
