"""The explorer as a person uses it: every control is operated in a real browser, and what comes is what the API draws."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from catalogs import Catalog
from surrogate import Surrogate
from surrogate.storage.picture_records import record_of
from tests.support.browsers import NewPage, serious_findings
from tests.support.explored import (
    addressed,
    assert_shown,
    drag,
    drawn,
    go,
    open_explorer,
    request_of,
    saved,
    settled,
    shown,
)

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def changed(page: Page, surrogate: Surrogate, operate: Callable[[], object]) -> np.ndarray:
    """Do something that must change the picture into the one that the API draws; returns it."""
    before = shown(page)
    operate()
    after = assert_shown(page, surrogate)
    assert after.shape != before.shape or np.abs(after - before).max() > 2 / 255
    return after


def test_the_first_picture_is_the_middle_of_the_parameters(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    picture = assert_shown(page, surrogate)
    assert picture.std() > 0.02
    assert request_of(page)["settings"] == [{"parameters": {"p": 0.5}, "visualization": {}, "color_map": ""}]
    assert "blobs" in page.title()


CONTROLS: list[Callable[[Page], object]] = [
    lambda page: drag(page, "#stage", 120, 0),
    lambda page: drag(page, "#stage", 0, 90),
    lambda page: drag(page, "#stage", 70, 40, key="Shift"),
    lambda page: (page.mouse.move(400, 400), page.mouse.wheel(0, -300)),
    lambda page: page.locator("#stage").press("ArrowRight"),
    lambda page: page.locator("#stage").press("ArrowUp"),
    lambda page: page.locator("#stage").press("Shift+ArrowDown"),
    lambda page: page.locator("#stage").press("+"),
    lambda page: page.locator("#stage").press("-"),
    lambda page: page.get_by_role("button", name="Look from plus z").click(),
    lambda page: page.get_by_role("button", name="Look from minus x").click(),
    lambda page: drag(page, "#parameter-0", 60, 0),
    lambda page: page.locator("#parameter-0").press("ArrowRight"),
    lambda page: page.locator("#parameter-0").press("PageDown"),
    lambda page: (page.get_by_label("p, exact value").fill("0.85"), page.keyboard.press("Enter")),
    lambda page: page.locator("#background").select_option("#ffffff"),
    lambda page: page.locator("#full").select_option("384"),
    lambda page: page.locator("#member").select_option(label="test-0: 0.75"),
    lambda page: page.locator("#kind-isovalue").click(),
]


def test_every_control_changes_the_picture_as_the_api_does(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    for operate in CONTROLS:
        changed(page, surrogate, lambda operate=operate: operate(page))  # type: ignore[misc]
        addressed(page)
        go(page, "full=256")
        settled(page)


def test_dragging_turns_what_is_seen_towards_the_hand(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    before = request_of(page)["camera"]
    changed(page, surrogate, lambda: drag(page, "#stage", 80, 0))
    after = request_of(page)["camera"]
    right = np.cross(np.subtract(before["target"], before["position"]), before["up"])
    assert np.dot(np.subtract(after["position"], before["position"]), right) < 0  # the camera goes the other way
    assert np.linalg.norm(np.subtract(after["position"], after["target"])) == pytest.approx(
        np.linalg.norm(np.subtract(before["position"], before["target"]))
    )


def test_reset_brings_the_first_view_back(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    first = assert_shown(page, surrogate)
    changed(page, surrogate, lambda: drag(page, "#stage", 90, 30))
    page.get_by_role("button", name="Reset", exact=True).click()
    np.testing.assert_array_equal(assert_shown(page, surrogate), first)
    page.locator("#stage").press("ArrowLeft")
    page.locator("#stage").press("Home")
    np.testing.assert_array_equal(assert_shown(page, surrogate), first)


def test_beyond_its_bounds_a_parameter_warns(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    warning = page.locator(".parameter .outside").first
    assert warning.is_hidden()
    page.locator("#parameter-0").press("End")
    assert_shown(page, surrogate)
    assert request_of(page)["settings"][0]["parameters"]["p"] > 1
    assert warning.is_visible()
    assert "Extrapolating" in warning.inner_text()
    page.get_by_label("p, exact value").fill("1")
    page.keyboard.press("Enter")
    assert warning.is_hidden()


def test_the_transfer_function_is_edited_by_hand_keys_and_numbers(
    page: Page, explorer: str, surrogate: Surrogate
) -> None:
    open_explorer(page, explorer)
    page.locator("#kind-transfer_function").click()
    base = assert_shown(page, surrogate)
    second = page.get_by_role("slider", name="Control point c2")
    changed(page, surrogate, lambda: drag(page, ".transfer .handle >> nth=2", -30, -15))
    moved = request_of(page)["settings"][0]["visualization"]
    assert moved["c2_value"] < 0 < moved["c2_opacity"]
    changed(page, surrogate, lambda: second.press("ArrowRight"))
    assert request_of(page)["settings"][0]["visualization"]["c2_value"] > moved["c2_value"]
    page.get_by_role("slider", name="Control point c1").focus()
    changed(page, surrogate, lambda: (page.get_by_label("c1 opacity").fill("0.5"), page.keyboard.press("Enter")))
    changed(page, surrogate, lambda: page.get_by_role("button", name="viridis").click())
    changed(page, surrogate, lambda: page.get_by_role("button", name="as trained").click())
    page.get_by_role("button", name="Reset to base").click()
    np.testing.assert_array_equal(assert_shown(page, surrogate), base)


def test_the_isovalue_slides(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, "a.show=isovalue")
    assert_shown(page, surrogate)
    changed(page, surrogate, lambda: drag(page, "#isovalue", 60, 0))
    changed(page, surrogate, lambda: page.locator("#isovalue").press("ArrowLeft"))
    assert list(request_of(page)["settings"][0]["visualization"]) == ["isovalue"]


def test_two_settings_are_compared(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer)
    page.locator("#mode-compare").click()
    settled(page)
    assert page.locator("#compared").inner_text() == "The pictures are bitwise the same."
    page.locator("#edit-B").click()
    page.get_by_label("p, exact value").fill("0.9")
    page.keyboard.press("Enter")
    first, second = (assert_shown(page, surrogate, number) for number in (0, 1))
    difference = first - second
    psnr = -10 * np.log10(np.mean(difference**2))
    said = page.locator("#compared").inner_text()
    assert float(said.split()[1]) == pytest.approx(psnr, abs=0.1)
    mapped = shown(page, 2)
    changed_most = np.unravel_index(np.abs(difference).mean(axis=2).argmax(), mapped.shape[:2])
    assert mapped[changed_most].sum() > 3 * np.median(mapped.sum(axis=2)) + 0.1
    before = request_of(page)["camera"]
    drag(page, "#stage canvas >> nth=1", 60, 0)
    settled(page)
    assert request_of(page)["camera"] != before
    for number in (0, 1):
        assert_shown(page, surrogate, number)
    first_psnr = page.locator("#compared").inner_text().split(",")[0]
    page.set_viewport_size({"width": 900, "height": 900})
    assert_shown(page, surrogate)
    assert page.locator("#compared").inner_text().split(",")[0] == first_psnr  # whatever the window's shape
    page.get_by_role("button", name="Swap").click()
    settled(page)
    assert [s["parameters"]["p"] for s in request_of(page)["settings"]] == [0.9, 0.5]
    page.get_by_role("button", name="Copy").filter(has_text=" to ").click()
    settled(page)
    assert len({s["parameters"]["p"] for s in request_of(page)["settings"]}) == 1


def test_the_stored_picture_stands_beside_the_prediction(
    page: Page, explorer: str, surrogate: Surrogate, run_folder: Path
) -> None:
    open_explorer(page, explorer, "mode=compare&against=truth&a.p.p=0.4")
    assert request_of(page)["settings"][0]["parameters"] == {"p": 0.5}  # there is no picture of 0.4
    page.locator("#member").select_option(label="test-0: 0.75")
    before = request_of(page)["camera"]["position"]
    drag(page, "#stage canvas >> nth=0", 150, 0)
    assert_shown(page, surrogate)
    assert np.linalg.norm(np.subtract(request_of(page)["camera"]["position"], before)) > 0.5  # another stored view
    drag(page, "#stage canvas >> nth=0", 6, 0)
    assert_shown(page, surrogate)
    assert page.locator(".is-missing").count() == 0
    said = page.locator("#compared").inner_text()
    stands = page.locator("#stage figcaption").nth(1).inner_text()
    assert "member test-0 (test: not trained on), view " in stands
    view = int(stands.split("view ")[1].split(" ")[0])
    stored = Catalog.open(run_folder / "catalog.cdb").image("test-0", "dvr", view, dtype="float32")
    background = np.array([0x10, 0x12, 0x16]) / 255
    truth = stored[..., :3] + (1 - stored[..., 3:]) * background
    assert np.abs(shown(page, 1) - truth).max() <= 1 / 255
    psnr = float(said.removeprefix("PSNR ").split(" ")[0])
    assert psnr == pytest.approx(min(60, -10 * np.log10(np.mean((drawn(page, surrogate) - truth) ** 2))), abs=0.5)
    assert psnr > 45  # the surrogate drew these pictures itself


NONSENSE = [
    "mode=<script>&a.p.p=1e999&camera=1,2,3&background=red&full=9999999&against=x",
    "a.p.p=NaN&a.show=__proto__&camera=" + ",".join(["NaN"] * 11),
    "camera=0,0,0,0,0,0,0,0,0,0,0&a.show=transfer_function&a.c1_value=1e9&a.colors=../x",
    "mode=sweep&sweep.name=constructor&sweep.count=1e9&sweep.second=p",
    "%E0%A4%A&&&===;mode",
]


def test_an_address_of_nonsense_shows_a_picture(page: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(page, explorer, NONSENSE[0], full=0)
    for address in NONSENSE:
        go(page, f"full=256&{address}")
        assert_shown(page, surrogate)
        assert page.locator("#note li").count() >= 1
        page.locator("#note").get_by_role("button", name="Close").click()
        assert page.locator("#note").is_hidden()


def test_tabs_do_not_disturb_each_other(page: Page, new_page: NewPage, explorer: str, surrogate: Surrogate) -> None:
    other = new_page()
    open_explorer(page, explorer)
    open_explorer(other, explorer)
    still = assert_shown(other, surrogate)
    for _ in range(3):
        changed(page, surrogate, lambda: drag(page, "#stage", 40, 10))
        changed(page, surrogate, lambda: page.locator("#parameter-0").press("PageUp"))
    np.testing.assert_array_equal(assert_shown(other, surrogate), still)
    assert request_of(other)["settings"][0]["parameters"] == {"p": 0.5}


def test_frames_are_small_while_something_moves_and_whole_at_rest(
    page: Page, explorer: str, surrogate: Surrogate
) -> None:
    open_explorer(page, explorer, full=0)
    page.mouse.move(400, 400)
    page.mouse.down()
    whole = shown(page).shape
    for step in range(1000):  # until one has come
        page.mouse.move(400 + step % 2, 400)
        if page.evaluate("document.querySelector('#stage canvas').width") < whole[1] / 1.5:
            break
    else:
        pytest.fail("no small frame came")
    page.mouse.up()
    assert assert_shown(page, surrogate).shape == whole
    assert whole[0] * whole[1] == pytest.approx(512**2, rel=0.02)


def test_what_to_expect_is_said(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    page.wait_for_function("() => document.getElementById('expected').textContent.includes('dB')")
    assert "ms" in page.locator("#status").inner_text()


def test_nothing_stands_in_the_way_of_assistive_technology(page: Page, explorer: str) -> None:
    open_explorer(page, explorer)
    for state in ("a.show=transfer_function", "a.show=isovalue", "mode=compare", "mode=sweep", ""):
        go(page, f"full=256&{state}")
        settled(page)
        assert serious_findings(page) == [], state


def test_everything_can_be_reached_by_keys(page: Page, explorer: str) -> None:
    open_explorer(page, explorer, "a.show=transfer_function")
    reached = set()
    for _ in range(80):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate("(e => e.id || e.getAttribute('aria-label') || e.textContent)(document.activeElement)")
        )
    wanted = {
        "mode-view",
        "stage",
        "parameter-0",
        "member",
        "kind-transfer_function",
        "Control point c1",
        "Control point c2",
        "point-value",
        "point-opacity",
        "point-color",
    }
    wanted |= {
        "viridis",
        "Reset to base",
        "Look from plus x",
        "reset-view",
        "background",
        "full",
        "export",
        "copy-link",
    }
    assert wanted <= reached
    page.locator("#mode-view").press("ArrowRight")
    assert page.locator("#mode-compare").get_attribute("aria-selected") == "true"


def test_a_phone_shows_the_picture_and_the_controls(phone: Page, explorer: str, surrogate: Surrogate) -> None:
    open_explorer(phone, explorer)
    assert_shown(phone, surrogate)
    assert phone.evaluate("document.documentElement.scrollWidth <= innerWidth")
    phone.locator("#parameter-0").scroll_into_view_if_needed()
    changed(phone, surrogate, lambda: phone.locator("#parameter-0").press("ArrowRight"))
    assert serious_findings(phone) == []


def test_the_page_asks_nobody_else(page: Page, explorer: str) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    open_explorer(page, explorer)
    assert all(url.startswith((explorer, "blob:", "data:")) for url in asked)


def test_what_is_seen_can_be_saved(page: Page, explorer: str, surrogate: Surrogate, tmp_path: Path) -> None:
    open_explorer(page, explorer, "a.p.p=0.3&hide=title,legend,box,axes")
    drag(page, "#stage", 50, 20)
    seen = assert_shown(page, surrogate)
    picture = np.asarray(Image.open(saved(page, "png", tmp_path)).convert("RGB")) / 255
    assert np.abs(picture - seen).max() <= 1e-6
    (path,) = tmp_path.glob("blobs-p-0.3-*.png")
    assert record_of(path)["parameters"] == {"p": 0.3}
    assert saved(page, "ply", tmp_path).read_bytes().startswith(b"ply")
    assert "Surrogate.load" in saved(page, "python", tmp_path).read_text()
    assert saved(page, "exr", tmp_path).stat().st_size > 1000
    assert saved(page, "html", tmp_path).read_bytes().startswith(b"<!doctype html>")
    assert page.locator("#export-kind option").count() == 7
    page.locator("#mode-sweep").click()
    settled(page)
    assert page.locator("#export-kind").input_value() == "sheet"  # what is seen comes first
    assert page.locator("#export-scale option").all_inner_texts() == ["264×264", "528×528"]  # of pictures of 24²
    film = Image.open(saved(page, "gif", tmp_path))
    assert film.width == 264
    assert film.height > 264  # with its caption
    assert saved(page, "sheet", tmp_path).name.startswith("blobs-p-0-to-1-")


def test_a_comparison_is_saved_as_it_is_seen(page: Page, explorer: str, tmp_path: Path) -> None:
    open_explorer(page, explorer, "mode=compare&a.p.p=0.3&b.p.p=0.8&b.show=isovalue")
    captions = page.locator("#stage figcaption")
    page.wait_for_function("() => document.querySelector('.expected').textContent")
    assert captions.nth(0).inner_text().startswith("A p = 0.3\nbetween runs: PSNR")
    assert captions.nth(1).inner_text().startswith("B p = 0.8, isovalue = 0.45\n")
    path = saved(page, "comparison", tmp_path)
    assert path.name.startswith("blobs-compared-p-0.3-")
    record = record_of(path)
    assert (record["parameters"], record["other"]["visualization"]) == ({"p": 0.3}, {"isovalue": 0.45})
    page.locator("#edit-B").click()
    page.locator("#against").select_option("truth")
    page.locator("#nearest-picture").click()
    settled(page)
    assert page.locator("#export-scale option").all_inner_texts() == ["24×24"]
    assert Image.open(saved(page, "comparison", tmp_path)).width > 3 * 24


def test_links_and_cameras_go_to_the_clipboard(new_page: NewPage, explorer: str, surrogate: Surrogate) -> None:
    page = new_page(permissions=["clipboard-read", "clipboard-write"])
    open_explorer(page, explorer, "a.p.p=0.3")
    drag(page, "#stage", 50, 20)
    assert_shown(page, surrogate)
    page.locator("#copy-link").click()
    page.locator("#alert").filter(has_text="The link is on the clipboard.").wait_for()
    link = page.evaluate("navigator.clipboard.readText()")
    assert link.startswith(explorer)
    assert "a.p.p=0.3" in link
    page.get_by_role("button", name="Copy camera").click()
    page.locator("#alert").filter(has_text="The camera is on the clipboard.").wait_for()
    camera = json.loads(page.evaluate("navigator.clipboard.readText()"))
    assert camera == request_of(page)["camera"]


def test_what_cannot_be_saved_is_said(page: Page, explorer: str, complaints: list[str]) -> None:
    open_explorer(page, explorer)
    page.evaluate("document.querySelector('#export-kind option').value = 'nonsense'")
    page.locator("#export").click()
    page.wait_for_function("() => document.getElementById('alert').textContent.includes('kind must be one of')")
    page.wait_for_function("() => !document.getElementById('export').disabled")
    page.close()  # it complains no more
    assert all("400" in complaint for complaint in complaints)
    complaints.clear()
