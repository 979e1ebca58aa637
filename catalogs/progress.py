"""Progress of a command on one line, with rate and time left: on a terminal, in a notebook and in a log.

Written here rather than taken from tqdm or rich.  In a log tqdm writes a bar ten times a second or nothing, and rich nothing before
the end.  Here a log gets a line every 15 s.
"""

from __future__ import annotations

import math
import shutil
import sys
import time
from collections import deque
from dataclasses import dataclass
from typing import Any, Self, TextIO

RATE_SECONDS = 20.0  # over which a rate is taken
LIVE_SECONDS = 0.2  # between updates on a terminal or in a notebook
LOG_SECONDS = 15.0  # between lines elsewhere, and before the first


class Rate:
    """Items done per second over about the last 20 s; 0 before the second call."""

    def __init__(self) -> None:
        self._history: deque[tuple[float, int]] = deque()  # (time, done)

    def __call__(self, done: int) -> float:
        now = time.perf_counter()
        self._history.append((now, done))
        while len(self._history) > 2 and now - self._history[0][0] > RATE_SECONDS:
            self._history.popleft()
        since, before = self._history[0]
        return max(0.0, (done - before) / (now - since)) if now > since else 0.0


@dataclass(frozen=True)
class Count:
    """Progress of one stage: `done` of `total`, at a rate per second that is 0 while unknown."""

    stage: str
    done: int
    total: int
    rate: float
    unit: str = "images"

    @property
    def seconds_left(self) -> float | None:
        """Estimated seconds to the end; None while the rate is unknown."""
        return (self.total - self.done) / self.rate if self.rate else None

    def __str__(self) -> str:
        counts = f"{self.done} / {self.total} {self.unit}"
        return joined(self.stage, counts, per_second(self.rate, self.unit), time_left(self.seconds_left))


def joined(*parts: str) -> str:
    """The parts of a progress line, empty ones left out."""
    return "  ".join(filter(None, parts))


def per_second(rate: float, unit: str) -> str:
    """A rate, empty while it is 0."""
    return f"{rate:{'.1f' if rate >= 1.0 else '.2g'}} {unit}/s" if rate else ""


def time_left(seconds: float | None) -> str:
    """The remaining time in words, empty for None."""
    return "" if seconds is None else f"{duration(seconds)} left"


def duration(seconds: float) -> str:
    """Seconds as m:ss or h:mm:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class ProgressLine:
    """A line of progress, overwritten on a terminal or in a notebook; elsewhere a new line every 15 s.

    `stream` is standard error by default.  Close it, or use it in a `with` block, so that later output starts on a new line.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._display = _notebook_display() if stream is None else None
        self._handle: Any = None  # of the notebook's output
        self._live = self._terminal or self._display is not None
        self._written = -math.inf if self._live else time.perf_counter()
        self._text, self._pending, self._width = "", False, 0
        self._stage, self._rate = "", Rate()

    def __call__(self, progress: object) -> None:
        """Show `str(progress)`, unless the line was updated just before."""
        self._text, self._pending = str(progress), True
        if self._is_due():
            self._write()

    def count(self, stage: str, done: int, total: int, unit: str = "images") -> None:
        """Show that `done` of `total` images, or of another `unit`, are done."""
        if stage != self._stage:
            self._stage, self._rate = stage, Rate()
            self._rate(done)
        elif done == total or self._is_due():
            self(Count(stage, done, total, self._rate(done), unit))

    def say(self, text: str) -> None:
        """Write a line of its own above the progress."""
        erased = f"\r{'':{self._width}}\r" if self._width else ""
        self._stream.write(f"{erased}{text}\n")
        self._stream.flush()
        if erased:
            self._width, self._pending, self._written = 0, True, -math.inf

    def close(self) -> None:
        """Show the last progress, except in a log, and end the line."""
        if self._live and self._pending:
            self._write()
        if self._width:
            self._stream.write("\n")
            self._stream.flush()
            self._width = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _is_due(self) -> bool:
        return time.perf_counter() - self._written >= (LIVE_SECONDS if self._live else LOG_SECONDS)

    def _write(self) -> None:
        self._written, self._pending = time.perf_counter(), False
        if self._display is not None:
            bundle = {"text/plain": self._text}
            if self._handle is None:
                self._handle = self._display(bundle, raw=True, display_id=True)
            else:
                self._handle.update(bundle, raw=True)
            return
        if self._terminal:
            columns = shutil.get_terminal_size().columns - 1  # a longer line would wrap and could not be erased
            text = self._text[:columns]
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._stream.write(self._text + "\n")
        self._stream.flush()


def _notebook_display() -> Any:
    """IPython's `display` in a notebook's kernel, else None."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return sys.modules["IPython.display"].display if getattr(shell, "kernel", None) is not None else None
