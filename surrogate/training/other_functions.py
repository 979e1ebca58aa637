"""Scores under transfer functions that no image shows: their truth is drawn from the coarse fields of validation members."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering, field_of
from catalogs.vocabulary.cameras import Camera
from native.ray_casting import SampledField, VolumeCaster
from surrogate.evaluation.cases import VALIDATION
from surrogate.evaluation.metrics import WHITE, composite, psnr
from surrogate.evaluation.predictor import pictures_of_all
from surrogate.evaluation.scoring import spread
from surrogate.model import MemberModel, Surrogate
from surrogate.model.representation import FIELD

MOST_MEMBERS, MOST_VIEWS = 4, 4
PIXELS = 512**2  # of a picture, up to which the most are drawn
OPAQUE, NARROW = 0.6, 0.05  # the highest opacity, and the half width of a peak as a share of the values


def other_functions(base: TransferFunction, values: NDArray[np.floating]) -> list[TransferFunction]:
    """Opacity functions with the colours of `base`: rising, falling, and a narrow peak at the median of the field's values."""
    low, high = base.bounds
    half = NARROW * (high - low)
    middle = float(np.clip(np.median(values), low + 1.5 * half, high - 1.5 * half))
    shapes: list[tuple[tuple[float, float], ...]] = [
        ((low, 0.0), (high, OPAQUE)),
        ((low, OPAQUE), (high, 0.0)),
        ((low, 0.0), (middle - half, 0.0), (middle, OPAQUE), (middle + half, 0.0), (high, 0.0)),
    ]
    return [TransferFunction(base.color_points, points, base.opacity_unit_distance) for points in shapes]


def scores_under_other_functions(
    surrogate: Surrogate, catalog: Catalog, splits: Sequence[str] = (VALIDATION,)
) -> dict[str, float]:
    """Mean PSNR (dB) of each representation that can be drawn under any function, on images of members of some splits.

    Nothing where no such member keeps the field that the base appearance shows, or the base is shaded or an isosurface.
    """
    base = None if surrogate.field is None else surrogate.field.appearances[0]
    if not isinstance(base, VolumeRendering) or base.shaded:
        return {}
    unseen = [m for m in catalog.members if m.split in splits and field_of(base) in m.coarse_names()]
    scores: dict[str, list[float]] = {}
    for member in (unseen[i] for i in spread(len(unseen), MOST_MEMBERS)):
        most = number_of_pictures(member.cameras[0], MOST_VIEWS, 1)
        views = [member.cameras[i] for i in spread(len(member.cameras), most)]
        for function, truths in _truths(member, base, views):
            names, prediction = _under(surrogate, function, member)
            for view, truth in zip(views, truths, strict=True):
                for name, picture in zip(names, pictures_of_all(prediction, view), strict=True):
                    scores.setdefault(name, []).append(psnr(truth, composite(picture, WHITE)))
    return {name: float(np.mean(of)) for name, of in scores.items()}


def number_of_pictures(camera: Camera, most: int, fewest: int) -> int:
    """The most pictures through a camera, fewer where they have more than `PIXELS`: all together have no more then."""
    return max(fewest, min(most, round(most * PIXELS / (camera.width * camera.height))))


def _under(surrogate: Surrogate, function: TransferFunction, member: Member) -> tuple[Sequence[str], MemberModel]:
    """The representations that can be drawn under a function, and a member drawn by the last of them."""
    names = surrogate.representations
    try:
        return names, surrogate.using(names[-1]).under(function, member.parameters, outside="allow")
    except ValueError:  # colours, which know no functions
        return (FIELD,), surrogate.using(FIELD).under(function, member.parameters, outside="allow")


def _truths(
    member: Member, base: VolumeRendering, views: Sequence[Camera]
) -> Iterator[tuple[TransferFunction, list[NDArray[np.float32]]]]:
    """Each function, and the pictures of a member's coarse field under it, on white."""
    coarse = member.coarse_field(field_of(base))
    assert coarse is not None
    samples = SampledField(coarse.values, coarse.holes, coarse.spacing, coarse.origin)
    for function in other_functions(base.transfer_function, coarse.values[np.isfinite(coarse.values)]):
        truth = VolumeCaster.of(samples, VolumeRendering(base.name, function))
        yield function, [composite(truth.draw(view), WHITE) for view in views]
