"""Kinds of appearance that other packages add, by entry points of the group `gs_surrogate.appearances`.

    [project.entry-points."gs_surrogate.appearances"]
    slice = "my_package:Slice"

The entry point's name is the kind, its object a class as `PluginAppearance` describes it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray

from catalogs.plugins import APPEARANCES, plugins
from catalogs.vocabulary.cameras import Camera


@runtime_checkable
class PluginAppearance(Protocol):
    """An appearance of another package: a frozen dataclass, whose fields JSON can hold.

    A catalog records its fields, and makes it again with these as keyword arguments: lists come in place of tuples.
    The constructor raises ValueError or TypeError for values that can't be drawn.
    """

    @property
    def name(self) -> str:
        """Its own among a catalog's appearances."""

    @property
    def field(self) -> str:
        """The one of a member's fields that is shown; "" for the only one."""

    def pictures(self, grid: Any, cameras: Sequence[Camera], *, float_output: bool) -> Iterable[NDArray[Any]]:
        """Premultiplied RGBA (height, width, 4) of a `render.Grid` for each camera: uint8, or float32 in [0, 1]."""


@dataclass(frozen=True)
class MissingAppearance:
    """An appearance of a catalog whose kind no installed package has: its pictures can be used, and none can be drawn.

    `record` is the catalog's own, as JSON text.
    """

    name: str
    record: str

    @property
    def kind(self) -> str:
        return str(json.loads(self.record).get("kind"))

    @property
    def field(self) -> str:
        """The field that it shows."""
        return str(json.loads(self.record).get("field", ""))


def plugin_kind(appearance: Any) -> str:
    """The kind under which an appearance's class is registered; raises ValueError where it is not, as none could read it again."""
    for kind, form in plugins(APPEARANCES).items():
        if form is type(appearance):
            return kind
    raise ValueError(
        f"appearance {appearance.name!r}: no installed package registers {type(appearance).__name__} as an entry point of the "
        f"group {APPEARANCES}"
    )


def check_present(appearances: Iterable[object]) -> None:
    """Raise ValueError for the first appearance whose kind no installed package has."""
    for appearance in appearances:
        if isinstance(appearance, MissingAppearance):
            raise ValueError(
                f"appearance {appearance.name!r} is of kind {appearance.kind!r}, which no installed package has: install the "
                f"one that has it (entry points, group {APPEARANCES}), or choose others"
            )
