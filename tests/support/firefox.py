"""Firefox without a window, driven by WebDriver BiDi (https://www.w3.org/TR/webdriver-bidi/)."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest

PROGRAMS = ("firefox-esr", "firefox")
PATIENCE = 60.0  # seconds
LISTENS = "WebDriver BiDi listening on "


class Firefox:
    """One page of a running Firefox; `complaints` are the errors of its console."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._numbers, self.complaints = socket, count(1), list[str]()
        self._page: dict[str, Any] = {}

    async def ask(self, method: str, **parameters: Any) -> Any:
        """The result of a command; raises RuntimeError for a refused one."""
        number = next(self._numbers)
        await self._socket.send_json({"id": number, "method": method, "params": parameters})
        while True:
            message = json.loads((await self._socket.receive(timeout=PATIENCE)).data)
            if message.get("method") == "log.entryAdded" and message["params"]["level"] == "error":
                self.complaints.append(str(message["params"]["text"]))
            if message.get("id") != number:
                continue
            if message["type"] == "error":
                raise RuntimeError(message["message"])
            return message["result"]

    async def open(self, address: str) -> None:
        """Go to an address and wait until it is loaded."""
        await self.ask("browsingContext.navigate", context=self._page["context"], url=address, wait="complete")

    async def start(self) -> None:
        """Find the page."""
        await self.ask("session.new", capabilities={})
        await self.ask("session.subscribe", events=["log.entryAdded"])
        self._page = (await self.ask("browsingContext.getTree"))["contexts"][0]

    async def value(self, expression: str) -> Any:
        """The plain value of an expression."""
        target = {"context": self._page["context"]}
        answer = await self.ask("script.evaluate", expression=expression, target=target, awaitPromise=True)
        return answer["result"].get("value")

    async def until(self, expression: str) -> None:
        """Wait until an expression is true; raises TimeoutError where it does not become so."""
        async with asyncio.timeout(PATIENCE):
            while not await self.value(f"Boolean({expression})"):
                await asyncio.sleep(0.1)


@asynccontextmanager
async def firefox(profile: Path) -> AsyncIterator[Firefox]:
    """A running Firefox with a new profile in a folder; the test skips where there is none."""
    program = next((path for name in PROGRAMS if (path := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no Firefox to test pages with (looked for {', '.join(PROGRAMS)})")
    aiohttp = pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")
    options = ["--headless", "--no-remote", "--profile", str(profile), "--remote-debugging-port", "0"]
    process = await asyncio.create_subprocess_exec(program, *options, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        assert process.stderr is not None
        async with asyncio.timeout(PATIENCE):
            while not (line := (await process.stderr.readline()).decode()).startswith(LISTENS):
                assert line, "Firefox has stopped"
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{line.removeprefix(LISTENS).strip()}/session", max_msg_size=0) as socket,
        ):
            running = Firefox(socket)
            await running.start()
            yield running
    finally:
        process.terminate()
        await process.wait()
