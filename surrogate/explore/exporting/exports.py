"""Files that the page saves."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from surrogate.explore.exporting.kinds import KINDS
from surrogate.explore.exporting.requests import from_message
from surrogate.explore.run import Run


@dataclass(frozen=True)
class Export:
    """A file to be saved."""

    name: str
    media_type: str
    content: bytes


def exported(message: Any, run: Run, go_on: Callable[..., Any] = lambda *_: None) -> Export:
    """The file that a message asks for, see `surrogate.explore.exporting.requests.from_message`.

    `go_on` is called with every picture of a sheet or film that is drawn and written; what it raises ends the work.

    Raises MessageError for a wrong message, ValueError for what can't be made.
    """
    content = from_message(message, run.surrogate).content(run, go_on)
    ending, media_type = KINDS[message["kind"]]
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", run.title).strip("-.") or "surrogate"
    return Export(f"{name}.{ending}", media_type, content)
