"""The explorer below the path of a Jupyter server that is known by another name, as behind JupyterHub."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import numpy as np
import pytest
from PIL import Image

from surrogate import Surrogate
from surrogate.explore.run import Run
from tests.support.explored import addressed, assert_shown, open_explorer, request_of, saved, settled
from tests.support.explorer_process import command
from tests.support.jupyter import PREFIX, TOKEN, jupyter, login

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not find_spec("jupyter_server_proxy"), reason="there is no proxy to stand behind"),
]
HUB = "hub.localhost"  # which browsers find on this machine


@pytest.fixture(scope="module")
def hub(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """`http://hub:port` of a Jupyter server."""
    with jupyter(tmp_path_factory.mktemp("jupyter"), HUB) as address:
        yield address


def test_the_command_is_reached_through_it(
    page: Page,
    hub: str,
    run_folder: Path,
    surrogate: Surrogate,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    complaints: list[str],
) -> None:
    monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", PREFIX)  # as JupyterHub does
    with command(run_folder) as (process, line):
        (path,) = re.findall(r" (/\S+) on the host of Jupyter", line)
        assert re.fullmatch(rf"{PREFIX}proxy/\d+/\?token=[\w-]{{32,}}", path)
        page.goto(login(hub))
        open_explorer(page, f"{hub}{path}", "a.p.p=0.3&hide=title,legend,box,axes")
        assert urlsplit(page.url).path == urlsplit(path).path
        assert "token" not in page.url
        seen = assert_shown(page, surrogate)
        page.locator("#stage").press("ArrowRight")
        moved = assert_shown(page, surrogate)
        assert np.abs(moved - seen).max() > 2 / 255
        picture = np.asarray(Image.open(saved(page, "png", tmp_path)).convert("RGB")) / 255
        assert np.abs(picture - moved).max() <= 1e-6
        page.locator("#mode-compare").click()
        settled(page)
        assert page.locator("#compared").inner_text() == "The pictures are bitwise the same."
        addressed(page)
        page.reload()  # with what the address holds, by the cookie
        settled(page)
        assert_shown(page, surrogate, 1)
        process.terminate()
        page.locator("#lost").filter(has_text="The explorer has stopped").wait_for()
        page.close()  # it complains of its attempts to find it again
        complaints.clear()


def test_a_notebook_shows_it_through_it(page: Page, hub: str, run_folder: Path, surrogate: Surrogate) -> None:
    shown = surrogate.show(run_folder, base_url="user/name")
    try:
        notebook = f"{hub}{PREFIX}lab"  # a page of its own making, but of the same origin
        page.route(notebook, lambda route: route.fulfill(content_type="text/html", body=shown._repr_html_()))
        page.goto(login(hub))
        page.goto(notebook)
        frame = page.frame_locator("iframe")
        frame.locator("#expected").filter(has_text="dB").wait_for()
        assert "blobs" in frame.locator("h1").inner_text()
    finally:
        page.close()
        shown.close()


def test_it_wants_its_token_from_everybody(hub: str, run_folder: Path) -> None:
    from surrogate.explore.server.notebook import NotebookExplorer

    shown = NotebookExplorer(Run.open(run_folder), base_url=PREFIX)
    port = shown._explorer.port
    known = {"Authorization": f"token {TOKEN}"}
    for address, headers in (
        (f"http://127.0.0.1:{urlsplit(hub).port}{PREFIX}proxy/{port}/", known),  # Jupyter's token is not the explorer's
        (f"http://127.0.0.1:{port}/", {}),
        (f"http://127.0.0.1:{port}/", {"Host": HUB, "X-Forwarded-Prefix": f"{PREFIX}proxy/{port}"}),
    ):
        with pytest.raises(HTTPError, match="403"):
            urlopen(Request(address, headers=headers))
    shown.close()


def test_without_a_base_url_this_machines_own_names_lead_there_too(
    page: Page, hub: str, explorer: str, surrogate: Surrogate
) -> None:
    here = f"http://127.0.0.1:{urlsplit(hub).port}"
    page.goto(login(here))
    open_explorer(page, f"{here}{PREFIX}proxy/{urlsplit(explorer).port}/")
    assert_shown(page, surrogate)


def test_an_address_without_its_last_slash_leads_there_too(
    page: Page, hub: str, run_folder: Path, complaints: list[str]
) -> None:
    shown = Run.open(run_folder).surrogate.show(run_folder, base_url=PREFIX)
    try:
        page.goto(login(hub))
        bare, _, token = shown.address.partition("/?")
        page.goto(f"{hub}{bare}?{token}#a.p.p=0.3")
        settled(page)
        assert page.url.startswith(f"{hub}{bare}/")
        assert "token" not in page.url
        assert request_of(page)["settings"][0]["parameters"] == {"p": 0.3}
        page.goto(f"{hub}{bare}#a.p.p=0.4")  # by the cookie
        settled(page)
        assert request_of(page)["settings"][0]["parameters"] == {"p": 0.4}
    finally:
        page.close()
        complaints.clear()  # of what browsers ask for before they are led there
        shown.close()
