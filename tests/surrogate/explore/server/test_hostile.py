"""Messages of strangers and broken tabs: each gets an error, others do not notice, and the same tab continues."""

from __future__ import annotations

import json
import math
import os
import random
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import aiohttp
import psutil
import pytest

pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")

from surrogate.explore.run import Run
from surrogate.explore.server.notebook import NotebookExplorer
from tests.support import requests
from tests.support.models import plain
from tests.support.requests import message
from tests.support.tabs import ROOT, Tab, harmless, lives, wait


def test_a_tab_gets_facts_and_frames(tab: Tab) -> None:
    facts = tab.ask("facts")
    assert facts["title"] == "blobs"
    assert ROOT not in json.dumps(facts)
    lives(tab)
    assert tab.ask("nearest", message())["found"]["parameters"]["p"] in (0.0, 0.25, 0.5)


NO_MESSAGES: dict[str, bytes | str] = {
    "nothing": "",
    "no bytes": b"",
    "text": "hello",
    "a long text": "x" * 100_000,
    "noise": random.Random(1).randbytes(5000),
    "a message as bytes": b'{"call": "facts"}',
    "an int": "3",
    "a list": "[1, 2]",
    "a text": '"facts"',
    "null": "null",
    "half a message": '{"call": "facts"',
    "two messages": '{"call": "facts"}{"call": "facts"}',
    "no call": "{}",
    "a number as call": '{"call": 3}',
    "a list as call": '{"call": ["facts"]}',
    "an object as call": '{"call": {"facts": 1}}',
    "a huge name": json.dumps({"call": "x" * 10**6}),
    "half a character": '{"call": "\\ud800"}',
    "no escape": '{"call": "\\x"}',
    "nested 100,000 deep": "[" * 100_000,
    "nested 10,000 deep in a request": '{"call": "frame", "request": ' + "[" * 10_000 + "]" * 10_000 + "}",
    "a number of 100,000 digits": '{"call": "facts", "request": ' + "1" * 100_000 + "}",
}


@pytest.mark.parametrize("name", NO_MESSAGES)
def test_what_is_no_message_gets_an_error_and_the_tab_lives_on(tab: Tab, name: str) -> None:
    tab.send(NO_MESSAGES[name])
    harmless(tab.receive())
    lives(tab)


def test_text_that_is_none_ends_the_connection_of_its_sender_alone(explorer: str, tab: Tab) -> None:
    with Tab(explorer) as mad:
        mad.broken(b"\xff\xfe")  # said to be UTF-8
        with pytest.raises(ConnectionError):
            mad.receive()
    lives(tab)


@pytest.mark.parametrize("token", ["", "wrong", "None", "0", "[]", "{}", "%00", "%ff", "ü" * 50, "x" * 4000])
@pytest.mark.parametrize("place", ["query", "cookie"])
def test_only_the_token_opens(guarded: str, place: str, token: str) -> None:
    """Without a needed token there is no connection, so no message is ever read."""
    target, headers = (f"ws?token={token}", {}) if place == "query" else ("ws", {"Cookie": f"gs-surrogate={token}"})

    async def attempt() -> int:
        async with aiohttp.ClientSession() as session:
            try:
                async with session.ws_connect(f"{guarded.replace('http', 'ws')}{target}", headers=headers):
                    return 101
            except aiohttp.WSServerHandshakeError as error:
                return error.status

    assert wait(attempt()) == 403


@pytest.fixture(scope="module")
def guarded() -> Iterator[str]:
    """The address, without its token, of a server that wants one."""
    shown = NotebookExplorer(Run("plain", plain()), base_url="/jupyter/")
    yield f"http://127.0.0.1:{shown._explorer.port}/"
    shown.close()


CALLS = "facts, frame, model, expected, over, next, probe, here, predictions, follow, made, survey, nearest"
CLOSED = [
    "trame.state.get",
    "Facts",
    "frame ",
    "_frame",
    "serve",
    "close",
    "wslink.hello",
    "__class__",
    "",
    "x" * 10_000,
]


@pytest.mark.parametrize("name", CLOSED)
def test_nothing_else_can_be_called(tab: Tab, name: str) -> None:
    before = tab.ask("facts")
    for request in (None, [], {}, [{"key": "title", "value": "<b>mine</b>"}], "title"):
        assert (
            "call is one of facts, frame, model, expected, over, next, probe, here, predictions, follow, made, survey, nearest"
            in harmless(tab.ask(name, request))
        )
    assert tab.ask("facts") == before
    lives(tab)


def test_more_than_a_call_and_its_request_is_not_minded(tab: Tab) -> None:
    tab.write({"call": "facts", "request": [1], "id": 3, "args": {}, "kwargs": [], "__class__": "x"})
    assert tab.receive()["title"] == "blobs"
    tab.write({"request": message(), "call": "frame", "message": 3})
    assert "pictures" in tab.receive()
    for request in (None, "abc", 3, [message()], {"message": message()}, [[]]):
        harmless(tab.ask("frame", request))
    tab.write({"call": "frame"})
    harmless(tab.receive())
    lives(tab)


def test_answers_come_in_the_order_of_the_calls(tab: Tab) -> None:
    for size in range(16, 48, 2):
        tab.write({"call": "frame", "request": message(size=[size, 16])})
        tab.send("noise")
    for size in range(16, 48, 2):
        assert tab.receive()["size"] == [size, 16]
        harmless(tab.receive())


@pytest.mark.parametrize("call", ["frame", "nearest", "expected", "over", "probe", "here", "predictions"])
def test_wrong_requests_get_their_sentence(tab: Tab, call: str) -> None:
    for changes, complaint in requests.WRONG:
        answer = tab.ask(call, message(**changes))
        assert complaint in answer["error"] or "'1'" in answer["error"]  # JSON has no other names
        harmless(answer)
    for nothing in (None, 3, "x", [], [[]], {}, "x" * 900_000, [message()] * 100):
        harmless(tab.ask(call, nothing))
    lives(tab)


@pytest.mark.parametrize("about", [None, 3, "", "x" * 100_000, "__class__", ["p"], {"p": 1}])
def test_a_map_is_about_a_parameter_or_the_error(tab: Tab, about: Any) -> None:
    answer = tab.ask("over", message(about=about))
    harmless(answer)
    assert "a map is about 'error' or a parameter" in answer["error"]
    lives(tab)


def test_depth_and_length_are_no_trouble(tab: Tab) -> None:
    deep: Any = 0
    for _ in range(400):
        deep = [deep]
    for value in (deep, {"p": deep}, ["x" * 100_000], dict.fromkeys(map(str, range(10_000)), 0.0)):
        harmless(tab.frame(settings=[{"parameters": value}]))
        harmless(tab.frame(settings=value))
        harmless(tab.frame(background=value))
        harmless(tab.frame(size=[value, value]))
    lives(tab)


def test_announced_gigabytes_are_not_laid_out(explorer: str, tab: Tab) -> None:
    process = psutil.Process()
    before = process.memory_info().vms
    for size in (2**31, 2**62):
        with Tab(explorer) as who:
            who.broken(b"[" * 100, announced=size)
            with pytest.raises(ConnectionError):
                who.receive()
    halves = [Tab(explorer) for _ in range(20)]
    for who in halves:  # as many halves of messages as one likes
        who.broken(b"[" * 100, announced=500)
    assert process.memory_info().vms - before < 2**28
    lives(tab)
    for who in halves:
        who.vanish()


def test_one_message_is_at_most_a_megabyte(explorer: str, tab: Tab) -> None:
    with Tab(explorer) as loud:
        with suppress(ConnectionError):  # while it is still being sent
            loud.send("x" * (3 << 20))
        with pytest.raises(ConnectionError):
            loud.receive()
    lives(tab)


def call_for(**changes: Any) -> dict[str, Any]:
    return {"call": "frame", "request": message(**changes)}


@pytest.mark.slow
def test_a_flood_holds_up_no_one_else(explorer: str, tab: Tab) -> None:
    mad = Tab(explorer)
    sending = mad.flood(call_for(), 2000)
    answers: list[dict[str, Any]] = []
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(lambda: [answers.append(mad.receive()) for _ in range(300)])
        turns = 0
        while not reading.done():
            lives(tab)
            turns += 1
    assert turns > 30  # while the flood had 300
    assert all("error" not in answer for answer in answers)
    sending.cancel()
    mad.vanish()
    lives(tab)
    with Tab(explorer) as again:
        lives(again)


def narrow(address: str) -> None:
    """Let little be on the way from this process' server to whoever connects from now on."""
    port = urlsplit(address).port
    (listening,) = (c.fd for c in psutil.Process().net_connections() if c.status == "LISTEN" and c.laddr.port == port)
    with socket.socket(fileno=os.dup(listening)) as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)


def test_who_does_not_read_holds_up_no_one_else() -> None:
    shown = NotebookExplorer(Run("plain", plain()))
    narrow(shown.address)
    near = {**requests.CAMERA, "position": [1.5, 0.5, 0.2]}
    with Tab(shown.address) as tab:
        deaf = Tab(shown.address)
        deaf.narrow()
        sending = deaf.flood(call_for(size=[1024, 1024], camera=near), 100)
        for _ in range(5):
            lives(tab)
            time.sleep(0.2)  # longer than it takes to draw for the deaf
        sending.cancel()
        deaf.vanish()
        lives(tab)
    shown.close()


def test_four_tabs_that_move_get_frames_in_turn(explorer: str) -> None:
    tabs = [Tab(explorer) for _ in range(4)]
    ready, order = threading.Barrier(4), []

    def move(tab: Tab) -> None:
        ready.wait(60)
        for step in range(25):
            assert "error" not in tab.frame(
                settings=[{"parameters": {"p": step / 25}}], size=[256, 256], form="jpeg", camera=camera(step)
            )
            order.append(tab)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(move, tabs))
    for tab in tabs:
        tab.close()
    first = min(max(i for i, tab in enumerate(order) if tab is one) for one in tabs)  # when one had all of its own
    assert all(order[:first].count(tab) >= 10 for tab in tabs)


def test_tabs_get_what_they_asked_for_and_not_what_others_did(explorer: str) -> None:
    wanted = [{"settings": [{"parameters": {"p": i / 8}}], "size": [40 + 8 * i, 32]} for i in range(8)]
    with ThreadPoolExecutor(8) as pool:

        def ask(changes: dict[str, Any]) -> list[dict[str, Any]]:
            with Tab(explorer) as tab:
                return [tab.frame(**changes) for _ in range(5)]

        answers = list(pool.map(ask, wanted))
    with Tab(explorer) as tab:
        for changes, got in zip(wanted, answers, strict=True):
            alone = tab.frame(**changes)
            assert all((a["size"], a["pictures"]) == (changes["size"], alone["pictures"]) for a in got)


@pytest.mark.slow
def test_tabs_that_come_and_go_leave_nothing(explorer: str) -> None:
    process = psutil.Process()

    def visit(number: int) -> None:
        tab = Tab(explorer)
        if number % 4 == 0:
            lives(tab)
        elif number % 4 == 1:
            tab.write(call_for())
        (tab.vanish if number % 3 == 0 else tab.close)()

    def visits(count: int) -> tuple[int, int]:
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(visit, range(count)))
        deadline = time.monotonic() + 10
        while len(process.net_connections()) > quiet and time.monotonic() < deadline:
            time.sleep(0.1)
        return len(process.net_connections()), threading.active_count()

    time.sleep(0.2)
    quiet = len(process.net_connections())
    visits(16)
    connections, threads = visits(400)
    assert connections <= quiet
    assert threads <= visits(16)[1]
    with Tab(explorer) as tab:
        lives(tab)


def camera(step: int) -> dict[str, Any]:
    return {**requests.CAMERA, "position": [3.0 + math.cos(step), math.sin(step), 0.5 + step % 7 / 7]}


@pytest.mark.slow(seconds=15)
def test_thousands_of_frames_take_no_memory(run_folder: Path) -> None:
    from tests.support.explorer_process import address_in, installed

    frames = 4000
    with installed(run_folder) as (process, line), Tab(address_in(line)) as tab:
        server = psutil.Process(process.pid)
        shown: list[dict[str, Any]] = [{}, {"isovalue": 0.3}, {"c1_value": 0.1}, {"c2_value": -0.1, "c2_opacity": 0.05}]
        memory = []
        for step in range(frames):
            if step % 100 == 0:
                with Tab(address_in(line)) as other:
                    lives(other)
            setting = {"parameters": {"p": step / frames}, "visualization": shown[step % 4]}
            answer = tab.frame(
                settings=[setting], camera=camera(step), form="jpeg" if step % 5 else "png", truth=step % 3 == 0
            )
            assert "error" not in answer
            if step % 500 == 499:
                memory.append(server.memory_info().rss)
        assert memory[-1] - memory[1] < frames // 2 << 10, [m >> 10 for m in memory]  # half a kilobyte a frame
