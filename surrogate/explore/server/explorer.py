"""The explorer of one run as a web application: its page, and what the page asks this program for.

Nothing that one tab sets is kept here.  Each frame is asked for with everything it depends on, so tabs can't disturb each other,
and what the address holds is the whole state.  Exports go over plain HTTP, so that a film in the making stops no frame.  The page
names everything by relative addresses, so that it works below the path of any proxy.
"""

from __future__ import annotations

import asyncio
import errno
import hashlib
import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import torch
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from catalogs.store.catalog import CatalogError
from catalogs.web import ASSETS
from catalogs.web.access import LOCAL, Access
from native.threads import cores, kernel_threads
from surrogate.answers.doubt import Doubt
from surrogate.explore.exporting.expectations import NO_CATALOG, Expectations
from surrogate.explore.exporting.exports import Export, exported
from surrogate.explore.exporting.page_model import PageModel
from surrogate.explore.facts import facts
from surrogate.explore.request import frame_request
from surrogate.explore.run import Run
from surrogate.explore.server.calls import Call, Sockets, parsed, reported
from surrogate.explore.server.frames import Frames
from surrogate.explore.server.guard import PAGE, guard
from surrogate.explore.server.link import PageParameters
from surrogate.explore.server.predictions import Predictions
from surrogate.explore.server.questions import Questions, about_of
from surrogate.explore.server.values import Values
from surrogate.explore.truth import Truth

DRAWING_THREADS = 2
MOST_EXPORTS = 8  # one is made, the others wait
PATIENCE = 10.0  # seconds
FIRST_PORT, PORTS = 20_000, 10_000  # below those that systems give to outgoing connections
NEIGHBOURS = 20  # ports that are tried before any other
PARTING = 2.0  # seconds that answers on the way have when the server stops

log = logging.getLogger(__name__)
http_log = logging.getLogger(f"{__name__}.http")


class Explorer:
    """The server of one run: `serve` it in a loop, and `close` it afterwards.

    It listens on `host`.  With a `base_url` it is reached through the proxy of the Jupyter server that has this base URL.
    Its pages keep in step with `parameters` where it is `linked` to whoever reads and sets these.
    """

    def __init__(self, run: Run, *, host: str = LOCAL, base_url: str = "", linked: bool = False) -> None:
        self.run = run
        self.access = Access.of(host, base_url)
        self.port = 0  # until it listens
        undoubted = "" if run.catalog else NO_CATALOG
        self.frames = Frames(run.surrogate, Truth.of(run), undoubted=undoubted)
        self._facts = facts(run) | {"linked": linked}
        self.parameters = PageParameters(run.surrogate.space)
        self._expectations = Expectations(why=undoubted)
        # Torch's own operations are small, and its threads spin while they wait: those of several tabs for each other.
        alone: dict[str, Any] = {"initializer": torch.set_num_threads, "initargs": (1,)}
        self._drawing = ThreadPoolExecutor(DRAWING_THREADS, thread_name_prefix="draw", **alone)
        self._exporting = ThreadPoolExecutor(1, thread_name_prefix="export", **alone)
        self._counting = ThreadPoolExecutor(1, thread_name_prefix="count", **alone)
        self._exports = 0  # made or waiting
        self._export_steps: dict[str, tuple[int, int]] = {}  # how many steps of how many are done, by the page's ticket
        self._closed = threading.Event()
        self._measuring = threading.Thread(target=self._measure, name="doubt", daemon=True)

    @property
    def address(self) -> str:
        """The page's address, once `serve` listens."""
        return self.access.address(self.port)

    async def serve(self, *, port: int | None = None, ready: Callable[[str], Any]) -> None:
        """Listen, tell `ready` the address, and answer until this task is cancelled.

        Port 0 is any that is free; without one it is the first free one of `ports_of` the run, so that pages find an explorer that
        was started anew.  What error to expect is measured meanwhile, unless it was measured before.
        """
        http_log.addFilter(_is_ours)
        runner = web.AppRunner(self._application(), access_log=None, logger=http_log, shutdown_timeout=PARTING)
        await runner.setup()
        try:
            await self._listen(runner, ports_of(self.run) if port is None else (port,))
            self.port = runner.addresses[0][1]
            self._measuring.start()
            ready(self.address)
            await asyncio.Event().wait()
        finally:
            self._closed.set()
            await runner.cleanup()

    async def _listen(self, runner: web.AppRunner, ports: Sequence[int]) -> None:
        """Listen on the first of the ports that is free."""
        for port in ports:
            site = web.TCPSite(runner, self.access.host, port)
            try:
                await site.start()
                break
            except OSError as error:
                await site.stop()
                if error.errno != errno.EADDRINUSE or port == ports[-1]:
                    raise

    def close(self) -> None:
        """Stop drawing and measuring."""
        self._closed.set()
        for pool in (self._drawing, self._exporting, self._counting):
            pool.shutdown(wait=False, cancel_futures=True)
        if self._measuring.is_alive():  # at the end of Python a thread inside of a kernel would abort the process
            self._measuring.join(timeout=PATIENCE)
        self.frames.clear()  # whoever still holds this object holds no Gaussians

    def _model(self) -> dict[str, Any]:
        """The surrogate for browsers that draw it by themselves."""
        model = PageModel.of(self.run)
        return model.content | {"pictures": [model.tensors, model.field]}

    def _measure(self) -> None:
        def go_on(*_: object) -> None:
            if self._closed.is_set():
                raise InterruptedError

        if self.run.catalog is None:
            return
        try:
            self.frames.doubt = Doubt.of(self.run.surrogate, self.run.catalog, self.run.folder, go_on)
            self._expectations = Expectations.of(self.run, self.frames.doubt, go_on)
        except InterruptedError:
            pass
        except (CatalogError, ValueError, OSError) as error:
            self.frames.undoubted = str(error)
            self._expectations = Expectations(why=str(error))
            log.warning("what error to expect can't be measured: %s", error)

    def _application(self) -> web.Application:
        frames, surrogate = self.frames, self.run.surrogate
        origins, questions, histogram = self.run.origins, Questions(self.run, frames), self._facts["histogram"]
        values = Values(self.run, histogram and histogram["edges"])
        predictions = Predictions(self.run, self._counting, self._closed)
        calls: dict[str, Call] = {
            "facts": lambda _: self._facts,
            "frame": lambda request: frames.answer(frame_request(request, surrogate, origins)),
            "model": lambda _: self._model(),
            "expected": lambda request: {"expected": frames.expected(frame_request(request, surrogate, origins))},
            "over": lambda request: questions.over(frame_request(request, surrogate, origins), about_of(request)),
            "next": lambda _: questions.next(),
            "probe": lambda request: values.probe(frame_request(request, surrogate, origins), request),
            "here": lambda request: values.here(frame_request(request, surrogate, origins)),
            "predictions": lambda request: predictions.answer(frame_request(request, surrogate, origins)),
            "follow": self.parameters.follow,
            "made": lambda ticket: {"made": self._export_steps.get(str(ticket))},
            "survey": lambda _: self._expectations.to_json(),
            "nearest": lambda request: {"found": frames.nearest(frame_request(request, surrogate, origins))},
        }
        sockets = Sockets(calls, self._drawing)
        application = web.Application(middlewares=[guard(self.access)])
        application.on_shutdown.append(sockets.close)
        application.router.add_get("/", _file(PAGE / "index.html"))
        for shared in ("look.css", "vectors.js", "elements.js"):
            application.router.add_get(f"/web/{shared}", _file(ASSETS / shared))
        application.router.add_static("/explore/", PAGE)
        application.router.add_get("/ws", sockets.respond)
        application.router.add_post("/export", self._export)
        return application

    async def _export(self, request: web.Request) -> web.Response:
        def go_on(*counts: Any) -> None:
            if self._closed.is_set() or request.transport is None:
                raise InterruptedError("nobody waits for this export any more")
            if counts:
                self._export_steps[ticket] = counts[:2]

        def work() -> Export:
            go_on()
            message = parsed(content)
            is_fitted = isinstance(message, dict) and message.get("refit")
            with kernel_threads(
                max(1, cores() // 2) if is_fitted else cores()
            ):  # for minutes: others draw frames meanwhile
                return exported(message, self.run, go_on, self.frames.doubt)

        content, ticket = await request.read(), request.query.get("ticket", "")
        if self._exports >= MOST_EXPORTS:
            return web.json_response({"error": "other exports are still being made: try again later"}, status=503)
        self._exports += 1
        try:
            file = await asyncio.get_running_loop().run_in_executor(self._exporting, work)
        except InterruptedError:
            return web.Response(status=503)
        except Exception as error:
            return web.json_response({"error": reported(error)}, status=400 if isinstance(error, ValueError) else 500)
        finally:
            self._exports -= 1
            self._export_steps.pop(ticket, None)
        headers = {"Content-Disposition": f'attachment; filename="{file.name}"'}
        return web.Response(body=file.content, content_type=file.media_type, headers=headers)


def ports_of(run: Run) -> tuple[int, ...]:
    """Ports to listen on, by preference: those of the run's folder, the same every time, then any that is free."""
    folder = run.folder or run.model_folder
    if folder is None:
        return (0,)
    name = hashlib.sha256(str(folder.resolve()).encode(errors="surrogateescape")).digest()
    first = FIRST_PORT + int.from_bytes(name[:4], "little") % PORTS
    return (*range(first, first + NEIGHBOURS), 0)


def _is_ours(record: logging.LogRecord) -> bool:
    """True if aiohttp complains of this program: not of strangers who speak no HTTP, or of its own race when it stops."""
    theirs = HttpProcessingError | web.RequestPayloadError | ConnectionError | asyncio.InvalidStateError
    return record.exc_info is None or not isinstance(record.exc_info[1], theirs)


def _file(path: Path) -> Callable[[web.Request], Any]:
    async def answer(_: web.Request) -> web.FileResponse:
        return web.FileResponse(path)

    return answer
