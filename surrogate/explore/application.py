"""The explorer as a trame application: one page, and what it asks this program for.

Nothing that one tab sets is kept here.  Each frame is asked for with everything it depends on, so tabs can't disturb each other,
and what the address holds is the whole state.  trame carries the messages (over a tunnel, in Jupyter); exports go over
plain HTTP, so that a film in the making stops no frame.
"""

from __future__ import annotations

import asyncio
import errno
import json
import logging
import re
import secrets
import threading
import uuid
import webbrowser
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

import torch
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from trame.app import get_server
from trame.app.core import AVAILABLE_SERVERS
from trame.ui.html import DivLayout
from trame.widgets import html

from catalogs.browse.access import LOCAL, Access
from catalogs.catalog import CatalogError
from catalogs.images import ImageError
from surrogate.explore.exporting.exports import Export, exported
from surrogate.explore.frames import Frames
from surrogate.explore.guard import Guard
from surrogate.explore.reliability.expectation import measure
from surrogate.explore.reliability.facts import facts
from surrogate.explore.reliability.truth import Truth
from surrogate.explore.request import frame_request
from surrogate.explore.run import Run
from surrogate.explore.sockets import LARGEST, Sockets

DRAWING_THREADS = 2
MOST_EXPORTS = 8  # one is made, the others wait
PATIENCE = 10.0  # seconds
PARTING = 2.0  # seconds that tabs have to leave when the server stops
VIEWPORT = '<meta name="viewport" content="width=device-width, initial-scale=1">'
# Where the page learns how to connect, whatever path a proxy has put before it.
CONNECT = (
    "<script>document.documentElement.dataset.sessionManagerUrl = "
    "`session?path=${encodeURIComponent(location.pathname)}`;</script>"
)

log = logging.getLogger(__name__)


class Explorer:
    """A trame server that shows one run."""

    def __init__(self, run: Run, *, host: str = LOCAL) -> None:
        self.run = run
        self.access = Access.of(host)
        self.secret = secrets.token_urlsafe(24)
        self.frames = Frames(run.surrogate, Truth.of(run))
        self._facts = facts(run)
        # Torch's own operations are small, and its threads spin while they wait: those of several tabs for each other.
        alone: dict[str, Any] = {"initializer": torch.set_num_threads, "initargs": (1,)}
        self._drawing = ThreadPoolExecutor(DRAWING_THREADS, thread_name_prefix="draw", **alone)
        self._exporting = ThreadPoolExecutor(1, thread_name_prefix="export", **alone)
        self._exports = 0  # made or waiting
        self._closed = threading.Event()
        self._measuring = threading.Thread(target=self._measure, name="expectation", daemon=True)
        self.server = get_server(f"explorer-{uuid.uuid4().hex}", client_type="vue3")
        self._build()

    @property
    def address(self) -> str:
        """Where the page is, once the server runs."""
        return self.access.address(self.server.port)

    def start(self, *, port: int = 0, ready: Callable[[str], Any], **options: Any) -> Any:
        """Start listening (port 0: any that is free) and tell `ready` the address; `options` are those of trame's `start`."""
        self.server.controller.on_server_ready.add(lambda **_: ready(self.address))
        # A tab that is closed while its picture is on the way is no failure; wslink would print it as one.
        logging.getLogger("wslink").setLevel(logging.CRITICAL + 1)
        logging.getLogger("aiohttp.server").addFilter(_is_ours)
        # trame would read this program's own command line.
        self.server.cli.parse_known_args = _defaults(self.server.cli)  # type: ignore[method-assign]
        # The WebSocket is ours, see `_bind`; pictures are compressed already.
        self.server.cli.set_defaults(nows=True, nowscompress=True, authKey=self.secret)
        return self.server.start(
            port=port,
            host=self.access.host,
            timeout=0,
            open_browser=False,
            show_connection_info=False,
            disable_logging=True,
            **options,
        )

    def measure_expectation(self) -> None:
        """Measure in the background what error to expect, or read what was measured before."""
        self._measuring.start()

    async def stop(self) -> None:
        """Stop listening; whoever is connected has a moment to leave."""
        self._closed.set()
        with suppress(TimeoutError):
            await asyncio.wait_for(self.server.stop(), PARTING)

    def close(self) -> None:
        """Draw and measure nothing any more."""
        self._closed.set()
        for pool in (self._drawing, self._exporting):
            pool.shutdown(wait=False, cancel_futures=True)
        if self._measuring.is_alive():  # at the end of Python a thread inside of a kernel would abort the process
            self._measuring.join(timeout=PATIENCE)
        AVAILABLE_SERVERS.pop(self.server.name, None)
        self.frames.forget()  # aiohttp keeps the handlers of some hundred servers, and so this object

    def _measure(self) -> None:
        def go_on(*_: object) -> None:
            if self._closed.is_set():
                raise InterruptedError

        try:
            self.frames.expectation = measure(self.run, go_on)
        except InterruptedError:
            pass
        except (CatalogError, ValueError, OSError) as error:
            log.warning("what error to expect can't be measured: %s", error)

    def _build(self) -> None:
        server = self.server
        server.options["ws_max_msg_size"] = LARGEST
        server.state.trame__title = f"{self.run.title} · gs-surrogate"
        server.state.trame__template_error = STOPPED
        server.enable_module(
            {
                "serve": {"explore": str(_page_folder())},
                "styles": ["look.css", "explore/explore.css"],
                "module_scripts": ["explore/explore.js"],
            }
        )
        with DivLayout(server):
            html.Div(id="explorer-page", __properties=["id"])
        server.controller.trigger("facts")(self._tell)
        server.controller.trigger("frame")(self._frame)
        server.controller.trigger("nearest")(self._nearest)
        server.controller.on_server_bind.add(self._bind)

    def _bind(self, backend: Any) -> None:
        """Before anything is served: guard it, and answer what a page of ours asks for."""
        backend.app.middlewares.append(Guard(self.access).middleware())
        backend.app.router.add_get("/index.html", _index)
        backend.app.router.add_get("/look.css", _look)
        backend.app.router.add_post("/session", self._session)
        backend.app.router.add_post("/export", self._export)
        sockets = Sockets(self.server.protocol, backend)
        backend._ws_handlers.append(sockets)  # whom wslink disconnects when it stops
        backend.app.router.add_get("/ws", sockets.handleWsRequest)

    async def _tell(self, *_: Any, **__: Any) -> dict[str, Any]:
        return self._facts

    async def _frame(self, message: Any = None, *_: Any, **__: Any) -> dict[str, Any]:
        """Answer a request for pictures; what is wrong with it comes back as `error`."""
        return await self._worked(lambda: self.frames.answer(frame_request(message, self.run.surrogate)))

    async def _nearest(self, message: Any = None, *_: Any, **__: Any) -> dict[str, Any]:
        """The stored picture nearest to what a request for pictures shows; `found` is None without one."""
        return await self._worked(lambda: {"found": self.frames.nearest(frame_request(message, self.run.surrogate))})

    async def _worked(self, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        try:
            return await asyncio.get_running_loop().run_in_executor(self._drawing, work)
        except Exception as error:
            return {"error": _said(error)}

    async def _session(self, request: web.Request) -> web.Response:
        """Where the WebSocket is, and the secret that it takes; only pages of this server can read it."""
        path = request.query.get("path", "/")
        prefix = path[: path.rfind("/") + 1] if re.fullmatch(r"/[\w./~%-]*", path) else "/"
        return web.json_response({"sessionURL": f"ws://USE_HOST{prefix}ws", "secret": self.secret})

    async def _export(self, request: web.Request) -> web.Response:
        def go_on(*_: Any) -> None:
            if self._closed.is_set() or request.transport is None:
                raise InterruptedError("nobody waits for this export any more")

        def work(message: Any) -> Export:
            go_on()
            return exported(message, self.run, go_on)

        message = await _json_of(request)
        if self._exports >= MOST_EXPORTS:
            return web.json_response({"error": "other exports are still being made: try again later"}, status=503)
        self._exports += 1
        try:
            made = await asyncio.get_running_loop().run_in_executor(self._exporting, work, message)
        except InterruptedError:
            return web.Response(status=503)
        except Exception as error:
            status = 400 if isinstance(error, ValueError) else 500
            return web.json_response({"error": _said(error)}, status=status)
        finally:
            self._exports -= 1
        headers = {"Content-Disposition": f'attachment; filename="{made.name}"'}
        return web.Response(body=made.content, content_type=made.media_type, headers=headers)


def explore(
    run: Run,
    *,
    host: str = LOCAL,
    port: int = 0,
    open_page: bool = False,
    announce: Callable[[str], Any] = print,
) -> None:
    """Show a run until Ctrl-C, after announcing its address.  Raises OSError where no server can listen there."""
    explorer = Explorer(run, host=host)

    def ready(address: str) -> None:
        announce(f"{run.title} at {address} (Ctrl-C stops)")
        explorer.measure_expectation()
        if open_page:
            webbrowser.open(address)

    try:
        explorer.start(port=port, ready=ready, exec_mode="main")
    except KeyboardInterrupt:
        pass
    except (OSError, OverflowError) as error:
        raise OSError(_why_not(error, host, port)) from error
    finally:
        explorer.close()
    announce("stopped")


def _is_ours(record: logging.LogRecord) -> bool:
    """Whether aiohttp's complaint is about this program, not about what strangers sent that is no HTTP."""
    theirs = HttpProcessingError | web.RequestPayloadError | ConnectionError
    return record.exc_info is None or not isinstance(record.exc_info[1], theirs)


def _why_not(error: OSError | OverflowError, host: str, port: int) -> str:
    """Why no server can listen there."""
    if not 0 <= port <= 65535:
        return f"a port lies in 0 to 65535, got {port}"
    reason = getattr(error, "errno", None)
    if reason == errno.EADDRINUSE:
        return f"port {port} of {host} is taken: name another one, or none for one that is free"
    if reason == errno.EACCES:
        return f"port {port} is not for everybody: name one above 1023, or none for one that is free"
    return f"no server can listen at {host}: {getattr(error, 'strerror', None) or error}"


async def _json_of(request: web.Request) -> Any:
    try:
        return json.loads(await request.read())
    except web.HTTPException:
        raise
    except Exception:  # of the body's encoding, its text, its values, its depth
        raise web.HTTPBadRequest(text='{"error": "this is no JSON"}', content_type="application/json") from None


def _said(error: Exception) -> str:
    """What a tab is told; what names files of this machine only its terminal hears."""
    if isinstance(error, CatalogError | ImageError):
        log.warning("%s", error)
        return "a stored picture can't be read: the explorer's terminal says which"
    if isinstance(error, ValueError):
        return str(error)
    log.exception("an answer failed", exc_info=error)
    return f"this failed inside the explorer ({type(error).__name__}); its terminal says more"


def _defaults(parser: Any) -> Callable[..., Any]:
    def parse(args: Any = None, namespace: Any = None) -> Any:
        return type(parser).parse_known_args(parser, [] if args is None else args, namespace)

    return parse


def _page_folder() -> Path:
    return Path(str(files("surrogate.explore").joinpath("page")))


async def _index(_: web.Request) -> web.Response:
    """trame's page, but in a window that may be enlarged (WCAG 1.4.4)."""
    from trame_client.module import vue3

    page = (Path(vue3.www) / "index.html").read_text(encoding="utf-8")
    page = re.sub(r'<meta\s+name="viewport"[^>]*>', VIEWPORT + CONNECT, page)
    return web.Response(text=page, content_type="text/html")


async def _look(_: web.Request) -> web.Response:
    look = files("catalogs.browse").joinpath("look.css").read_text(encoding="utf-8")
    return web.Response(text=look, content_type="text/css")


STOPPED = """
<main class="stopped" role="alert"><h1>The explorer has stopped</h1>
<p>Start it again on its machine and reload this page: the address keeps what you saw.</p></main>
"""
