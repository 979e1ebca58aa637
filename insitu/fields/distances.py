"""Sample distances along a ray by appearance: for a new catalog, and for a member of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import Appearance, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import SPLITS
from catalogs.vocabulary.variations import Variation

if TYPE_CHECKING:
    from insitu.fields.member_fields import MemberFields
    from render.quality import SampleDistance

CORNERS = 6  # settings of a variation whose sample distance is measured; the finest serves the whole variation


def measured_distances(
    fields: MemberFields,
    appearances: Sequence[Appearance],
    variations: Sequence[Variation],
    cameras: Sequence[Camera],
    target_decibels: float,
    backends: Mapping[str, str],
) -> dict[str, SampleDistance]:
    """The sample distances that reach the target for a first member, by volume rendering that was measured."""
    from render.quality import choose_for_ensemble

    return {
        a.name: choose_for_ensemble(fields.drawable(a, backends[a.name]), a, cameras, target_decibels)
        for a in _measured(appearances, variations)
    }


def finest_of_families(
    distances: Mapping[str, SampleDistance], appearances: Sequence[Appearance], variations: Sequence[Variation]
) -> dict[str, SampleDistance]:
    """For every volume rendering the finest that was found for it or for one of its variation."""
    volumes = [a.name for a in appearances if isinstance(a, VolumeRendering)]
    related = {name: _related(name, variations) & distances.keys() for name in volumes}
    return {
        name: min((distances[n] for n in distances if n in names), key=_length)
        for name, names in related.items()
        if names
    }


def member_distances(
    fields: MemberFields, appearances: Sequence[Appearance], plan: CatalogPlan, backends: Mapping[str, str]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """The sample distances of a member, by volume rendering, and warnings about them.

    They are the catalog's, unless these were chosen to reach a target and the member's field is harder.  A field is harder that
    changes 1.5 times as much from sample to sample, under the transfer function.  The distances are then measured on two small
    images, and refined for this member if need be.
    """
    from render.quality import HARDER, checked_sample_distance

    recorded = plan.provenance
    planned: dict[str, float] = dict(recorded.get("sample_distances", {}))
    target = recorded.get("target_decibels")
    if target is None:
        return planned, ()
    earlier, notes, distances = recorded.get("measured_changes", {}), [], {}
    for appearance in _measured(appearances, plan.variations):
        field = fields.drawable(appearance, backends[appearance.name])
        if field.mean_change(appearance.transfer_function) <= HARDER * earlier.get(appearance.name, 0.0):
            continue
        checked = checked_sample_distance(field, appearance, plan.cameras, planned[appearance.name], target)
        if checked.note:
            distances[appearance.name] = checked
            notes.append(checked.note)
    refined = finest_of_families(distances, appearances, _continuous(plan.variations))
    return {**planned, **{name: distance.distance for name, distance in refined.items()}}, tuple(notes)


def _measured(appearances: Sequence[Appearance], variations: Sequence[Variation]) -> list[VolumeRendering]:
    """The volume renderings whose sample distance is measured: of a variation, the base and a few that lie far from it."""
    variations = _continuous(variations)
    settings = {s.appearance for v in variations for s in v.settings}
    corners = {name for v in variations for name in v.named("train")[:: max(1, len(v.named("train")) // CORNERS)]}
    volumes = [a for a in appearances if isinstance(a, VolumeRendering)]
    return [a for a in volumes if a.name not in settings or a.name in corners]


def _related(name: str, variations: Sequence[Variation]) -> set[str]:
    """The appearances whose finest sample distance an appearance takes: its own, and those of its variation."""
    families = [{variation.base, *variation.named(*SPLITS)} for variation in _continuous(variations)]
    return {name}.union(*(family for family in families if name in family))


def _continuous(variations: Sequence[Variation]) -> list[Variation]:
    return [v for v in variations if v.continuous]  # nothing is in common between fields


def _length(distance: SampleDistance) -> float:
    return distance.distance
