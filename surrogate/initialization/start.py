"""Starts of the Gaussians: on points that the hook sampled by opacity, points from pictures, or anywhere in the box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering, field_of
from catalogs.vocabulary.variations import Variation
from surrogate.appearance.averages import averages_reference
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians, FieldValues
from surrogate.gaussians import Gaussians, Normalization
from surrogate.initialization.pictures import StartPoints
from surrogate.randomness import generator
from surrogate.settings import TrainingSettings

FIRST_OPACITY = 0.2
FIRST_SCALE = 0.25  # times the mean distance of as many Gaussians, evenly in the box
FIRST_SPREAD = 0.08  # of the values in a Gaussian, on their scale
LEAST_EXTINCTION = 0.1  # relative to the unit distance, that the thickness at the start is chosen for
START_NORMAL = 0.8  # length of normals: 1 is the longest that means anything


def initial_points(
    settings: TrainingSettings, catalog: Catalog, appearance: str, normalization: Normalization
) -> StartPoints | None:
    """The points of all training members' summaries, or None where Gaussians are to start anywhere in the box.

    They are of the field that `appearance` shows.  Their colours are those of the transfer function, where it has one.  Raises
    ValueError where `settings.initialization` is "in-situ" and the catalog has no points, or where its pictures tell too few.
    """
    if settings.initialization == "random":
        return None
    if settings.initialization == "sfm":
        return _from_pictures(settings, catalog, appearance, normalization)
    drawn_as = next(a for a in catalog.plan.appearances if a.name == appearance)
    summaries = [m.summary(field_of(drawn_as)) for m in catalog.members if m.split == "train"]
    sampled = [s for s in summaries if s is not None and len(s.points)]
    if not sampled and settings.initialization == "in-situ":
        raise ValueError(
            'training.initialization is "in-situ", but no training member of this catalog has sampled points: '
            'set it to "auto" or "random"'
        )
    if not sampled:
        return None
    places = normalization.points(np.concatenate([s.points for s in sampled]))  # [M, 3]
    if not isinstance(drawn_as, VolumeRendering):
        return StartPoints(places, None)
    values = np.concatenate([s.point_values for s in sampled]).astype(np.float64)  # [M]
    return StartPoints(places, drawn_as.transfer_function.colors(values), values)


def surface_points(
    settings: TrainingSettings, catalog: Catalog, variation: Variation, normalization: Normalization
) -> StartPoints | None:
    """Points that the hook sampled on the isosurfaces which `variation` trains, of all training members; None where it has none."""
    if settings.initialization not in ("auto", "in-situ"):
        return None
    names, points = variation.named("train"), []
    for surface in (a for a in catalog.plan.appearances if a.name in names and isinstance(a, Isosurface)):
        for member in (m for m in catalog.members if m.split == "train"):
            summary = member.summary(field_of(surface))
            if summary is not None and len(summary.points):
                on_it = summary.point_values == summary.point_values.dtype.type(surface.isovalue)  # [M]
                points.append(summary.points[on_it])
    places = np.concatenate(points) if points else np.empty((0, 3))
    return StartPoints(normalization.points(places), None) if len(places) else None


def _from_pictures(
    settings: TrainingSettings, catalog: Catalog, appearance: str, normalization: Normalization
) -> StartPoints:
    """Points that the pictures of one member tell, slower and coarser than what the hook knew."""
    from surrogate.initialization.pictures import representative_member
    from surrogate.initialization.structure_from_motion import structure_from_motion_points

    member = representative_member(catalog, appearance)
    return structure_from_motion_points(catalog, member, appearance, normalization, seed=settings.seed)


def initial_gaussians(
    settings: TrainingSettings,
    box: NDArray[np.float64],
    points: StartPoints | None,
    color: NDArray[np.float64],
    field: FieldValues | None = None,
) -> AnyGaussians:
    """The Gaussians that training starts from, of colour degree 0 where it is still to be chosen.

    Parameters
    ----------
    box : (2, 3), low and high corner of the volume in normalized coordinates.
    points : where to put them; None puts them uniformly in the box.
    color : (3,), straight RGB of a Gaussian whose point has no colour of its own.
    field : what the values mean that they carry; None where they carry colours.
    """
    count, random = settings.gaussians, generator(settings.seed, "initialization")
    spacing = float(np.prod(box[1] - box[0]) / count) ** (1.0 / 3.0) or float((box[1] - box[0]).max()) / count
    colors = np.broadcast_to(color, (count, 3))  # [N, 3]
    values = None if field is None else field.scale.values(random.uniform(0.0, 1.0, count))  # [N]
    if points is None:
        places = random.uniform(box[0], box[1], (count, 3))  # [N, 3]
    else:
        chosen = random.choice(len(points.places), count, replace=len(points.places) < count)  # [N]
        places = points.places[chosen] + random.normal(0.0, 0.25 * spacing, (count, 3))  # [N, 3]
        colors = colors if points.colors is None else points.colors[chosen]
        values = values if points.values is None else points.values[chosen]
    flat = np.zeros((count, 9 * (settings.color_degree == 1)))
    opacity_logit = float(np.log(FIRST_OPACITY / (1.0 - FIRST_OPACITY)))
    gaussians = Gaussians(
        means=torch.tensor(places, dtype=torch.float32),
        log_scales=torch.full((count, 3), float(np.log(FIRST_SCALE * spacing))),
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        opacity_logits=torch.full((count,), opacity_logit),
        colors=torch.tensor(np.concatenate([colors, flat], axis=1), dtype=torch.float32),
    )
    return gaussians if field is None or values is None else _with_values(gaussians, field, values)


def _with_values(gaussians: Gaussians, field: FieldValues, values: NDArray[np.float64]) -> FieldGaussians:
    """The same in place and opacity, carrying field values (N,)."""
    carried = torch.zeros(len(gaussians), 2)  # [N, 2]
    carried[:, 0] = torch.from_numpy(field.scale.places(values).clip(0.0, 1.0))
    carried[:, 1] = float(np.log(FIRST_SPREAD))
    extinctions = averages_reference(field.table(field.base).nodes, carried[:, 0].double(), carried[:, 1].double())
    depths = torch.nn.functional.softplus(gaussians.opacity_logits.double())  # [N]
    thickness = (depths / extinctions[:, 0].clamp(min=LEAST_EXTINCTION)).clamp(min=1e-3)  # [N]
    logits = (thickness + torch.log(-torch.expm1(-thickness))).float()  # [N]
    return FieldGaussians(gaussians.means, gaussians.log_scales, gaussians.quats, logits, carried, field)


def with_random_normals(gaussians: Gaussians, seed: int) -> Gaussians:
    """The same, whose colours are normals of a lit surface: they point anywhere, and are short enough to grow."""
    normals = generator(seed, "normals").standard_normal((len(gaussians), 3))  # [N, 3]
    normals *= START_NORMAL / np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(gaussians, colors=torch.tensor(normals, dtype=torch.float32))
