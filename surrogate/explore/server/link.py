"""A link between Python and an open page: what the page shows is read, and what Python sets is shown."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import Any

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.explore.request import MessageError, within

log = logging.getLogger(__name__)

Heard = Callable[[dict[str, float]], Any]


class PageParameters(MutableMapping[str, float]):
    """The parameters that a page shows, by name: reading gives the newest, setting one moves the page.

    A page asks a few times a second.  Of several pages the one that changed last is read, and all show what is set.  Setting raises
    KeyError for an unknown name, and ValueError for a value that can't be drawn.  Safe to be used from several threads.
    """

    def __init__(self, space: ParameterSpace) -> None:
        self._parameters: dict[str, Parameter] = {p.name: p for p in space.parameters}
        self._values = {p.name: p.middle for p in space.parameters}
        self._number = 0  # of what Python has set
        self._callbacks: list[Heard] = []
        self._lock = threading.Lock()

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __setitem__(self, name: str, value: float) -> None:
        if name not in self._parameters:
            raise KeyError(f"there is no parameter {name!r}: {', '.join(self._parameters)}")
        number = within(value, self._parameters[name])
        with self._lock:
            self._values = {**self._values, name: number}
            self._number += 1

    def __delitem__(self, name: str) -> None:
        raise TypeError(f"a page always shows {name}: it can be set, not removed")

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    def __repr__(self) -> str:
        return f"<parameters of the page: {', '.join(f'{name}={value:g}' for name, value in self._values.items())}>"

    def on_change(self, callback: Heard) -> None:
        """Call `callback` with all values whenever a page has changed them, in a thread of the explorer."""
        self._callbacks.append(callback)

    def follow(self, message: Any) -> dict[str, Any]:
        """Answer a page that shows `parameters` and has heard of `number`: newer values, or null.

        Raises MessageError for another message.
        """
        if not isinstance(message, Mapping) or not isinstance(message.get("parameters"), Mapping):
            raise MessageError("a page says which parameters it shows")
        values = message["parameters"]
        if set(values) != set(self._parameters):
            raise MessageError(f"parameters must be exactly {', '.join(self._parameters)}")
        values = {name: within(values[name], p) for name, p in self._parameters.items()}
        with self._lock:
            if message.get("number") != self._number:  # it has not heard of what was set
                return {"number": self._number, "parameters": self._values if self._number else None}
            if values == self._values:
                return {"number": self._number, "parameters": None}
            self._values = values
        for callback in self._callbacks:
            try:
                callback(dict(values))
            except Exception:
                log.exception("a function that hears of changes has failed")
        return {"number": self._number, "parameters": None}
