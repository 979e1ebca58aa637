"""A catalog of small members that keep coarse fields: a blob that grows with p, volume rendered and as an isosurface."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from catalogs.vocabulary.variations.isovalue import isovalue_family
from tests.support.hooked import FUNCTION, blob

TRAINED, VALIDATED, TESTED = (0.0, 0.25, 0.5, 0.75, 1.0), (0.6,), (0.35,)
SIZE = 12


def field(p: float):  # type: ignore[no-untyped-def]
    """Values (12, 12, 12) at p."""
    return blob(size=SIZE) * (0.7 + 0.3 * p)


def rendered(
    path: Path, *, coarse_field: bool = True, surface: bool = True, of: Callable[[float], Any] = field
) -> Catalog:
    """The catalog of a field at `path`, with coarse fields or without; 16² images from 12 views."""
    base = VolumeRendering("dvr", FUNCTION)
    family = isovalue_family("dvr", train=(0.2, 0.4), validation=(0.3,), test=(0.35,))
    varied = {"variations": [family.variation]} if surface else {}
    shown: list[VolumeRendering | Isosurface] = [base, *(family.appearances if surface else ())]  # type: ignore[list-item]
    space = ParameterSpace((Parameter("p", 0.0, 1.0),))
    views = ViewPlan(frequency=1, width=16, height=16)
    with insitu.Session(
        path, space=space, appearances=shown, views=views, coarse_field=coarse_field, **varied
    ) as session:
        for split, values in (("train", TRAINED), ("validation", VALIDATED), ("test", TESTED)):
            for p in values:
                session.render_member(of(p), {"p": p}, spacing=(1.1 / (SIZE - 1),) * 3, split=split)
    return Catalog.open(path)
