"""All contestants by name, in the order of the tables, and the default selection."""

from __future__ import annotations

from collections.abc import Iterable

from research.studies.baselines import (
    gs_surrogate,
    gs_surrogate_separate,
    hexplane_gaussians,
    insitunet,
    kplanes,
    visnerf,
)
from research.studies.baselines.method import PRECISIONS
from research.studies.comparison.contestants import Contestant, EmulatedFieldAlone, OurSurrogate, Published, Recorded
from research.studies.comparison.result import MethodRow

OURS, LIGHT, EMULATED = "ours", "gs-surrogate-light", "emulated-field"
CONTESTANTS: dict[str, Contestant] = {
    contestant.name: contestant
    for contestant in (
        OurSurrogate(OURS, "**this surrogate**", "`surrogate train --minutes`, nothing else said"),
        Published(gs_surrogate.METHOD, "bfloat16"),
        Recorded(
            LIGHT,
            "GS-Surrogate, light",
            "its field with fewer and narrower layers, trained as ours is; in this repository up to commit `f52caebd`",
        ),
        Published(gs_surrogate_separate.FOR_FUNCTIONS, "bfloat16"),
        Published(gs_surrogate_separate.FOR_ISOSURFACES, "bfloat16"),
        Published(hexplane_gaussians.METHOD),
        Published(hexplane_gaussians.MOVING_ALL),
        Published(kplanes.METHOD),
        Published(visnerf.METHOD),
        Published(insitunet.METHOD, "bfloat16"),
        OurSurrogate(
            "ours-in-steps-of-gs-surrogate",
            "this surrogate, in as many steps as GS-Surrogate",
            "`surrogate train --steps`, as many as GS-Surrogate made in the time",
            steps_of=gs_surrogate.METHOD.name,
        ),
        Published(kplanes.NAIVE),
        Published(hexplane_gaussians.NAIVE),
        EmulatedFieldAlone(
            EMULATED,
            "emulated field, drawn",
            "`surrogate train --model field`: principal components of the members' coarse fields, Gaussian processes, ray casting",
        ),
    )
}

# The usual start of planes over many parameters, with which nothing is learnt, is compared on request only; the emulated field
# wherever members keep fields.
ON_REQUEST = LIGHT, EMULATED, kplanes.NAIVE.name, hexplane_gaussians.NAIVE.name
MADE_FOR = {  # kinds of variations, by contestants that learn no other images
    gs_surrogate_separate.FOR_FUNCTIONS.name: "transfer_function",
    gs_surrogate_separate.FOR_ISOSURFACES.name: "isovalue",
}


def usual(kind: str = "") -> tuple[str, ...]:
    """Names of those that are compared where nothing else is said; `kind` is that of the variation, "" for none."""
    return tuple(name for name in CONTESTANTS if name not in ON_REQUEST and MADE_FOR.get(name, kind) == kind)


def ordered(rows: Iterable[MethodRow]) -> list[MethodRow]:
    """The distinct rows in the order of the tables."""
    order = list(CONTESTANTS)
    return sorted(set(rows), key=lambda row: (order.index(row.method), PRECISIONS.index(row.precision)))


def title(row: MethodRow) -> str:
    """Title of a row in tables and plots."""
    return CONTESTANTS[row.method].title + (f", in {row.precision}" if row.precision != "float32" else "")


def chosen(names: Iterable[str], *, kind: str | None = None, with_fields: bool = False) -> list[Contestant]:
    """The contestants of these names, the `usual` ones for none.

    The emulator of the members' fields is among the usual ones where they keep some, `with_fields`. Raises ValueError
    for an unknown name, and for one that is `MADE_FOR` another kind of variation than `kind`; None is any.
    """
    wanted = set(names) or {*usual(kind or ""), *((EMULATED,) if with_fields else ())}
    if unknown := sorted(wanted - set(CONTESTANTS)):
        raise ValueError(f"unknown methods {unknown}; known are {list(CONTESTANTS)}")
    for name in sorted(wanted & set(MADE_FOR)):
        if kind not in (None, MADE_FOR[name]):
            raise ValueError(f"{name} is made for variations of kind {MADE_FOR[name]}, not for {kind or 'none'}")
    return [contestant for name, contestant in CONTESTANTS.items() if name in wanted]
