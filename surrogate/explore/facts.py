"""Facts that the page needs before the first image: one JSON value about a surrogate and, where it is there, its catalog.

    title          as given
    parameters     [{name, unit, scale, low, high, least, most, train, validation}]: `low` to `high` was trained, `least` to `most`
                   can be drawn; the last two are the values of members, sorted, for marks
    variations     [{kind: "isovalue", label, unit, scale, low, high, least, most, train, validation},
                    {kind: "transfer_function", label, unit, free, points: [{name, unit, origin, low, high, least, most}],
                     function: {color_points, opacity_points, opacity_unit_distance}, knots, color_maps: [{name, points}]},
                    {kind: "field", names}]: of a field the base's name first
    histogram      {edges: [65], heights: [64], samples, most}: of the base's field over all members, heights the logarithms of
                   counts in [0, 1]; counts of all bins and of the fullest; null without
    box            [[x, y, z], [x, y, z]]: the lowest and the highest corner of what is shown, world units
    camera         {direction, up, distance, target, field}: unit vectors, world units, vertical degrees
    members        [{name, split, values}]: values in the order of `parameters`
    background     "#rrggbb" that the training images stand on; null where they have alpha
    size           [width, height] of the training images; null without a catalog
    truth          whether there is a catalog whose pictures can be shown
    model          {gaussians, megabytes, chosen, seconds, representations: [{name, words, megabytes, milliseconds}]}: those that
                   can draw, of which one is `chosen`, `megabytes` of each as stored and `milliseconds` of a picture, null where
                   nobody measured it

A label names the field, with its unit; "" where nothing is known of it.  Where the inner control points of the base
`function` were varied, `points` are the places of their four numbers; `free` says that any other function can be drawn.
`knots` are field values that lie equally far apart on the model's scale.  Points of colour maps have places in [0, 1].
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog, Member
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, TransferFunction, field_of
from catalogs.vocabulary.cameras import OBLIQUE, Camera
from catalogs.vocabulary.parameters import Parameter
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.variations.transfer_function import TransferFunctionVariation
from surrogate.appearance.field_gaussians import FieldGaussians
from surrogate.appearance.scale import ValueScale
from surrogate.evaluation.scoring import spread
from surrogate.explore.color_maps import NAMES, color_points
from surrogate.explore.functions import record_of_function
from surrogate.explore.run import Run
from surrogate.explore.setting import base_function
from surrogate.model import Surrogate
from surrogate.model.places import limits
from surrogate.model.representation import VIEW, WORDS
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
    surrogate, catalog, members, base = run.surrogate, run.catalog, run.members, run.base_function
    statements = {
        "title": run.title,
        "parameters": [_parameter(p, members) for p in surrogate.space.parameters],
        "variations": _variations(run),
        "histogram": _histogram(
            _base_field(surrogate, catalog), members, None if base is None else value_scale(surrogate, base)
        ),
        "box": box_of(run),
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
            "chosen": surrogate.representation(VIEW),
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


def _variations(run: Run) -> list[Json]:
    """Those that the surrogate follows, and transfer functions where any can be drawn though none was varied."""
    variations = run.surrogate.variations
    others = [] if any(v.edits_base for v in variations) else [_functions(run)]
    return [one for one in [*(_variation(run, v) for v in variations), *others] if one]


def box_of(run: Run) -> list[list[float]]:
    """The lowest and the highest corner of what is shown, (2, 3) world units."""
    if run.catalog is not None:
        return np.asarray(run.catalog.plan.bounds, np.float64).tolist()
    center, extent = run.surrogate.normalization.center, run.surrogate.normalization.extent
    return [(center - extent).tolist(), (center + extent).tolist()]


def _variation(run: Run, variation: Variation) -> Json | None:
    """A variation; None for transfer functions around a base that nobody knows any more."""
    if not variation.continuous:
        return {"kind": variation.kind, "names": [variation.base, *variation.parameter_names]}
    if variation.edits_base:
        return _functions(run, variation)
    (parameter,) = variation.space.parameters
    marks = _marks([(s.split, s.values[0]) for s in variation.settings])
    bounds = {name: value for name, value in _bounds(parameter).items() if name != "name"}
    return {"kind": variation.kind, "label": label_of(run, variation.settings[0].appearance), **bounds, **marks}


def label_of(run: Run, appearance: str) -> str:
    """The name and the unit of the field that an appearance shows; "" where nothing is known."""
    match = _appearance(appearance, run.catalog)
    return "" if match is None or run.catalog is None else run.catalog.plan.field_label(field_of(match))


def _functions(run: Run, variation: Variation | None = None) -> Json | None:
    """Transfer functions: those of a variation, any others, or both; None where nobody knows the base."""
    recolorable, base = base_function(run.surrogate), run.base_function
    if base is None or (variation is None and recolorable is None):
        return None
    label = label_of(run, run.surrogate.base_appearance if variation is None else variation.base)
    parameters = () if variation is None else variation.space.parameters
    ends, unit = (base.opacity_points[0][0], base.opacity_points[-1][0]), re.fullmatch(r".*\((.*)\)", label)
    maps = NAMES if recolorable is not None else ()
    return {
        "kind": TransferFunctionVariation.kind,
        "label": label,
        "unit": next((p.unit for p in parameters if p.unit), unit[1] if unit else ""),
        "free": recolorable is not None,
        "points": [_point(p, run.origins[p.name], ends) for p in parameters],
        "function": record_of_function(base),
        "knots": value_scale(run.surrogate, base).to_json(),
        "color_maps": [{"name": name, "points": color_points(name, 0.0, 1.0)} for name in maps],
    }


def value_scale(surrogate: Surrogate, base: TransferFunction) -> ValueScale:
    """The scale that the model has for values under the base transfer function."""
    if isinstance(surrogate.gaussians, FieldGaussians):
        return surrogate.gaussians.field.scale
    return ValueScale.of_function(base)


def _point(parameter: Parameter, origin: float, ends: tuple[float, float]) -> Json:
    """The place of a control point, whose displacement is the parameter: as far as it stays between the function's `ends`."""
    gap = APART * (ends[1] - ends[0])
    inner, outer = (0.0, 1.0) if parameter.name.endswith("opacity") else (ends[0] + gap, ends[1] - gap)
    least, most = (min(outer, max(inner, origin + limit)) for limit in limits(parameter))
    places = {"low": origin + parameter.low, "high": origin + parameter.high, "least": least, "most": most}
    return {"name": parameter.name, "unit": parameter.unit, "origin": origin, **places}


def _histogram(field: str, members: Sequence[Member], scale: ValueScale | None) -> Json | None:
    """Of the field over members' summaries, of very many evenly chosen ones; damaged summaries are left out.

    Its bins are of equal width on the `scale`; without one in the field's unit.
    """
    histograms: list[tuple[NDArray[Any], NDArray[np.float64]]] = []  # counts [B] and edges [B + 1]
    for member in (members[i] for i in spread(len(members), MOST_SUMMARIES)):
        with suppress(ValueError):
            summary = member.summary(field)
            if summary is not None and _proper(summary):
                histograms.append((summary.histogram, summary.bin_edges))
    if not histograms:
        return None
    low, high = min(float(edges[0]) for _, edges in histograms), max(float(edges[-1]) for _, edges in histograms)
    even = np.linspace(0.0, 1.0, BINS + 1)  # [BINS + 1]
    places = low + (high - low) * even if scale is None else scale.values(even)
    below = [np.interp(places, edges, np.concatenate([[0.0], np.cumsum(counts)])) for counts, edges in histograms]
    counts = np.diff(np.sum(below, axis=0)).clip(0.0)  # [BINS]
    heights = np.log1p(counts) / max(float(np.log1p(counts.max())), 1e-300)
    samples, most = float(counts.sum()), float(counts.max())
    return {"edges": places.tolist(), "heights": heights.tolist(), "samples": samples, "most": most}


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
