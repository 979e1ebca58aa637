"""Variations of blobs under a base "dvr", and the catalog of an ensemble that shows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import POINT_PARAMETERS, Variation, VariationSetting, displaced, variation_kind
from tests.support.blobs import Blobs

BASE = "dvr"
# By name: the split, p and the appearances that are shown.
Members = Mapping[str, tuple[str, float, Sequence[str]]]
Draw = Callable[[float, Appearance], Callable[[Camera], NDArray[np.float32]]]


def isovalues(values: Mapping[str, Sequence[float]]) -> Variation:
    """Isosurfaces at the values of each split, `iso=<value>`."""
    settings = tuple(VariationSetting(f"iso={v:g}", (v,), split) for split, some in values.items() for v in some)
    space = ParameterSpace((Parameter("isovalue", min(values["train"]), max(values["train"])),))
    return variation_kind("isovalue")(BASE, space, settings)


def transfer_functions(steps: NDArray[np.float64], places: Mapping[str, ArrayLike]) -> Variation:
    """Transfer functions displaced by multiples, the places (., 4) of each split, of the largest `steps` (4,): `tf-<split>-<i>`."""
    settings = tuple(
        VariationSetting(f"tf-{split}-{i}", tuple(displacement), split)
        for split, some in places.items()
        for i, displacement in enumerate((np.asarray(some) * steps).tolist())
    )
    bounds = zip(POINT_PARAMETERS, steps.tolist(), strict=True)
    return variation_kind("transfer_function")(
        BASE, ParameterSpace(tuple(Parameter(n, -s, s) for n, s in bounds)), settings
    )


def appearance_of(setting: VariationSetting, function: TransferFunction) -> Appearance:
    """The image of a setting whose base has that transfer function."""
    if len(setting.values) == 1:
        return Isosurface(setting.appearance, setting.values[0])
    return VolumeRendering(setting.appearance, displaced(function, setting.values))


def family_catalog(
    path: Path,
    blobs: Blobs,
    function: TransferFunction,
    variations: Sequence[Variation],
    members: Members,
    draw: Draw,
    *,
    view_splits: Sequence[str],
    others: Sequence[Appearance] = (),
    background: tuple[float, float, float] | None = None,
    summary: FieldSummary | None = None,
) -> Catalog:
    """The catalog of what `draw` says that cameras see of p and an appearance: the base's, a setting's or one of the `others`."""
    settings = [setting for variation in variations for setting in variation.settings]
    shown = (VolumeRendering(BASE, function), *(appearance_of(s, function) for s in settings), *others)
    cameras, named = blobs.cameras()[: len(view_splits)], {appearance.name: appearance for appearance in shown}
    plan = CatalogPlan(
        blobs.space,
        shown,
        cameras,
        tuple(view_splits),
        blobs.bounds,
        background=background,
        variations=tuple(variations),
    )
    catalog = Catalog.create(path, plan)
    for name, (split, p, kept) in members.items():
        with catalog.begin_member(name, {"p": p}, split=split, appearances=kept) as writer:
            for appearance in kept:
                seen_by = draw(p, named[appearance])
                for view, camera in enumerate(cameras):
                    writer.write_image(appearance, view, seen_by(camera))
            if summary is not None:
                writer.write_summaries({"": summary})
    return Catalog.open(path)
