"""The explorer in a notebook: servers in the kernel's own process."""

from __future__ import annotations

import asyncio
import gc
import os
import socket
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import urlopen

import psutil
import pytest

pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")

from surrogate.explore.run import Run
from surrogate.explore.server import explorer
from surrogate.explore.server.notebook import NotebookExplorer, show
from surrogate.explore.setting import Setting
from tests.support.models import plain
from tests.support.requests import message
from tests.support.tabs import Tab, lives, post


@pytest.fixture
def shown() -> Iterator[NotebookExplorer]:
    opened = show(plain())
    yield opened
    opened.close()


def listens(address: str) -> bool:
    parts = urlsplit(address)
    with socket.socket() as line:
        return line.connect_ex((str(parts.hostname), parts.port or 0)) == 0


def names() -> list[str]:
    return sorted(t.name for t in threading.enumerate() if t.name.startswith(("explorer", "draw", "export", "doubt")))


def test_it_shows_itself_in_a_frame(shown: NotebookExplorer) -> None:
    page = shown._repr_html_()
    assert f'<iframe src="{shown.address}"' in page
    assert shown.address in repr(shown)
    with urlopen(shown.address) as answer:
        assert b"<html" in answer.read().lower()
    with Tab(shown.address) as tab:
        lives(tab)


def test_two_at_once_do_not_know_each_other(shown: NotebookExplorer, run_folder: Path) -> None:
    second = show(Run.open(run_folder).surrogate, run_folder)
    assert second.address != shown.address
    with Tab(shown.address) as tab, Tab(second.address) as other:
        assert tab.ask("facts")["title"] == "surrogate"
        assert other.ask("facts")["title"] == "blobs"
        second.close()
        lives(tab)
    assert not listens(second.address)
    assert listens(shown.address)


def test_closing_frees_its_port_and_its_threads() -> None:
    before = names()
    opened = show(plain())
    tab, stranger = Tab(opened.address), Tab(opened.address)
    lives(tab)
    for _ in range(3):
        with pytest.raises(OSError, match="400"):
            urlopen(f"{opened.address}ws")
    opened.close()
    assert not listens(opened.address)
    with socket.socket() as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        line.bind(("127.0.0.1", urlsplit(opened.address).port or 0))
    deadline = time.monotonic() + 60
    while len(names()) > len(before) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(names()) <= len(before)
    opened.close()  # once more does no harm
    tab.close()
    stranger.close()


def test_closing_waits_for_nobody() -> None:
    opened = show(plain())
    deaf = Tab(opened.address)
    deaf.narrow()
    flood = deaf.flood({"call": "frame", "request": message(size=[1024, 1024])}, 200)
    film = message(kind="gif", size=[1600, 1600], sweep={"name": "p", "count": 3})
    made: list[int] = []
    making = threading.Thread(target=lambda: _made(opened.address, film, made))
    making.start()
    time.sleep(1.0)
    opened.close()
    making.join(timeout=60)
    assert not making.is_alive()
    assert 200 not in made
    flood.cancel()
    deaf.vanish()


def _made(address: str, film: object, statuses: list[int]) -> None:
    with suppress(OSError, ValueError):
        statuses.append(post(address, film)[0])


def test_many_after_each_other_leave_nothing() -> None:
    show(plain()).close()
    gc.collect()
    files = psutil.Process().num_fds()
    kept = []
    for _ in range(4):
        opened = show(plain())
        with Tab(opened.address) as tab:
            lives(tab)
        frames = opened._explorer.frames
        kept.append(weakref.ref(frames.member(Setting({"p": 0.5}))))
        opened.close()
    gc.collect()
    assert sum(reference() is not None for reference in kept) == 0
    assert psutil.Process().num_fds() <= files + 2


def test_it_starts_inside_a_running_loop() -> None:
    async def cell() -> None:
        opened = show(plain())
        assert await asyncio.to_thread(listens, opened.address)
        opened.close()

    thread = threading.Thread(target=asyncio.run, args=[cell()])  # Playwright's loop may run in this one
    thread.start()
    thread.join(timeout=60)
    assert not thread.is_alive()


def test_what_does_not_start_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    before = names()

    def fail(*_: object, **__: object) -> None:
        raise OSError("no more ports")

    monkeypatch.setattr(explorer.Explorer, "serve", fail)
    with pytest.raises(RuntimeError, match=r"^the explorer did not start: no more ports$"):
        show(plain())
    assert len(names()) <= len(before)


def test_what_takes_too_long_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    before = names()

    async def sleep() -> None:
        await asyncio.sleep(60)

    monkeypatch.setattr(explorer.Explorer, "serve", lambda *_, **__: sleep())
    monkeypatch.setattr("surrogate.explore.server.notebook.PATIENCE", 0.5)
    with pytest.raises(RuntimeError, match=r"^the explorer did not start: no answer in 0\.5 s$"):
        show(plain())
    assert len(names()) <= len(before)


def test_folders_that_are_no_runs_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=str(tmp_path)):
        show(plain(), tmp_path)


@pytest.mark.slow
def test_a_notebook_shows_it(run_folder: Path, tmp_path: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    code = f"""
from surrogate import Surrogate
from surrogate.explore.server.notebook import show
from urllib.request import urlopen
shown = show(Surrogate.load({str(run_folder / "surrogate")!r}), {str(run_folder)!r})
print(len(urlopen(shown.address + "explore/explore.js").read()) > 100)
shown
"""
    notebook = nbformat.v4.new_notebook(
        cells=[nbformat.v4.new_code_cell(code), nbformat.v4.new_code_cell("shown.address")]
    )
    root = str(Path(__file__).parents[4])
    here = {**os.environ, "PYTHONPATH": root, "JUPYTER_PLATFORM_DIRS": "1"}

    def execute() -> None:  # nbclient runs a loop of its own
        client.NotebookClient(notebook, timeout=120, kernel_name="python3").execute(cwd=str(tmp_path), env=here)

    thread = threading.Thread(target=execute)
    thread.start()
    thread.join(timeout=180)
    outputs = notebook.cells[0].outputs
    assert outputs[0]["text"] == "True\n"
    assert "<iframe" in outputs[1]["data"]["text/html"]
    assert not listens(notebook.cells[1].outputs[0]["data"]["text/plain"].strip("'"))  # the kernel took it with it
