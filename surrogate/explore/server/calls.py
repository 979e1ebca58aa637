"""Calls of the page over its WebSocket, and their answers.

A message is JSON text, `{"call": name, "request": value}`.  Each gets one binary answer, in the order of the messages.  It is
the length of a JSON object (4 bytes, little-endian), the object, and the bytes of images, whose sizes it lists under `pictures`.  A
wrong message is answered by `error`, one sentence, and the connection stays open.
"""

from __future__ import annotations

import asyncio
import json
import logging
import struct
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from typing import Any

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from catalogs.files.images import ImageError
from catalogs.store.catalog import CatalogError
from surrogate.explore.request import MessageError

LARGEST = 1 << 20  # bytes of a message
HEARTBEAT = 30.0  # seconds after which a silent connection must show that it lives
PARTING = 1.0  # seconds
LENGTH = struct.Struct("<I")

Answer = dict[str, Any]
Call = Callable[[Any], Answer]

log = logging.getLogger(__name__)


class Sockets:
    """Answers all tabs; a tab that does not read its answers keeps no other waiting.

    The `calls`, by name, take a message's request and give an answer, in the threads of `pool`.
    """

    def __init__(self, calls: Mapping[str, Call], pool: Executor) -> None:
        self._calls, self._pool = calls, pool
        self._open: set[web.WebSocketResponse] = set()

    async def respond(self, request: web.Request) -> web.StreamResponse:
        """The route: answers one tab until it leaves."""
        socket = web.WebSocketResponse(max_msg_size=LARGEST, heartbeat=HEARTBEAT, compress=False)
        if not socket.can_prepare(request):
            return web.Response(status=400, text="this is the address of a WebSocket\n")
        await socket.prepare(request)
        loop = asyncio.get_running_loop()
        self._open.add(socket)
        try:
            with suppress(ConnectionResetError):  # a tab was closed while its picture was on the way
                async for message in socket:
                    await socket.send_bytes(await loop.run_in_executor(self._pool, self._answer, message))
        finally:
            self._open.discard(socket)
        return socket

    async def close(self, _: web.Application) -> None:
        """Close all connections, waiting at most `PARTING` for the tabs to agree."""
        goodbyes = [asyncio.ensure_future(socket.close(code=WSCloseCode.GOING_AWAY)) for socket in self._open]
        if goodbyes:
            await asyncio.wait(goodbyes, timeout=PARTING)

    def _answer(self, message: WSMessage) -> bytes:
        try:
            question = parsed(message.data) if message.type is WSMsgType.TEXT else None
            name = question.get("call") if isinstance(question, dict) else None
            call = self._calls.get(name) if isinstance(name, str) else None
            if question is None or call is None:
                raise MessageError(f"a message is JSON text, an object whose call is one of {', '.join(self._calls)}")
            return packed(call(question.get("request")))
        except Exception as error:
            return packed({"error": reported(error)})


def parsed(text: str | bytes) -> Any:
    """The value of a JSON text; raises MessageError, in a sentence that repeats nothing of it."""
    try:
        return json.loads(text)
    except Exception:  # of its encoding, its syntax, its depth, the length of its numbers
        raise MessageError("not JSON, or nested too deep") from None


def packed(answer: Answer) -> bytes:
    """An answer as one message; its `pictures` are bytes."""
    pictures = answer.get("pictures", [])
    head = json.dumps({**answer, "pictures": [len(picture) for picture in pictures]}, allow_nan=False).encode()
    return b"".join([LENGTH.pack(len(head)), head, *pictures])


def reported(error: Exception) -> str:
    """The sentence that a tab shows for an error; the names of files go to the terminal alone."""
    if isinstance(error, CatalogError | ImageError):
        log.warning("%s", error)
        return "a stored picture can't be read: the explorer's terminal says which"
    if isinstance(error, ValueError):
        return str(error)
    log.exception("an answer failed", exc_info=error)
    return f"this failed inside the explorer ({type(error).__name__}); its terminal says more"
