"""Values of the emulated field: under the pointer, at pins, and how often each occurs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from catalogs.vocabulary.words import one_line
from surrogate.explore.probing import field_member, seen_place, values_at
from surrogate.explore.request import MOST_PINS, FrameRequest, places_of, point_of
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.model.emulated_member import EmulatedMember

KEPT = 8  # fields at the last settings


@dataclass(eq=False)
class Values:
    """Answers by the emulated field of a run, whatever draws its pictures; `edges` (B + 1,) are those of its histogram."""

    run: Run
    edges: Sequence[float] | None = None

    __repr__ = one_line

    def __post_init__(self) -> None:
        self.member = lru_cache(maxsize=KEPT)(self._member)

    def probe(self, request: FrameRequest, message: Mapping[str, Any]) -> dict[str, Any]:
        """The values at the message's `pixel` in the field of the request's first setting, and at `pins`, world places, of each.

        `seen` is the place there with its value, null where nothing is seen; `pins` are values or nulls by setting; `name` and
        `unit` are the field's.  Raises MessageError for a wrong message, ValueError for a run without an emulated field.
        """
        pixel = None if message.get("pixel") is None else point_of(message["pixel"], "pixel", 2)
        pins = places_of(message.get("pins", []), "pins", MOST_PINS)
        member = self.member(request.settings[0])
        place = None if pixel is None else seen_place(member, request.camera, pixel)
        field, quantity = member.field(), member.quantity
        pinned = [values_at(self.member(setting).field(), pins) for setting in request.settings] if pins else []
        answer = {"pins": pinned, "name": quantity.name, "unit": quantity.unit}
        if place is None:
            return answer | {"seen": None}
        return answer | {"seen": {"place": place.tolist(), "value": None, **(values_at(field, [place])[0] or {})}}

    def here(self, request: FrameRequest) -> dict[str, Any]:
        """Shares of the field's samples in bins between `edges`; raises ValueError for a run without an emulated field."""
        field = self.member(request.settings[0]).field()
        values = field.values if field.holes is None else field.values[~field.holes]
        edges = np.asarray(self.edges if self.edges is not None else np.linspace(values.min(), values.max(), 65))
        return {"edges": edges.tolist(), "shares": (np.histogram(values, edges)[0] / values.size).tolist()}

    def _member(self, setting: Setting) -> EmulatedMember:
        if setting.cut is not None:
            return self.member(replace(setting, cut=None)).cut_to(setting.cut)
        return field_member(self.run.surrogate, setting)
