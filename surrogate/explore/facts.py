"""Facts that the page needs before the first image: one JSON value about a surrogate and, where it is there, its catalog.

    title          as given
    parameters     [{name, unit, scale, low, high, least, most, train, validation}]: `low` to `high` was trained, `least` to `most`
                   can be drawn; the last two are the values of members, sorted, for marks
    variations     [{kind: "isovalue", label, unit, scale, low, high, least, most, train, validation},
                    {kind: "transfer_function", label, unit, points: [{name, unit, origin, low, high, least, most} * 4],
                     opacity_points: [[value, opacity] * 4], gradient, color_maps: [{name, gradient}]},
                    {kind: "field", names}]: of a field the base's name first
    histogram      {edges: [65], heights: [64]}: of the base's field over all members, heights the logarithms of counts in [0, 1];
                   null without
    camera         {direction, up, distance, target, field}: unit vectors, world units, vertical degrees
    members        [{name, split, values}]: values in the order of `parameters`
    background     "#rrggbb" that the training images stand on; null where they have alpha
    size           [width, height] of the training images; null without a catalog
    truth          whether there is a catalog whose pictures can be shown
    model          {gaussians, megabytes, seconds, representations: [{name, words, megabytes, milliseconds}]}: those that can draw,
                   `megabytes` of each as stored and `milliseconds` of a picture, null where nobody measured it

A label names the field, with its unit; "" where nothing is known of it.  The values of `points` are places of control points, of
which the base's are the origins.  A gradient is a list of CSS colour stops whose places are percentages between the first and the
last opacity point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, field_of
from catalogs.vocabulary.cameras import OBLIQUE, Camera
from catalogs.vocabulary.parameters import Parameter
from catalogs.vocabulary.variations import Variation
from surrogate.evaluation.scoring import spread
from surrogate.explore.color_maps import NAMES, color_points
from surrogate.explore.run import Run
from surrogate.explore.setting import base_function
from surrogate.model import Surrogate
from surrogate.model.places import limits
from surrogate.model.representation import WORDS
from surrogate.notebook import first_camera

MOST_TICKS, MOST_MEMBERS, MOST_SUMMARIES = 300, 5000, 200
BINS = 64
APART = 1e-3  # of a transfer function's range: how near to its ends control points may come
MARKED = ("train", "validation")  # whose values the page marks

Json = dict[str, Any]


def facts(run: Run) -> Json:
    """All that the module's documentation lists, as JSON values without NaN or infinities.

    Raises as `Run.members` does.
    """
    surrogate, catalog, members = run.surrogate, run.catalog, run.members
    statements = {
        "title": run.title,
        "parameters": [_parameter(p, members) for p in surrogate.space.parameters],
        "variations": [one for v in surrogate.variations if (one := _variation(run, v))],
        "histogram": _histogram(_base_field(surrogate, catalog), members),
        "camera": _first_orbit(run),
        "members": [
            {"name": m.name, "split": m.split, "values": [m.parameters[name] for name in surrogate.space.names]}
            for m in (members[i] for i in spread(len(members), MOST_MEMBERS))
        ],
        "background": surrogate.background and _hexadecimal(surrogate.background),
        "size": None if catalog is None else [run.cameras[0].width, run.cameras[0].height],
        "truth": bool(members),
        "model": {
            "gaussians": len(surrogate.gaussians),
            "megabytes": surrogate.megabytes,
            "seconds": surrogate.training.get("seconds"),
            "representations": [
                {"name": n, "words": WORDS[n], "megabytes": size, "milliseconds": surrogate.scores.milliseconds.get(n)}
                for n, size in surrogate.sizes.items()
            ],
        },
    }
    return dict(_clean(statements))


def _base_field(surrogate: Surrogate, catalog: Catalog | None) -> str:
    """The name of the field that the base appearance shows; "" for the only one, and for images made elsewhere."""
    appearance = _appearance(surrogate.base_appearance, catalog)
    return "" if appearance is None else field_of(appearance)


def _appearance(name: str, catalog: Catalog | None) -> Appearance | None:
    return next((a for a in (catalog.plan.appearances if catalog else ()) if a.name == name), None)


# ---- parameters and variations


def _parameter(parameter: Parameter, members: Sequence[Member]) -> Json:
    return _bounds(parameter) | _marks([(m.split, m.parameters[parameter.name]) for m in members])


def _bounds(parameter: Parameter) -> Json:
    least, most = limits(parameter)
    return asdict(parameter) | {"least": least, "most": most}


def _marks(values: Sequence[tuple[str, float]]) -> Json:
    """The values of training and of validation, given with their splits: each once, sorted, some of very many."""
    by_split = {split: sorted({value for of, value in values if of == split}) for split in MARKED}
    return {split: [places[i] for i in spread(len(places), MOST_TICKS)] for split, places in by_split.items()}


def _variation(run: Run, variation: Variation) -> Json | None:
    """A variation; None for transfer functions around a base that nobody knows any more."""
    if not variation.continuous:
        return {"kind": variation.kind, "names": [variation.base, *variation.parameter_names]}
    if variation.edits_base:
        return _functions(run, variation)
    (parameter,) = variation.space.parameters
    marks = _marks([(s.split, s.values[0]) for s in variation.settings])
    bounds = {name: value for name, value in _bounds(parameter).items() if name != "name"}
    return {"kind": variation.kind, "label": _label(run, variation.settings[0].appearance), **bounds, **marks}


def _label(run: Run, appearance: str) -> str:
    """The name and the unit of the field that an appearance shows; "" where nothing is known."""
    match = _appearance(appearance, run.catalog)
    return "" if match is None or run.catalog is None else run.catalog.plan.field_label(field_of(match))


def _functions(run: Run, variation: Variation) -> Json | None:
    recolorable, base = base_function(run.surrogate), run.base_function
    if base is None:
        return None
    low, high = base.opacity_points[0][0], base.opacity_points[-1][0]
    spanned = base.color_points[0][0], base.color_points[-1][0]
    maps = NAMES if recolorable is not None else ()
    return {
        "kind": variation.kind,
        "label": _label(run, variation.base),
        "unit": next((p.unit for p in variation.space.parameters if p.unit), ""),
        "points": [_point(p, run.origins[p.name], (low, high)) for p in variation.space.parameters],
        "opacity_points": [list(point) for point in base.opacity_points],
        "gradient": _gradient(base.color_points, low, high),
        "color_maps": [{"name": n, "gradient": _gradient(color_points(n, *spanned), low, high)} for n in maps],
    }


def _point(parameter: Parameter, origin: float, ends: tuple[float, float]) -> Json:
    """The place of a control point, whose displacement is the parameter: as far as it stays between the function's `ends`."""
    gap = APART * (ends[1] - ends[0])
    inner, outer = (0.0, 1.0) if parameter.name.endswith("opacity") else (ends[0] + gap, ends[1] - gap)
    least, most = (min(outer, max(inner, origin + limit)) for limit in limits(parameter))
    places = {"low": origin + parameter.low, "high": origin + parameter.high, "least": least, "most": most}
    return {"name": parameter.name, "unit": parameter.unit, "origin": origin, **places}


def _gradient(points: Sequence[tuple[float, float, float, float]], low: float, high: float) -> str:
    """CSS colour stops of colour points (value, red, green, blue), 0 % at the value `low` and 100 % at `high`."""
    stops = []
    for value, *color in points:
        red, green, blue = (round(255.0 * channel) for channel in color)
        stops.append(f"rgb({red} {green} {blue}) {100.0 * (value - low) / (high - low):.3f}%")
    return ", ".join(stops)


def _histogram(field: str, members: Sequence[Member]) -> Json | None:
    """Of the field over members' summaries, of very many evenly chosen ones; damaged summaries are left out."""
    histograms: list[tuple[NDArray[Any], NDArray[np.float64]]] = []  # counts [B] and edges [B + 1]
    for member in (members[i] for i in spread(len(members), MOST_SUMMARIES)):
        with suppress(ValueError):
            summary = member.summary(field)
            if summary is not None and _proper(summary):
                histograms.append((summary.histogram, summary.bin_edges))
    if not histograms:
        return None
    low, high = min(float(edges[0]) for _, edges in histograms), max(float(edges[-1]) for _, edges in histograms)
    places = np.linspace(low, high, BINS + 1)  # [BINS + 1]
    below = [np.interp(places, edges, np.concatenate([[0.0], np.cumsum(counts)])) for counts, edges in histograms]
    heights = np.log1p(np.diff(np.sum(below, axis=0)).clip(0.0))  # [BINS]
    heights = heights / max(float(heights.max()), 1e-300)
    return {"edges": places.tolist(), "heights": heights.tolist()}


def _proper(summary: FieldSummary) -> bool:
    counts, edges = summary.histogram, summary.bin_edges
    finite = np.isfinite(edges).all() and np.isfinite(counts).all()
    return bool(finite and len(counts) and (counts >= 0).all() and (np.diff(edges) > 0).all())


# ---- cameras


def _first_orbit(run: Run) -> Json:
    """The first view: the stored one nearest to `OBLIQUE`."""
    if run.catalog is None:
        return orbit_of(first_camera(run.surrogate.normalization), run.middle)
    return orbit_of(max(run.cameras, key=lambda camera: float(np.dot(-camera.forward, OBLIQUE))), run.middle)


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
    """The same in plain JSON types, None for NaN and infinities, "?" for half characters, which have no UTF-8."""
    if isinstance(value, Mapping):
        return {str(name): _clean(part) for name, part in value.items()}
    if isinstance(value, str):
        return str(value).encode(errors="replace").decode()
    if isinstance(value, list | tuple):
        return [_clean(part) for part in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
