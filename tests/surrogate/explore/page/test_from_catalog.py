"""From a picture in a catalog's page to the explorer at its parameters, appearance and view, and back."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from catalogs.browse import CatalogServer, page_of
from catalogs.store.catalog import Catalog
from tests.support import browsed
from tests.support.browsers import serious_findings
from tests.support.explored import request_of, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page

APPEARANCES = ("", "isovalue", "c1_value")  # the base, and one with each of these parameters


@pytest.fixture(scope="module")
def beside(run_folder: Path, explorer: str) -> Iterator[tuple[Catalog, str]]:
    """The run's catalog, and the address of its page, which knows the explorer's."""
    catalog = Catalog.open(run_folder / "catalog.cdb")
    server = CatalogServer(catalog.path, page_of(catalog, explorer).encode())
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield catalog, server.address
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.mark.slow
@pytest.mark.parametrize("parameter", APPEARANCES)
def test_a_picture_opens_in_the_explorer_and_back_leads_to_it(
    page: Page, beside: tuple[Catalog, str], parameter: str
) -> None:
    catalog, address = beside
    plan = catalog.plan
    names = plan.appearance_names
    base = plan.varied(names[0])
    name = next((n for n in names if parameter and plan.varied(n)[parameter] != base[parameter]), names[0])
    browsed.visit(page, f"{address}#member=train-3&appearance={name}&view=7")
    link = page.get_by_role("link", name="Explore")
    assert serious_findings(page) == []
    link.click()
    settled(page)
    assert page.locator("#note").is_hidden(), page.locator("#note").inner_text()
    request = request_of(page)
    (setting,) = request["settings"]
    assert setting["parameters"] == {"p": 0.9}
    assert setting["visualization"] == pytest.approx({n: plan.varied(name)[n] for n in setting["visualization"]})
    assert (parameter in setting["visualization"]) == bool(parameter)
    camera = catalog.member("train-3").cameras[7]
    seen = np.subtract(request["camera"]["position"], request["camera"]["target"])
    assert seen / np.linalg.norm(seen) == pytest.approx(-camera.forward, abs=1e-5)
    page.go_back()
    page.wait_for_function("() => document.getElementById('panes')")
    assert browsed.shown(page) == ("train-3", name, 7)


def test_a_page_without_an_explorer_links_to_none_and_code_is_no_address(run_folder: Path) -> None:
    catalog = Catalog.open(run_folder / "catalog.cdb")
    assert '"explorer":""' in page_of(catalog)
    with pytest.raises(ValueError, match="begins with http"):
        page_of(catalog, "javascript:alert(1)")
