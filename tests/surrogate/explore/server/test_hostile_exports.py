"""Exports that are too many, too large or wrong."""

from __future__ import annotations

import json
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

import pytest

pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")

from surrogate.explore.exporting.exports import Export, exported
from tests.support import exports, requests
from tests.support.requests import message
from tests.support.tabs import Tab, harmless, lives, post

SWEEP = {"name": "p", "low": "", "high": "", "count": 3}


@pytest.mark.slow
def test_frames_keep_coming_while_films_are_made(explorer: str, tab: Tab) -> None:
    film = message(kind="mp4", size=[240, 240], sweep=SWEEP)
    with ThreadPoolExecutor(2) as pool:
        making = [pool.submit(post, explorer, film) for _ in range(2)]
        frames = 0
        while not all(made.done() for made in making):
            lives(tab)
            frames += 1
    assert frames >= 10
    for made in making:
        status, content = made.result()
        assert (status, content[4:8]) == (200, b"ftyp")


def test_exports_that_nobody_waits_for_are_not_made(explorer: str, tab: Tab, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def noted(*arguments: Any) -> Export:
        export = exported(*arguments)
        made.append(export.media_type)
        return export

    monkeypatch.setattr("surrogate.explore.server.explorer.exported", noted)
    parts = urlsplit(explorer)
    body = json.dumps(message(kind="gif", size=[1600, 1600], sweep=SWEEP)).encode()
    head = f"POST /export HTTP/1.1\r\nHost: {parts.netloc}\r\nContent-Length: {len(body)}\r\n\r\n".encode()
    for _ in range(5):
        with socket.create_connection((str(parts.hostname), parts.port or 0)) as line:
            line.sendall(head + body)
            time.sleep(0.1)
    status, _ = post(explorer, message(kind="png"))
    assert status == 200
    assert made == ["image/png"]
    lives(tab)


@pytest.mark.slow
def test_a_flood_of_exports_is_turned_away(explorer: str, tab: Tab) -> None:
    sheet = message(kind="sheet", size=[256, 256], sweep={**SWEEP, "count": 20})
    with ThreadPoolExecutor(20) as pool:
        answers = list(pool.map(lambda _: post(explorer, sheet), range(20)))
        lives(tab)
    statuses = [status for status, _ in answers]
    assert set(statuses) == {200, 503}
    assert statuses.count(200) >= 8
    assert all("try again" in answer["error"] for status, answer in answers if status == 503)


def test_wrong_exports_get_their_sentence(explorer: str, tab: Tab) -> None:
    wrong = [*exports.WRONG, *(({"kind": "png", **changes}, said) for changes, said in requests.WRONG)]
    for changes, complaint in wrong:
        status, answer = post(explorer, message(**changes))
        assert status == 400
        assert complaint in answer["error"] or "'1'" in answer["error"]  # JSON has no other names
        harmless(answer)
    lives(tab)


def test_large_bodies_are_refused(explorer: str, tab: Tab) -> None:
    with suppress(OSError, ValueError):  # refused before it is sent, or not in JSON
        assert post(explorer, b"[" + b"0," * (1 << 20) + b"0]")[0] == 413
    lives(tab)
