"""Notebook cards of a surrogate, and of its Gaussians at some parameters: facts and a small image, as HTML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.notebook.cards import WHITE, CardImage, card, never_failing, on_background
from catalogs.store.notebook.html import CAPTIONED
from catalogs.vocabulary.cameras import OBLIQUE, Camera
from catalogs.vocabulary.numbers import text
from catalogs.vocabulary.parameters import ParameterSpace
from surrogate.deformation.values import ValuesDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Normalization
from surrogate.splatting.threads import one_torch_thread

WIDTH = 176  # pixels of the picture
FIELD = 30.0  # degrees
FILL = 0.9  # of the frame, by the sphere around the volume's box


def surrogate_html(surrogate: Any) -> str:
    """The card of a surrogate, with a picture at the middle of its parameters; never raises."""
    with one_torch_thread():
        return never_failing("Surrogate", lambda: _surrogate_card(surrogate))


def member_html(member: Any) -> str:
    """The card of one member, as its Gaussians or its emulated field; never raises."""
    with one_torch_thread():
        return never_failing(type(member).__name__, lambda: _member_card(member))


def first_camera(normalization: Normalization, side: int = WIDTH) -> Camera:
    """A camera that sees the whole box, cubic as the longest of its sides, from where catalogs are shown as well."""
    distance = math.sqrt(3.0) * normalization.extent / math.sin(math.atan(FILL * math.tan(math.radians(FIELD) / 2.0)))
    toward = np.asarray(OBLIQUE) / np.linalg.norm(OBLIQUE)  # [3]
    position = normalization.center + distance * toward
    return Camera.look_at(position, normalization.center, vertical_fov_degrees=FIELD, width=side, height=side)


def _surrogate_card(surrogate: Any) -> str:
    rows = [
        *(("parameter", words) for words in _bounds(surrogate.space)),
        *(("follows", _followed(visualization)) for visualization in surrogate.visualizations),
        *_contents(surrogate),
        ("size", f"{surrogate.megabytes:.2f} MB"),
        *_trained(surrogate.training),
    ]
    pictures, notes = list[CardImage](), list[str]()
    try:
        pictures.append(_middle(surrogate))
    except Exception as error:  # the facts are worth showing without it
        notes.append(f"no picture: {type(error).__name__}: {error}")
    return card("Surrogate", rows, pictures, notes, width=WIDTH)


def _contents(surrogate: Any) -> list[tuple[str, str]]:
    """The parts of a surrogate: Gaussians, an emulator of the field, or both."""
    contents = list[tuple[str, str]]()
    if count := len(surrogate.gaussians):
        directed = ", colours depend on the direction" if surrogate.gaussians.color_degree else ""
        contents = [("Gaussians", f"{count:,}{directed}"), ("deformation", surrogate.deformation.kind)]
    emulators = () if surrogate.field is None else surrogate.field.emulators.emulators.values()
    return [*contents, *(("emulated field", repr(emulator).strip("<>")) for emulator in emulators)]


def _member_card(member: Any) -> str:
    rows = [*((name, _value(value)) for name, value in member.parameters.items()), *member.contents]
    picture = CardImage(on_background(_image_of(member)), title=_listed(member.parameters))
    return card("One member", rows, [picture], width=WIDTH)


def _middle(surrogate: Any) -> CardImage:
    values = {p.name: p.middle for p in surrogate.space.parameters}
    rgb = on_background(_image_of(surrogate.at(values)), surrogate.background or WHITE)
    words = _listed(values)
    caption = f"at {words}" if 0 < len(values) <= CAPTIONED else "at the middle of the parameters"
    return CardImage(rgb, caption if values else "", words)


def _image_of(member: Any) -> NDArray[np.float32]:
    return member.render(first_camera(member.normalization))


def _listed(parameters: Mapping[str, float | str]) -> str:
    return ", ".join(f"{name} {_value(value)}" for name, value in parameters.items())


def _bounds(space: ParameterSpace) -> list[str]:
    return [f"{p.name} from {p.text(p.low)} to {p.text(p.high)} {p.unit}".rstrip() for p in space.parameters]


def _followed(visualization: Visualization) -> str:
    """The visualization parameters of a variation, in words."""
    variation = visualization.variation
    if not variation.continuous:
        return f"other fields: appearance {', '.join(setting.appearance for setting in variation.settings)}"
    if isinstance(visualization.deformation, ValuesDeformation):
        low, high = visualization.deformation.base.bounds
        return f"any transfer function over field values {low:g} to {high:g}"
    bounds = ", ".join(_bounds(variation.space))
    own = "" if visualization.gaussians is None else f", {len(visualization.gaussians):,} Gaussians of its own"
    return bounds + own


def _trained(training: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The row that says how it was trained, as far as that is known."""
    said = [f"{training['steps']:,} steps"] if "steps" in training else []
    said += [f"in {training['seconds']:,.0f} s"] if "seconds" in training else []
    said += [f"on pictures of {training['appearance']}"] if training.get("appearance") else []
    return [("trained", " ".join(said))] if said else []


def _value(value: float | str) -> str:
    return value if isinstance(value, str) else text(value)
