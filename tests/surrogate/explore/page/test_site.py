"""A page as a folder for a web host: served by a plain server below any path, it asks for its own files alone."""

from __future__ import annotations

import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from surrogate import Surrogate
from surrogate.explore.exporting.commands import export
from tests.support.browsers import serious_findings

if TYPE_CHECKING:
    from playwright.sync_api import Page

BELOW = "people/me/blobs.site"


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A plain server of files that says nothing."""

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory, surrogate: Surrogate) -> Iterator[tuple[str, Path]]:
    """The address of a host that has the page of a run below a path, and the page's folder."""
    folder = tmp_path_factory.mktemp("host")
    surrogate.save(folder / "run" / "surrogate")
    site = folder / "web" / BELOW
    site.parent.mkdir(parents=True)
    made = CliRunner().invoke(export, [str(folder / "run"), "-o", str(site)])
    assert made.exit_code == 0, made.output
    assert "which opens in a browser without a program" in made.output
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder / "web"))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/", site
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.mark.slow
def test_a_plain_host_serves_it_and_nothing_else_is_asked(page: Page, host: tuple[str, Path]) -> None:
    address, site = host
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(f"{address}{BELOW}/#a.p.p=0.3")
    page.wait_for_function("() => window.explorer?.resting && window.explorer.counted.whole > 0")
    assert "p = 0.3" in page.locator(".annotations").first.text_content()
    before = page.locator("#stage canvas").evaluate("canvas => canvas.toDataURL()")
    page.locator("#parameter-0").press("End")
    page.wait_for_function(
        "before => window.explorer.resting && document.querySelector('#stage canvas').toDataURL() !== before",
        arg=before,
    )
    page.locator("#export").scroll_into_view_if_needed()
    assert serious_findings(page) == []
    own = {f"{address}{BELOW}/{path.relative_to(site)}" for path in site.rglob("*") if path.is_file()}
    asked = {url for url in requests if not url.startswith(("data:", "blob:"))}
    assert asked <= own | {f"{address}{BELOW}/"}
    assert f"{address}{BELOW}/model.safetensors" in asked


@pytest.mark.slow
def test_a_file_that_is_missing_is_named(page: Page, host: tuple[str, Path], complaints: list[str]) -> None:
    page.route("**/model.safetensors", lambda route: route.fulfill(status=404))
    page.goto(f"{host[0]}{BELOW}/")
    page.wait_for_function("() => document.body.textContent.includes('does not send model.safetensors')")
    assert complaints
    complaints.clear()


def test_a_folder_that_exists_stays_as_it_is(host: tuple[str, Path]) -> None:
    site = host[1]
    before = (site / "index.html").stat().st_mtime_ns
    result = CliRunner().invoke(export, [str(site.parents[3] / "run"), "-o", str(site)])
    assert result.exit_code == 1
    assert "exists: remove it first" in result.output
    assert (site / "index.html").stat().st_mtime_ns == before
    assert list(site.parent.iterdir()) == [site]
