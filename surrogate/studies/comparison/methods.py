"""All contestants, by name, in the order of the tables."""

from __future__ import annotations

from collections.abc import Iterable

from surrogate.studies.baselines import gs_surrogate, hexplane_gaussians, insitunet, kplanes, visnerf
from surrogate.studies.comparison.contestants import Contestant, OurSurrogate, Published

OURS, LIGHT = "ours", "gs-surrogate-light"
CONTESTANTS: dict[str, Contestant] = {
    contestant.name: contestant
    for contestant in (
        OurSurrogate(OURS, "**this surrogate**", "`surrogate train --minutes`, nothing else said"),
        Published(gs_surrogate.METHOD, "bfloat16"),
        OurSurrogate(
            LIGHT,
            "GS-Surrogate, light",
            "its field with fewer and narrower layers, trained as ours is: `deformation=paper`",
            {"deformation": "paper", "field_precision": "bfloat16"},
            precision="bfloat16",
        ),
        Published(hexplane_gaussians.METHOD),
        Published(kplanes.METHOD),
        Published(visnerf.METHOD),
        Published(insitunet.METHOD, "bfloat16"),
    )
}


def chosen(names: Iterable[str]) -> list[Contestant]:
    """The contestants of these names, all for none; raises ValueError for an unknown one."""
    wanted = set(names) or set(CONTESTANTS)
    if unknown := sorted(wanted - set(CONTESTANTS)):
        raise ValueError(f"unknown methods {unknown}; known are {list(CONTESTANTS)}")
    return [contestant for name, contestant in CONTESTANTS.items() if name in wanted]
