"""A tab without a browser: speaks wslink's protocol, politely or not, from a thread that has a loop of its own."""

from __future__ import annotations

import asyncio
import itertools
import json
import socket
import struct
import threading
from collections.abc import Coroutine
from concurrent.futures import Future
from functools import cache
from types import TracebackType
from typing import Any, TypeVar
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import aiohttp
import msgpack
from wslink.chunking import UnChunker

from tests.support.requests import message

T = TypeVar("T")
PATIENCE = 30.0  # seconds
MOST = 1 << 30


@cache
def _loop() -> asyncio.AbstractEventLoop:
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="tabs", daemon=True).start()
    return loop


def wait(work: Coroutine[Any, Any, T], seconds: float = PATIENCE) -> T:
    """What comes of it, in the loop of all tabs."""
    return asyncio.run_coroutine_threadsafe(asyncio.wait_for(work, seconds), _loop()).result(seconds + 5)


def framed(content: bytes, *, offset: int = 0, size: int | None = None, number: int = 7) -> bytes:
    """A piece of a message as wslink sends it."""
    return struct.pack("<III", number, offset, len(content) if size is None else size) + content


def secret_of(address: str) -> str:
    with urlopen(Request(f"{address}session", data=b"{}", method="POST")) as answer:
        found: str = json.load(answer)["secret"]
    return found


def post(address: str, content: Any, **headers: str) -> tuple[int, Any]:
    """Status and answer of an export: bytes, or an error's JSON."""
    data = content if isinstance(content, bytes) else json.dumps(content).encode()
    try:
        with urlopen(
            Request(f"{address}export", data=data, method="POST", headers=headers), timeout=PATIENCE
        ) as answer:
            return answer.status, answer.read()
    except HTTPError as error:
        return error.code, json.load(error)


class Tab:
    """An open connection; says hello unless told not to."""

    def __init__(self, address: str, *, hello: bool = True) -> None:
        self.address = address
        self._numbers = itertools.count(1)
        self._pieces = UnChunker()
        self._pieces.set_max_message_size(MOST)
        wait(self._open())
        if hello:
            self.write({"id": "system:c0:0", "method": "wslink.hello", "args": [{"secret": secret_of(address)}]})
            assert "clientID" in self.receive()["result"]

    async def _open(self) -> None:
        self._session = aiohttp.ClientSession()
        self._socket = await self._session.ws_connect(f"{self.address.replace('http', 'ws')}ws", max_msg_size=0)

    def __enter__(self) -> Tab:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        async def close() -> None:
            await self._socket.close()
            await self._session.close()

        wait(close())

    def vanish(self) -> None:
        """Close without goodbye, whatever is on the way."""

        async def vanish() -> None:
            connection = self._socket._response.connection
            assert connection is not None
            assert connection.transport is not None
            connection.transport.abort()
            await self._session.close()

        wait(vanish())

    async def waits(self, seconds: float) -> None:
        """Time in which messages come and go."""
        await asyncio.sleep(seconds)

    def narrow(self) -> None:
        """Let little of what is not read yet be on the way."""
        self._socket.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)

    def flood(self, call: Any, count: int) -> Future[None]:
        """Send a call very often without reading any answer."""
        data = framed(msgpack.packb(call))

        async def send() -> None:
            for _ in range(count):
                await self._socket.send_bytes(data)

        return asyncio.run_coroutine_threadsafe(send(), _loop())

    def send(self, data: bytes | str) -> None:
        wait(self._socket.send_bytes(data) if isinstance(data, bytes) else self._socket.send_str(data))

    def write(self, call: Any) -> None:
        self.send(framed(msgpack.packb(call)))

    def receive(self, seconds: float = PATIENCE) -> dict[str, Any]:
        """The next message; raises ConnectionError where the other side has hung up."""

        async def receive() -> Any:
            whole = None
            while whole is None:
                got = await self._socket.receive()
                if got.type is not aiohttp.WSMsgType.BINARY:
                    raise ConnectionError(f"{got.type.name}: {got.data}")
                whole = self._pieces.process_chunk(got.data)
            return whole

        found: dict[str, Any] = wait(receive(), seconds)
        return found

    def ask(self, method: str, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The answer to a call: a message with `result` or `error`."""
        number = f"rpc:c0:{next(self._numbers)}"
        self.write({"wslink": "1.0", "id": number, "method": method, "args": list(args), "kwargs": kwargs})
        while (answer := self.receive())["id"] != number:
            pass
        return answer

    def trigger(self, name: str, *args: Any) -> Any:
        """What the page's own calls give."""
        return self.ask("trame.trigger", name, list(args), {})["result"]

    def frame(self, **changes: Any) -> dict[str, Any]:
        """The answer to a good request for pictures, with `changes`."""
        found: dict[str, Any] = self.trigger("frame", message(**changes))
        return found


def lives(tab: Tab) -> None:
    """The tab still gets a frame."""
    answer = tab.frame()
    assert "error" not in answer
    assert answer["pictures"][0].startswith(b"\x89PNG")
