"""Agreement of a catalog with the options of a caller, and of a member with the catalog."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.store.catalog import Catalog, CatalogPlan, Member
from catalogs.vocabulary.appearance import appearance_to_json
from catalogs.vocabulary.quantity import quantities_of
from catalogs.vocabulary.scene import PlannedMember, ViewPlan
from catalogs.vocabulary.words import shortened
from insitu.fields.boxes import Box, cameras_around, check_inside, is_smaller, same_box
from insitu.members.planning import Pilot, PlanOptions, given_distances, is_catalog, plan_catalog

SOURCE = "source"  # in the provenance of a plan, and of a member: where fields come from
READING = "reading"  # in the provenance of a plan: choices of a command that its next run takes over


def agreeing_catalog(path: Path, options: PlanOptions) -> Catalog | None:
    """The catalog at `path`, if there is one; raises ValueError naming everything in which `options` differ from it."""
    if not is_catalog(path):
        return None
    catalog = Catalog.open(path)
    differences = disagreements(catalog.plan, options)
    if differences:
        raise ValueError(
            f"catalog {catalog.path} was made with another plan, and every member must share it: "
            + "; ".join(differences)
            + ". Take the catalog's values (leave the argument out), or write to a new catalog"
        )
    return catalog


def create_catalog(path: Path, pilot: Pilot, options: PlanOptions) -> Catalog:
    """A new catalog; or the one that another process made meanwhile: its plan holds, if `options` agree with it."""
    try:
        return Catalog.create(path, plan_catalog(pilot, options))
    except (ValueError, FileExistsError):
        catalog = agreeing_catalog(path, options)
        if catalog is None:
            raise
        return catalog


def disagreements(plan: CatalogPlan, options: PlanOptions) -> list[str]:
    """Everything in which `options` differ from the plan of a catalog, each named by its place with both values."""
    recorded = plan.provenance
    has_distances = not {"target_decibels", "sample_distances"}.isdisjoint(recorded)  # isosurfaces have none
    target = options.target_decibels if has_distances else None
    distances = options.sample_distance and given_distances(options.sample_distance, plan.appearances)
    pairs: dict[str, tuple[Any, Any]] = {
        "space": (options.space and options.space.to_json(), plan.space.to_json()),
        "appearances": (options.appearances and _records(options.appearances), _records(plan.appearances)),
        "variations": (
            options.variations and _records(plan.in_field_units(options.variations)),
            _records(plan.variations),
        ),
        "image_format": (options.image_format, plan.image_format),
        "target_decibels": (target, recorded.get("target_decibels")),
        "sample_distances": (distances, recorded.get("sample_distances")),
    }
    compared = {place: pair for place, pair in pairs.items() if pair[0] is not None}
    compared |= {
        key: (value, recorded.get(key)) for key, value in options.provenance.items() if key not in (SOURCE, READING)
    }
    if SOURCE in options.provenance and SOURCE in recorded:  # catalogs had none once
        compared[SOURCE] = _places_of(options.provenance[SOURCE], recorded[SOURCE])
    differences = [s for place, (wanted, theirs) in compared.items() for s in differing(wanted, theirs, place)]
    differences += _other_labels(options, plan)
    if options.bounds is not None and not same_box(options.bounds, plan.bounds):
        differences.append(f"bounds: {options.bounds} here, {plan.bounds} in the catalog")
    if options.views is not None:
        differences += _differing_views(options.views, plan)
    return differences


def _places_of(here: Mapping[str, Any], there: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Two sources of fields without the contents of files, which are compared member by member.

    Nor is the name of an array where one of them takes the only array of each file, whatever its name.
    """
    counts = sorted(len(source.get("arrays", ())) for source in (here, there))
    ignored = {"contents", "arrays"} if counts == [0, 1] else {"contents"}
    first, second = ({key: s[key] for key in s if key not in ignored} for s in (here, there))
    return first, second


def _other_labels(options: PlanOptions, plan: CatalogPlan) -> list[str]:
    """Sentences about each field that `options` call otherwise than the plan does, or give another unit."""
    try:
        wanted = quantities_of(options.fields, plan.fields)
    except ValueError as error:
        return [str(error)]
    labels = {name: plan.field_label(name) for name in wanted}
    return [f"fields: {q} here, {labels[n] or 'none'} in the catalog" for n, q in wanted.items() if str(q) != labels[n]]


def _records(values: Sequence[Any]) -> list[Any]:
    return [value.to_json() if hasattr(value, "to_json") else appearance_to_json(value) for value in values]


def misplaced(catalog: Catalog, members: Iterable[PlannedMember]) -> list[str]:
    """Stored members that have a planned one's name, but other parameters, another split or other appearances."""
    planned = {m.name: m for m in members}
    differences = []
    for member in catalog.members:
        if member.name in planned:
            wanted = planned[member.name]
            differences += differing(wanted.parameters, member.parameters, f"{member.name} parameters")
            differences += differing(wanted.split, member.split, f"{member.name} split")
            differences += _differing_appearances(wanted, member)
    return differences


def _differing_appearances(wanted: PlannedMember, member: Member) -> list[str]:
    here = set(member.appearances if wanted.appearances is None else wanted.appearances)
    there = set(member.appearances)
    if here == there:
        return []
    only_here, only_there = (shortened(sorted(names), 3) or "none" for names in (here - there, there - here))
    return [f"{member.name} appearances: {only_here} only here, {only_there} only in the catalog"]


def notes_on_member(box: Box, parameters: Mapping[str, float], plan: CatalogPlan) -> list[str]:
    """Warnings about a member that fills `box`; raises ValueError where it reaches out of the ensemble's."""
    check_inside(box, plan.bounds)
    notes = list(plan.space.outside([float(parameters[name]) for name in plan.space.names]).values())
    if plan.provenance.get("bounds_from") != "given" and is_smaller(box, plan.bounds):
        notes.append(
            f"the member's box {box} is not the first member's {plan.bounds}, around which the "
            "cameras stand: check spacing and origin"
        )
    return notes


def differing(wanted: Any, present: Any, place: str) -> list[str]:
    """Sentences naming each leaf in which two JSON-like values differ, both as written to disk."""
    wanted, present = _plain(wanted), _plain(present)
    if isinstance(wanted, dict) and isinstance(present, dict):
        keys = [*wanted, *(k for k in present if k not in wanted)]
        return [s for k in keys for s in differing(wanted.get(k), present.get(k), f"{place}.{k}")]
    if isinstance(wanted, list) and isinstance(present, list) and len(wanted) == len(present):
        names = [w.get("name", i) if isinstance(w, dict) else i for i, w in enumerate(wanted)]
        pairs = zip(names, wanted, present, strict=True)
        return [s for name, w, t in pairs for s in differing(w, t, f"{place}.{name}")]
    return [] if wanted == present else [f"{place}: {_short(wanted)} here, {_short(present)} in the catalog"]


def _differing_views(views: ViewPlan, plan: CatalogPlan) -> list[str]:
    wanted = cameras_around(plan.bounds, views)
    if len(wanted) != len(plan.cameras):
        return [f"views: {len(wanted)} here, {len(plan.cameras)} in the catalog"]
    for mine, theirs in zip(wanted, plan.cameras, strict=True):
        for name in ("width", "height", "fx", "fy"):
            if not np.isclose(getattr(mine, name), getattr(theirs, name), rtol=1e-9):
                return [f"views: camera {name} {getattr(mine, name):g} here, {getattr(theirs, name):g} in the catalog"]
        slack = 1e-6 * (1.0 + float(np.abs(mine.position).max()))
        if not np.allclose(mine.world_to_camera, theirs.world_to_camera, rtol=0, atol=slack):
            return ["views: the cameras stand elsewhere (fill) than in the catalog"]
    return []


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(dict(value) if isinstance(value, Mapping) else value))


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 80 else text[:77] + "..."
