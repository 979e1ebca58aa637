"""The explorer's WebSocket: wslink's, for strangers.

wslink believes whoever knows its secret: that messages are well formed, that an announced gigabyte will come, that methods may be
called with anything, that tracebacks are for friends.  Here a message comes whole or not at all, calls what the page calls,
and what is wrong with it comes back as one sentence, after which the connection lives on.
"""

from __future__ import annotations

import asyncio
import hmac
import struct
from contextlib import nullcontext
from typing import Any

import aiohttp
import msgpack
from aiohttp import web
from wslink.backends.aiohttp import AioHttpWsHandler

CALLS = ("trame.state.get", "trame.trigger")
TOLD = "trame.lifecycle.update"  # the page tells of its own life, and nobody listens
LARGEST = 1 << 20  # bytes of a message, once its sender has told the secret
FIRST = 512  # and before
LONGEST_NUMBER = 100  # characters by which a page counts its calls
PARTING = 1.0  # seconds in which open connections may say goodbye
HEADER = struct.Struct("<III")  # of a piece of a message: number, offset, size of the whole
INVALID = -32600  # invalid request, as http://www.jsonrpc.org/specification has it


class Sockets(AioHttpWsHandler):  # type: ignore[misc]
    """Speaks with all tabs; one that does not read what it asked for keeps none of the others waiting."""

    def __init__(self, protocol: Any, web_app: Any) -> None:
        super().__init__(protocol, web_app)
        self.functionMap: dict[str, Any] = {name: self.functionMap[name] for name in CALLS} | {TOLD: (self, _ignored)}
        self.attachment_atomic = nullcontext()  # wslink's lock is one for all tabs

    async def handleWsRequest(self, request: web.Request) -> web.StreamResponse:
        if not web.WebSocketResponse().can_prepare(request):
            return web.Response(status=400, text="this is the address of a WebSocket\n")
        response: web.StreamResponse = await super().handleWsRequest(request)
        return response

    async def onMessage(self, is_binary: bool, msg: aiohttp.WSMessage, client_id: str) -> None:
        if msg.type not in (aiohttp.WSMsgType.BINARY, aiohttp.WSMsgType.TEXT):
            return
        try:
            call = call_in(msg.data, LARGEST if self.isClientAuthenticated(client_id) else FIRST)
        except ValueError as error:
            await self.sendWrappedError("", INVALID, str(error), client_id=client_id)
            return
        with self.network_monitor:
            await self.onCompleteMessage(call, client_id)

    async def validateToken(self, token: Any, client_id: str) -> bool:
        return isinstance(token, str) and hmac.compare_digest(token.encode(), self.serverProtocol.secret.encode())

    async def sendWrappedError(
        self, rpcid: str, code: int, message: str, data: Any = None, client_id: str | None = None
    ) -> None:
        """Without `data`, which holds tracebacks and with them the paths of this machine."""
        await super().sendWrappedError(rpcid, code, message, None, client_id)

    def payloadWithSecretStripped(self, payload: Any) -> str:
        """What wslink logs of each message: nothing, instead of a deep copy."""
        return ""

    async def disconnectClients(self) -> None:
        goodbyes = [
            asyncio.ensure_future(socket.close(code=aiohttp.WSCloseCode.GOING_AWAY))
            for socket in self.connections.values()
        ]
        if goodbyes:
            await asyncio.wait(goodbyes, timeout=PARTING)
        self.publishManager.unregisterProtocol(self)


def call_in(data: bytes | str, most: int) -> dict[str, Any]:
    """The call that a WebSocket message of at most `most` bytes is: `id`, `method`, `args` and `kwargs`.

    Raises ValueError for anything else, in a sentence that repeats nothing of it.
    """
    if isinstance(data, str) or len(data) < HEADER.size:
        raise ValueError("messages are MessagePack behind a header of twelve bytes")
    _, offset, size = HEADER.unpack_from(data)
    if offset or size != len(data) - HEADER.size:
        raise ValueError("a message comes in one piece")
    if size > most:
        raise ValueError(f"a message has at most {most} bytes here")
    try:
        call = msgpack.unpackb(memoryview(data)[HEADER.size :])
    except Exception:  # msgpack raises its own, and what the values' types raise
        raise ValueError("this is no MessagePack, or nested too deep") from None
    if not isinstance(call, dict):
        raise ValueError("a message is an object")
    number, method, args, kwargs = (call.get("id"), call.get("method"), call.get("args", []), call.get("kwargs", {}))
    if not isinstance(number, str) or len(number) > LONGEST_NUMBER or not isinstance(method, str):
        raise ValueError("a message has an id and a method, both texts")
    if not isinstance(args, list) or not isinstance(kwargs, dict):
        raise ValueError("a message has a list of args, and kwargs by name")
    return {"id": number, "method": method, "args": args, "kwargs": kwargs}


def _ignored(*_: Any, **__: Any) -> None:
    return None
