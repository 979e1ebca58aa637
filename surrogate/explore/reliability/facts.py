"""What the page must know before the first picture: one JSON value about a surrogate and, where it is there, its catalog.

    title          as given
    parameters     [{name, unit, low, high, train, validation}]: the last two are the values of members, sorted, for marks
    variations     [{kind: "isovalue", unit, low, high, train, validation},
                    {kind: "transfer_function", unit, bounds: {name: {low, high}}, opacity_points: [[value, opacity] * 4],
                     gradient, color_maps: [{name, gradient}]},
                    {kind: "field", names}]: of a field the base's name first
    histogram      {edges: [65], heights: [64]}: of the base's field over all members, heights the logarithms of counts in [0, 1];
                   null without
    camera         {direction, up, distance, target, field}: unit vectors, world units, vertical degrees
    members        [{name, split, values}]: values in the order of `parameters`
    background     "#rrggbb" that the training images stand on; null where they have alpha
    size           [width, height] of the training images; null without a catalog
    truth          whether there is a catalog whose pictures can be shown
    model          {gaussians, megabytes, seconds}

A gradient is a list of CSS colour stops whose places are percentages between the first and the last opacity point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import TransferFunction, VolumeRendering, field_of
from catalogs.cameras import OBLIQUE, Camera
from catalogs.catalog import Catalog, Member
from catalogs.parameters import Parameter
from catalogs.variations import Variation
from surrogate.evaluation.scoring import spread
from surrogate.explore.color_maps import NAMES, color_points
from surrogate.explore.reliability.places import base_name
from surrogate.explore.run import Run
from surrogate.explore.setting import base_function
from surrogate.model import Surrogate
from surrogate.notebook import first_camera

MOST_TICKS, MOST_MEMBERS, MOST_SUMMARIES = 300, 5000, 200
BINS = 64
MARKED = ("train", "validation")  # whose values the page marks

Json = dict[str, Any]


def facts(run: Run) -> Json:
    """All that the module's documentation lists, as JSON values without NaN or infinities.

    Raises as `Run.members` does.
    """
    surrogate, catalog, members = run.surrogate, run.catalog, run.members
    found = {
        "title": run.title,
        "parameters": [_parameter(p, members) for p in surrogate.space.parameters],
        "variations": [
            found
            for v in surrogate.visualizations
            if (found := _variation(surrogate, v.variation, catalog)) is not None
        ],
        "histogram": None if catalog is None else _histogram(_base_field(surrogate, catalog), members),
        "camera": _first_orbit(run),
        "members": [
            {"name": m.name, "split": m.split, "values": [m.parameters[name] for name in surrogate.space.names]}
            for m in (members[i] for i in spread(len(members), MOST_MEMBERS))
        ],
        "background": None if surrogate.background is None else _hexadecimal(surrogate.background),
        "size": None if catalog is None else [run.cameras[0].width, run.cameras[0].height],
        "truth": bool(members),
        "model": {
            "gaussians": len(surrogate.gaussians),
            "megabytes": surrogate.megabytes,
            "seconds": surrogate.training.get("seconds"),
        },
    }
    clean: Json = _clean(found)
    return clean


def _base_field(surrogate: Surrogate, catalog: Catalog) -> str:
    """The name of the field that the base appearance shows; "" for the only one, and for images made elsewhere."""
    return next((field_of(a) for a in catalog.plan.appearances if a.name == base_name(surrogate)), "")


# ---- parameters and variations


def _parameter(parameter: Parameter, members: Sequence[Member]) -> Json:
    values = {split: [m.parameters[parameter.name] for m in members if m.split == split] for split in MARKED}
    return {**asdict(parameter), **{split: _ticks(found) for split, found in values.items()}}


def _ticks(values: Sequence[float]) -> list[float]:
    unique = sorted(set(values))
    return [unique[i] for i in spread(len(unique), MOST_TICKS)]


def _variation(surrogate: Surrogate, variation: Variation, catalog: Catalog | None) -> Json | None:
    """A variation; None for transfer functions around a base that nobody knows any more."""
    if not variation.continuous:
        return {"kind": variation.kind, "names": [variation.base, *(s.appearance for s in variation.settings)]}
    if variation.edits_base:
        return _functions(surrogate, variation, catalog)
    (parameter,) = variation.space.parameters
    values = {split: _ticks([s.values[0] for s in variation.settings if s.split == split]) for split in MARKED}
    return {"kind": variation.kind, "unit": parameter.unit, "low": parameter.low, "high": parameter.high, **values}


def _functions(surrogate: Surrogate, variation: Variation, catalog: Catalog | None) -> Json | None:
    recolorable = base_function(surrogate)
    base = recolorable or _stored_function(variation.base, catalog)
    if base is None:
        return None
    low, high = base.opacity_points[0][0], base.opacity_points[-1][0]
    spanned = base.color_points[0][0], base.color_points[-1][0]
    maps = NAMES if recolorable is not None else ()
    return {
        "kind": variation.kind,
        "unit": next((p.unit for p in variation.space.parameters if p.unit), ""),
        "bounds": {p.name: {"low": p.low, "high": p.high} for p in variation.space.parameters},
        "opacity_points": [list(point) for point in base.opacity_points],
        "gradient": _gradient(base.color_points, low, high),
        "color_maps": [{"name": n, "gradient": _gradient(color_points(n, *spanned), low, high)} for n in maps],
    }


def _stored_function(appearance: str, catalog: Catalog | None) -> TransferFunction | None:
    shown = () if catalog is None else catalog.plan.appearances
    found = next((a for a in shown if a.name == appearance), None)
    return found.transfer_function if isinstance(found, VolumeRendering) else None


def _gradient(points: Sequence[tuple[float, float, float, float]], low: float, high: float) -> str:
    """CSS colour stops of colour points (value, red, green, blue), 0 % at the value `low` and 100 % at `high`."""
    stops = []
    for value, *color in points:
        red, green, blue = (round(255.0 * channel) for channel in color)
        stops.append(f"rgb({red} {green} {blue}) {100.0 * (value - low) / (high - low):.3f}%")
    return ", ".join(stops)


def _histogram(field: str, members: Sequence[Member]) -> Json | None:
    """Of the field over members' summaries, of very many evenly chosen ones; damaged summaries are left out."""
    found: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for member in (members[i] for i in spread(len(members), MOST_SUMMARIES)):
        try:
            summary = member.summary(field)
        except ValueError:
            continue
        if summary is None:
            continue
        counts, edges = np.asarray(summary.histogram, np.float64), np.asarray(summary.bin_edges, np.float64)
        proper = np.isfinite(edges).all() and (np.diff(edges) > 0).all() and np.isfinite(counts).all()
        if proper and len(counts) and (counts >= 0).all():
            found.append((counts, edges))
    if not found:
        return None
    low, high = min(float(edges[0]) for _, edges in found), max(float(edges[-1]) for _, edges in found)
    places = np.linspace(low, high, BINS + 1)  # [BINS + 1]
    below = [np.interp(places, edges, np.concatenate([[0.0], np.cumsum(counts)])) for counts, edges in found]
    heights = np.log1p(np.diff(np.sum(below, axis=0)).clip(0.0))  # [BINS]
    heights = heights / max(float(heights.max()), 1e-300)
    return {"edges": places.tolist(), "heights": heights.tolist()}


# ---- cameras


def _first_orbit(run: Run) -> Json:
    """What the page starts with: the stored view that is nearest to `OBLIQUE`."""
    if run.catalog is None:
        whole = run.surrogate.normalization
        return orbit_of(first_camera(whole), whole.center)
    first = max(run.cameras, key=lambda camera: float(np.dot(-camera.forward, OBLIQUE)))
    return orbit_of(first, np.mean(np.array(run.catalog.plan.bounds), axis=0))


def orbit_of(camera: Camera, middle: NDArray[np.float64]) -> Json:
    """A camera (world units) as the page has it: direction, up, distance, target and field, as in the module's documentation.

    Its target is the point of its axis that is nearest to the `middle` (3,), if it looks that way.
    """
    towards = middle - camera.position  # [3]
    along = float(towards @ camera.forward)
    distance = along if along > 0 else max(float(np.linalg.norm(towards)), 1e-6)
    target = camera.position + distance * camera.forward  # [3]
    if np.abs(target - middle).max() < 1e-6 * distance:
        target, distance = middle, float(np.linalg.norm(towards))
    return {
        "direction": (-camera.forward).tolist(),
        "up": camera.up.tolist(),
        "distance": distance,
        "target": target.tolist(),
        "field": camera.vertical_fov_degrees,
    }


# ---- JSON


def _hexadecimal(color: Sequence[float]) -> str:
    return "#" + "".join(f"{round(255.0 * min(1.0, max(0.0, channel))):02x}" for channel in color)


def _clean(value: Any) -> Any:
    """The same in plain JSON types, None for what is no finite number, "?" for half characters, which have no UTF-8."""
    if isinstance(value, Mapping):
        return {str(name): _clean(part) for name, part in value.items()}
    if isinstance(value, str):
        return str(value).encode(errors="replace").decode()
    if isinstance(value, list | tuple):
        return [_clean(part) for part in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
