"""Rendering in another process while the simulation goes on: the loop pays a copy.

The renderer is a fresh interpreter (`python -m insitu.hook.renderer`), so no script is run twice and no thread or
lock is inherited.
It is connected by one socket, for small messages, and one piece of shared memory for each queued member.  It renders one
member after the other; a member's memory is used again once that is stored.

A renderer crash neither raises in the loop nor blocks it.  When the renderer dies (a crash of the graphics driver, the system
out of memory), another one starts and tries the member once more, a few times in a row.  A silent renderer is
killed.  It ends with this process.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time as clock
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from socket import socketpair

from insitu.background.segments import new_memory, pack
from insitu.fields.member_fields import LocalField
from insitu.members.planning import PlanOptions
from insitu.members.request import MemberArguments
from insitu.members.result import RenderedMember

WAITING = 2  # members that may be held: one being rendered and one waiting
RESTARTS = 5  # without a member that was rendered between them
TRIES = 2  # of a member whose renderer dies
SILENCE_SECONDS = 1800.0  # without an image, after which a renderer counts as stuck
TICK_SECONDS = 0.5
FAREWELL_SECONDS = 10.0
PULSE = struct.Struct("=dQ")  # when the renderer last did something, and how many images the member has

Warn = Callable[[Warning], None]
Settled = Callable[[str, Mapping[str, float], "RenderedMember | str"], None]


class RendererWarning(UserWarning):
    """The renderer in the background died, or is slower than the loop."""


@dataclass(eq=False)
class QueuedMember:
    """A member that waits or is being rendered; `memory` is the number of its piece."""

    name: str
    parameters: Mapping[str, float]
    memory: int
    packed: bytes
    tries: int = 0
    sent: bool = False


@dataclass(eq=False)
class _RendererProcess:
    """A running interpreter and the way to it."""

    process: subprocess.Popen[bytes]
    way: Connection
    started: float = field(default_factory=clock.monotonic)


class Background:
    """Members of one session that are rendered elsewhere, at most `waiting` of them held at any time.

    `settled` is called, whenever the loop calls the session, with a member's name, its parameters, and its `RenderedMember`, or
    the reason why it is missing.  Each queued member takes the memory of its fields.
    """

    def __init__(
        self,
        catalog: Path,
        options: PlanOptions,
        waiting: int,
        *,
        settled: Settled,
        warn: Warn,
        progress: Callable[[int], None],
    ) -> None:
        self.catalog, self._options, self._settled = catalog.absolute(), options, settled
        self._warn, self._progress = warn, progress
        self._memories = [new_memory() for _ in range(waiting)]
        self._free = list(range(waiting))
        self._pulse = new_memory()
        os.pwrite(self._pulse, PULSE.pack(clock.monotonic(), 0), 0)
        self._tasks: deque[QueuedMember] = deque()
        self._renderer: _RendererProcess | None = None
        self._deaths, self._unable = 0, ""
        self._settled_some = self._warned_of_waiting = False
        self._lock = threading.RLock()
        self._owner = os.getpid()
        self._open = True
        atexit.register(self._at_exit)
        self._start()  # it loads what it needs while the simulation makes its first step

    def holds(self, name: str, parameters: Mapping[str, float]) -> QueuedMember | None:
        """The member that is not stored yet and has this name or these parameters."""
        self.take_results()
        with self._lock:
            return next((t for t in self._tasks if t.name == name or t.parameters == parameters), None)

    def submit(self, member: MemberArguments, field: LocalField) -> None:
        """Copy the fields of a member, whose name is set, and queue it; blocks, with one warning, while the queue is full.

        Raises OSError where there is no memory for the copy.
        """
        if self._owner != os.getpid() or not self._open:
            raise ValueError(
                "this session is closed, or belongs to the process that this one was forked from: make one here"
            )
        with self._lock:
            self._take_results()
            while not self._free:
                self._say_waiting()
                self._take_results(wait=True)
            memory = self._free.pop()
            try:
                packed = pack((field, member), self._memories[memory])
            except BaseException:
                self._free.append(memory)
                raise
            self._tasks.append(QueuedMember(str(member.name), member.parameters, memory, packed))
            self._send()

    def take_results(self) -> None:
        """Tell of the members that are done with."""
        if self._open and self._owner == os.getpid():
            with self._lock:
                self._take_results()

    def close(self, *, at_once: bool = False) -> None:
        """Wait for the members that are held, unless they are to be given up `at_once`; the renderer ends in any case."""
        if self._owner != os.getpid() or not self._open:
            return
        with self._lock:
            self._open = False
            atexit.unregister(self._at_exit)
            try:
                while self._tasks and not at_once:
                    self._take_results(wait=True)
            finally:
                self._end_renderer()
                self._give_up("rendering was interrupted")
                for descriptor in (*self._memories, self._pulse):
                    os.close(descriptor)

    def _at_exit(self) -> None:
        """End a session that nobody closed: at once after Ctrl-C, else when all is rendered."""
        self.close(at_once=isinstance(getattr(sys, "last_value", None), KeyboardInterrupt))

    def _say_waiting(self) -> None:
        if self._settled_some and not self._warned_of_waiting:  # the first member also waits for a renderer to start
            self._warned_of_waiting = True
            waiting = f"{len(self._memories)} member{'s are' if len(self._memories) > 1 else ' is'}"
            self._warn(
                RendererWarning(
                    f"rendering is slower than the loop, which waits now: {waiting} not rendered yet. Render fewer views, "
                    "dump less often, or give the renderer more cores (said once)"
                )
            )

    def _send(self) -> None:
        """Hand the renderer what it does not have yet; starts one if needed."""
        if self._renderer is None:
            self._start()
        renderer = self._renderer
        while renderer is not None and self._renderer is renderer and (task := self._unsent()):
            try:
                renderer.way.send((task.memory, task.packed))
                task.sent = True
            except OSError:
                self._handle_crash()
                renderer = self._renderer

    def _unsent(self) -> QueuedMember | None:
        return next((task for task in self._tasks if not task.sent), None)

    def _start(self) -> None:
        """Start a renderer; where none can be had, its members are missing."""
        if self._deaths > RESTARTS:
            self._unable = f"the renderer died {self._deaths} times, and no further one is started"
        if self._unable:
            self._give_up(self._unable)
            return
        here, there = socketpair()
        descriptors = [there.fileno(), self._pulse, *self._memories]
        try:
            process = subprocess.Popen(
                [python(), "-P", "-m", "insitu.hook.renderer", str(os.getpid()), *map(str, descriptors)],
                pass_fds=descriptors,
                stdin=subprocess.DEVNULL,
                stdout=2,  # what it prints is not the program's output
                env={**os.environ, "PYTHONPATH": _search_path()},
                start_new_session=True,  # Ctrl-C is for the loop, which decides
            )
        except OSError as error:
            here.close()
            self._unable = f"no renderer could be started: {error}"
            self._give_up(self._unable)
            return
        finally:
            there.close()
        self._renderer = _RendererProcess(process, Connection(here.detach()))
        os.pwrite(self._pulse, PULSE.pack(clock.monotonic(), 0), 0)
        with contextlib.suppress(OSError):  # noticed when the first member is sent
            self._renderer.way.send((self.catalog, self._options))

    def _take_results(self, *, wait: bool = False) -> None:
        """Note what the renderer has done; with `wait`, until at least one member is done or given up."""
        before = len(self._tasks)
        while self._renderer is not None and self._tasks:
            try:
                if self._renderer.way.poll(TICK_SECONDS if wait and len(self._tasks) == before else 0):
                    self._settle(*self._renderer.way.recv())
                    continue
            except (OSError, EOFError):
                self._handle_crash()
                continue
            beat, images = PULSE.unpack(os.pread(self._pulse, PULSE.size, 0))
            self._progress(images)
            if clock.monotonic() - beat > SILENCE_SECONDS:
                self._renderer.process.kill()
            elif not wait or len(self._tasks) < before:
                return

    def _settle(self, outcome: RenderedMember | str, notes: tuple[str, ...] = ()) -> None:
        """Report the first member's outcome to the session, and free its memory."""
        task = self._tasks.popleft()
        self._free.append(task.memory)
        self._settled_some = True
        for note in notes:
            self._warn(UserWarning(f"member {task.name}: {note}"))
        if not isinstance(outcome, str):
            self._deaths = 0
        self._settled(task.name, task.parameters, outcome)

    def _give_up(self, reason: str) -> None:
        while self._tasks:
            self._settle(reason)

    def _handle_crash(self) -> None:
        """The renderer is dead: try its member again with a new one, or give it up."""
        renderer, self._renderer = self._renderer, None
        if renderer is None:
            return
        renderer.way.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            renderer.process.wait(FAREWELL_SECONDS)
        renderer.process.kill()
        why = _cause(renderer.process.wait())
        self._deaths += 1
        for task in self._tasks:
            task.sent = False
        if self._tasks:
            task = self._tasks[0]
            task.tries += 1
            if task.tries >= TRIES:
                self._settle(f"its renderer {why}, {task.tries} times")
            else:
                self._warn(
                    RendererWarning(f"the renderer {why} while it held member {task.name}: another one tries again")
                )
            self._send()

    def _end_renderer(self) -> None:
        renderer, self._renderer = self._renderer, None
        if renderer is None:
            return
        with contextlib.suppress(OSError):
            renderer.way.close()  # without it, it ends
        try:
            renderer.process.wait(FAREWELL_SECONDS)
        except BaseException:
            renderer.process.kill()
            renderer.process.wait()


def queue_length(background: bool | int) -> int:
    """The number of members that a session may queue; raises ValueError where `background` is neither a bool nor a number."""
    if not isinstance(background, int) or background < 0:
        raise ValueError(
            f"background must be True, False, or the number of members that may be queued, got {background!r}"
        )
    return WAITING if background is True else int(background)


def python() -> str:
    """The interpreter to run beside this one; a program that only embeds Python has it in its prefix."""
    names = ("python3", "python", f"python{sys.version_info.major}.{sys.version_info.minor}")
    if sys.executable and Path(sys.executable).name.startswith(("python", "pypy")):
        return sys.executable
    paths = [Path(sys.prefix) / "bin" / name for name in names]
    return next((str(path) for path in paths if path.exists()), shutil.which("python3") or "python3")


def _search_path() -> str:
    """The loop's, behind the folder of this package: no file in the working folder takes the name of one of ours."""
    return os.pathsep.join([str(Path(__file__).parents[2]), *(path or os.getcwd() for path in sys.path)])


def _cause(code: int) -> str:
    if code >= 0:
        return f"ended with status {code}"
    with contextlib.suppress(ValueError):
        name = signal.Signals(-code).name
        return f"was killed by {name}{' (the system may be out of memory)' if name == 'SIGKILL' else ''}"
    return f"was killed by signal {-code}"
