"""Cinema:Explorer, the clients' own viewer, opens our catalogs."""

from __future__ import annotations

import functools
import http.server
import subprocess
import threading
from pathlib import Path
from typing import Any

import pytest

from catalogs.catalog import Catalog
from tests.catalogs.chromium import Browser

PROJECT = Path(__file__).resolve().parents[3]


def test_cinema_explorer_opens_the_catalog(catalog: Catalog, tmp_path: Path, browser: Browser) -> None:
    """The way that the README describes: cinemasci installs its viewer beside the catalog, any static server serves it."""
    environment = PROJECT / ".venv-cinemasci"
    if not (environment / ".complete").exists():
        pytest.skip("cinemasci is not installed in .venv-cinemasci: `make clients` does it")
    install = ["-m", "cinemasci.install", "--path", ".", "--database", catalog.path.name, "--viewer", "explorer"]
    subprocess.run([environment / "bin/python", *install], cwd=tmp_path, check=True, capture_output=True)

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *arguments: Any) -> None:
            pass

    handler = functools.partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as host:
        threading.Thread(target=host.serve_forever, daemon=True).start()
        browser.open(f"http://127.0.0.1:{host.server_address[1]}/cinema_explorer.html")
        browser.wait_for("document.querySelectorAll('svg path').length > 40")
        requests = [
            e["params"]["request"]["url"] for e in browser.events if e.get("method") == "Network.requestWillBeSent"
        ]
        assert all(url.startswith(f"http://127.0.0.1:{host.server_address[1]}/") for url in requests), requests
        text = browser.evaluate("document.body.innerText")
        assert "Re" in text
        assert "view_split" in text
        images = "[...document.querySelectorAll('img')].filter(i => i.src.includes('/members/'))"
        browser.wait_for(f"{images}.length > 0 && {images}.every(i => i.complete && i.naturalWidth === 16)")
        host.shutdown()
