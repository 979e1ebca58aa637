"""A tab without a browser: calls as the page does, politely or not, from a thread that has a loop of its own."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import struct
import threading
from collections.abc import Coroutine, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import aiohttp

from surrogate.explore.run import Run
from tests.support.requests import message

T = TypeVar("T")
PATIENCE = 30.0  # seconds
ROOT = str(Path(__file__).parents[2])


@cache
def _loop() -> asyncio.AbstractEventLoop:
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="tabs", daemon=True).start()
    return loop


def wait(work: Coroutine[Any, Any, T], seconds: float = PATIENCE) -> T:
    """The result of a coroutine, run in the loop of all tabs."""
    return asyncio.run_coroutine_threadsafe(asyncio.wait_for(work, seconds), _loop()).result(seconds + 5)


def unpacked(data: bytes) -> dict[str, Any]:
    """The answer that a message is, with its pictures as bytes."""
    (length,) = struct.unpack_from("<I", data)
    answer: dict[str, Any] = json.loads(data[4 : 4 + length])
    pictures, start = [], 4 + length
    for size in answer.pop("pictures"):
        pictures.append(data[start : start + size])
        start += size
    assert start == len(data)
    return answer | ({"pictures": pictures} if pictures else {})


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
    """An open connection."""

    def __init__(self, address: str) -> None:
        self.address = address
        wait(self._open())

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
        data = json.dumps(call)

        async def send() -> None:
            for _ in range(count):
                await self._socket.send_str(data)

        return asyncio.run_coroutine_threadsafe(send(), _loop())

    def send(self, data: bytes | str) -> None:
        wait(self._socket.send_bytes(data) if isinstance(data, bytes) else self._socket.send_str(data))

    def broken(self, content: bytes, *, announced: int | None = None) -> None:
        """Send a text message as one frame, whatever its bytes are and however many are announced."""
        size = len(content) if announced is None else announced
        long = size > 125 and (struct.pack(">H", size) if size < 1 << 16 else struct.pack(">Q", size))
        head = bytes([0x81, 0x80 | (size if not long else 126 if len(long) == 2 else 127)]) + (long or b"")

        async def send() -> None:
            connection = self._socket._response.connection
            assert connection is not None
            assert connection.transport is not None
            connection.transport.write(head + bytes(4) + content)  # a mask of zeros

        wait(send())

    def write(self, call: Any) -> None:
        self.send(json.dumps(call))

    def receive(self, seconds: float = PATIENCE) -> dict[str, Any]:
        """The next message; raises ConnectionError where the other side has hung up."""

        async def receive() -> dict[str, Any]:
            got = await self._socket.receive()
            if got.type is not aiohttp.WSMsgType.BINARY:
                raise ConnectionError(f"{got.type.name}: {got.data}")
            return unpacked(got.data)

        return wait(receive(), seconds)

    def ask(self, call: Any, request: Any = None) -> dict[str, Any]:
        """The answer to a call: what was asked for, or `error`."""
        self.write({"call": call, "request": request})
        return self.receive()

    def frame(self, **changes: Any) -> dict[str, Any]:
        """The answer to a good request for pictures, with `changes`."""
        return self.ask("frame", message(**changes))


def lives(tab: Tab) -> None:
    """The tab still gets a frame."""
    answer = tab.frame()
    assert "error" not in answer
    assert answer["pictures"][0].startswith(b"\x89PNG")


def raw_answer(address: str, target: str, *, method: str = "GET", headers: str = "", body: str = "") -> tuple[int, str]:
    """Status and all else of the answer to a request that no library has made harmless; `headers` as "Name: value\\r\\n"."""
    parts = urlsplit(address)
    assert parts.hostname is not None
    assert parts.port is not None
    if "host:" not in headers.lower():
        headers += f"Host: {parts.netloc}\r\n"
    content = body.encode()
    with socket.create_connection((parts.hostname, parts.port), timeout=10) as line:
        head = f"{method} {target} HTTP/1.1\r\n{headers}Connection: close\r\nContent-Length: {len(content)}\r\n\r\n"
        line.sendall(head.encode("latin-1") + content)
        answer = b""
        while piece := line.recv(1 << 16):
            answer += piece
    status = re.match(rb"HTTP/1\.[01] (\d+) ", answer)
    assert status is not None, answer[:200]
    return int(status[1]), answer.decode("utf-8", "replace")


@contextmanager
def served(run: Run) -> Iterator[str]:
    """The address of a running explorer of `run`."""
    from surrogate.explore.server.notebook import NotebookExplorer

    explorer = NotebookExplorer(run)
    try:
        yield explorer.address
    finally:
        explorer.close()


def harmless(answer: Any) -> str:
    """The answer is an error that tells nothing of this machine; returns it."""
    said = repr(answer)
    assert "error" in answer
    assert len(said) < 1000
    for secret in ("Traceback", ".py", "site-packages", ROOT, "/tmp", "File "):
        assert secret not in said
    return said
