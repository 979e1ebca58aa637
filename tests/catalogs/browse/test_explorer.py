"""Cinema:Explorer and Cinema:View, the clients' own viewers, open our catalogs."""

from __future__ import annotations

import csv
import functools
import http.server
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from PIL import Image

from catalogs.store.catalog import Catalog
from tests.support.browsers import DESKTOP, NewPage

if TYPE_CHECKING:
    from playwright.sync_api import Page

PROJECT = Path(__file__).resolve().parents[3]
DISPENSABLE = ("favicon.ico", "axis_order.csv", "cinema_attributes.json")  # asked for by the viewers, and not there


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *arguments: Any) -> None:
        pass


@contextmanager
def opened(folder: Path, catalog: Catalog, viewer: str, new_page: NewPage, complaints: list[str]) -> Iterator[Page]:
    """The way that the README describes: cinemasci installs its viewer beside the catalog, any static server serves it."""
    environment = PROJECT / ".venv-cinemasci"
    if not (environment / ".complete").exists():
        pytest.skip("cinemasci is not installed in .venv-cinemasci: `make clients` does it")
    install = ["-m", "cinemasci.install", "--path", ".", "--database", catalog.path.name, "--viewer", viewer]
    subprocess.run([environment / "bin/python", *install], cwd=folder, check=True, capture_output=True)
    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as host:
        threading.Thread(target=host.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{host.server_address[1]}/"
        page, requests = new_page(viewport=DESKTOP), list[str]()
        page.on("request", lambda request: requests.append(request.url))
        page.goto(f"{address}cinema_{viewer}.html")
        yield page
        page.close()  # it complains no more
        assert all(url.startswith(address) for url in requests), requests
        assert [c for c in complaints if not any(f"/{name}" in c for name in DISPENSABLE)] == []
        complaints.clear()
        host.shutdown()


def test_cinema_explorer_opens_the_catalog(
    catalog: Catalog, tmp_path: Path, new_page: NewPage, complaints: list[str]
) -> None:
    with opened(tmp_path, catalog, "explorer", new_page, complaints) as page:
        page.wait_for_function("() => document.querySelectorAll('svg path').length > 40")
        text = page.locator("body").inner_text()
        assert "Re" in text
        assert "view_split" in text
        page.wait_for_function(
            """() => {
                const images = [...document.querySelectorAll('img')].filter(i => i.src.includes('/members/'));
                return images.length > 0 && images.every(i => i.complete && i.naturalWidth === 16);
            }"""
        )


@pytest.mark.slow
def test_cinema_view_opens_the_catalog(
    catalog: Catalog, tmp_path: Path, new_page: NewPage, complaints: list[str]
) -> None:
    """Cinema:View has a slider per numeric column and shows the row where all of them agree.

    View, phi and theta are columns each, and so must be set together: it was written for databases of a full grid.
    """
    with (catalog.path / "data.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    with opened(tmp_path, catalog, "view", new_page, complaints) as page:
        page.wait_for_selector("#sliderContainer > div")
        names = page.locator("#sliderContainer > div > div:first-child").all_text_contents()
        assert {"Re", "Pr", "isovalue", "view", "phi", "theta"} <= set(names)
        for row in (rows[0], rows[-1], rows[len(rows) // 3]):
            for number, name in enumerate(names):
                page.locator("#sliderContainer > div").nth(number).locator("input[type=text]").fill(row[name])
            page.wait_for_function(
                "file => { const i = document.querySelector('#imageArea img'); return i.src.endsWith(file) && i.complete; }",
                arg=f"/{catalog.path.name}/{row['FILE']}",
            )
            with Image.open(catalog.path / row["FILE"]) as stored:
                assert page.locator("#imageArea img").evaluate("i => [i.naturalWidth, i.naturalHeight]") == [16, 12]
                assert stored.size == (16, 12)
