"""One picture at a time: what a browser shows, and how it answers to the hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from catalogs.browse import CatalogServer, write_page
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.catalogs.browse.conftest import SIZE, grid_plan, picture
from tests.support.browsed import composited, drag, image_of, option_texts, shown, slider_box, turned, visit
from tests.support.browsers import pixels

if TYPE_CHECKING:
    from playwright.sync_api import Page


@pytest.mark.parametrize(
    ("name", "color"), [("black", (0, 0, 0)), ("white", (255, 255, 255)), ("dark", (0x10, 0x12, 0x16))]
)
def test_a_browser_shows_the_pixels_of_the_catalog(
    grid: Catalog, server: CatalogServer, page: Page, name: str, color: tuple[int, int, int]
) -> None:
    for of in (("m4", "second", 11), ("m0", "first", 30)):
        member, appearance, view = of
        fields = f"member={member}&appearance={appearance}&view={view}&background={name}&size=actual"
        visit(page, f"{server.address}#{fields}")
        assert shown(page) == of
        screen = pixels(image_of(page))
        assert screen.shape == (SIZE, SIZE, 3)
        assert np.abs(screen - composited(grid, color, of)).max() <= 1.0


def test_the_page_works_from_the_file_system(grid: Catalog, page: Page) -> None:
    written = write_page(grid.path)
    try:
        visit(page, f"file://{written}#member=m3&view=5&background=white&size=actual")
        assert shown(page) == ("m3", "first", 5)
        expected = composited(grid, (255, 255, 255), ("m3", "first", 5))
        assert np.abs(pixels(image_of(page)) - expected).max() <= 1.0
    finally:
        written.unlink()


def test_sliders_move_to_members(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=3")
    assert shown(page) == ("m0", "first", 3)
    left, length, y = slider_box(page, 0)
    page.mouse.move(left, y)
    page.mouse.down()
    page.mouse.move(left + 0.47 * length, y)
    assert shown(page)[0] == "m2"
    page.mouse.move(left + 0.95 * length, y)
    assert shown(page) == ("m4", "first", 3), "the other parameter and the view stay"
    page.mouse.up()
    assert page.locator("#parameter-0").input_value() == "2", "the thumb falls on the member"
    left, length, y = slider_box(page, 1)
    page.mouse.click(left + 0.9 * length, y)
    assert shown(page)[0] == "m5"
    caption = page.locator(".caption").first.inner_text().replace("\n", " ")
    assert "x 2" in caption
    assert "y<b> 5 m/s" in caption
    assert "test member" in caption
    page.locator("#parameter-0").focus()
    for key, expected in (("ArrowLeft", "m3"), ("PageDown", "m1"), ("ArrowLeft", "m1"), ("ArrowUp", "m3")):
        page.keyboard.press(key)
        assert shown(page)[0] == expected


def test_menus_and_steps_choose_member_and_appearance(server: CatalogServer, page: Page) -> None:
    visit(page, server.address)
    page.get_by_label("Member", exact=True).select_option("m4: 2, -5")
    assert shown(page)[:2] == ("m4", "first")
    assert page.locator("#parameter-0").input_value() == "2"
    page.get_by_label("Appearance", exact=True).select_option("second")
    assert shown(page)[:2] == ("m4", "second")
    page.get_by_label("Next member").click()
    assert shown(page)[:2] == ("m5", "second")
    assert page.get_by_label("Next member").is_disabled()
    page.get_by_label("Previous member").click()
    assert shown(page)[:2] == ("m4", "second")


def test_the_menu_offers_what_a_member_shows(varied: Catalog, page: Page) -> None:
    visit(page, f"file://{write_page(varied.path)}#member=all&appearance=dvr-train-65&view=3")
    assert shown(page) == ("all", "dvr-train-65", 3)
    titles = option_texts(page, "appearance")
    assert len(titles) == 82
    assert titles[65] == "dvr-train-65 (c1_value 0.2)"
    assert page.locator("#appearance").get_attribute("title") == titles[65]
    assert page.locator("#appearance optgroup").evaluate_all("groups => groups.map(group => group.label)") == [
        *(f"transfer functions, {split}" for split in ("train", "validation", "test")),
        *(f"isovalues, {split}" for split in ("train", "test")),
    ]
    page.locator("#member").select_option(label="isosurfaces: 2, 0")
    assert shown(page) == ("isosurfaces", "iso=0.2", 3), "the first that it shows"
    assert option_texts(page, "appearance") == ["iso=0.2 (isovalue 0.2)", "iso=0.5 (isovalue 0.5)"]
    page.locator("#appearance").select_option("iso=0.5 (isovalue 0.5)")
    assert shown(page) == ("isosurfaces", "iso=0.5", 3)
    left, length, y = slider_box(page, 0)
    page.mouse.click(left + 0.5 * length, y)
    assert shown(page) == ("some", "iso=0.5", 3), "it shows that too"
    assert len(option_texts(page, "appearance")) == 3


def test_a_slider_moves_to_isovalues_and_transfer_functions(varied: Catalog, page: Page) -> None:
    visit(page, f"file://{write_page(varied.path)}#member=all&appearance=dvr&view=3")
    labels = page.locator(".parameter .line > span").all_text_contents()
    assert labels[2] == "isovalue"
    assert labels[3].startswith("c1_value")
    left, length, y = slider_box(page, 2)
    page.mouse.click(left + 0.45 * length, y)
    assert shown(page) == ("all", "iso=0.5", 3)
    page.locator("#parameter-2").press("ArrowRight")
    assert shown(page) == ("all", "iso=0.8", 3)
    page.locator("#parameter-3").press("ArrowLeft")
    name = shown(page)[1]
    assert varied.plan.varied(name)["c1_value"] < 0
    page.locator("#member").select_option(label="isosurfaces: 2, 0")
    assert page.locator("#parameter-3").is_disabled(), "it shows isosurfaces only"


def test_an_address_asks_only_for_what_a_member_shows(varied: Catalog, page: Page) -> None:
    written = write_page(varied.path)
    for fields, expected in {
        "member=isosurfaces&appearance=dvr&view=2": ("isosurfaces", "iso=0.2", 2),
        "member=isosurfaces&view=2": ("isosurfaces", "iso=0.2", 2),
        "member=some&appearance=dvr-train-07&view=2": ("some", "dvr-train-07", 2),
    }.items():
        visit(page, f"file://{written}#{fields}")
        assert shown(page) == expected
        page.locator(".stage").first.press("ArrowRight")
        assert turned(page, expected)[:2] == expected[:2]
    before = shown(page)
    page.evaluate("location.hash = 'member=isosurfaces&appearance=dvr-train-07&view=2'")
    turned(page, before)
    assert shown(page) == ("isosurfaces", "iso=0.2", 2)


@pytest.mark.slow
def test_dragging_turns_the_thing_with_the_pointer(grid: Catalog, server: CatalogServer, page: Page) -> None:
    """A point on the near side, followed from picture to picture by its cameras, goes where the pointer goes.

    Only roughly: 42 viewpoints lie 36 degrees apart.
    """
    middle = np.mean(grid.plan.bounds, axis=0)
    poles = {view for view, camera in enumerate(grid.plan.cameras) if abs(camera.forward[2]) > 0.99}
    agreements = []
    for start in (0, 12, 33):
        for by in ((110, 0), (-110, 0), (0, 110), (0, -110)):
            visit(page, f"{server.address}#member=m0&view={start}&lines=off")
            assert shown(page)[2] == start
            drag(page, (470, 350), by)
            view = turned(page, ("m0", "first", start))[2]
            if {start, view} & poles:
                continue  # where "up" is another, pictures roll as they turn
            before, after = grid.plan.cameras[start], grid.plan.cameras[view]
            near = middle - 0.5 * before.forward
            moved = (after.project(near[None])[0] - before.project(near[None])[0])[0]
            agreements.append(float(np.dot(moved, by) / np.linalg.norm(moved) / np.linalg.norm(by)))
    assert len(agreements) >= 6
    assert min(agreements) > 0.4
    assert np.mean(agreements) > 0.8


def test_arrow_keys_the_globe_and_the_number_turn_too(server: CatalogServer, page: Page) -> None:
    visit(page, f"{server.address}#member=m0&view=20")
    seen = [shown(page)]
    assert seen[0][2] == 20
    for key in ("ArrowRight", "ArrowUp", "ArrowLeft", "ArrowDown"):
        page.locator(".stage").first.press(key)
        seen.append(turned(page, seen[-1]))
    assert len(set(seen)) >= 3
    page.locator("#globe").click(position={"x": 85, "y": 45})
    assert turned(page, seen[-1])[2] != seen[-1][2]
    page.get_by_label("View", exact=True).fill("7")
    page.keyboard.press("Enter")
    assert shown(page)[2] == 7
    page.get_by_label("View", exact=True).fill("999")
    page.keyboard.press("Enter")
    assert shown(page)[2] == 41
    assert page.locator("#view-number").input_value() == "41"


def test_a_missing_picture_is_said_and_the_next_one_shown(catalog: Catalog, page: Page, complaints: list[str]) -> None:
    catalog.image_path("first", "dvr", 4).unlink()
    visit(page, f"file://{write_page(catalog.path)}#member=first&view=4")
    message = page.locator(".message").first
    message.wait_for()
    assert "members/first/dvr/004.png can't be shown" in message.inner_text()
    page.locator(".stage").first.press("ArrowRight")
    message.wait_for(state="hidden")
    assert shown(page)[2] != 4
    page.close()  # it complains no more
    assert all("ERR_FILE_NOT_FOUND" in complaint for complaint in complaints)
    complaints.clear()


def test_an_empty_catalog_says_so(tmp_path: Path, page: Page) -> None:
    visit(page, f"file://{write_page(Catalog.create(tmp_path / 'x.cdb', grid_plan()).path)}")
    assert page.locator(".message").first.inner_text() == "The catalog has no members yet."
    assert page.get_by_role("tab").count() == 0
    assert page.get_by_role("slider").count() == 0


def test_a_single_member_has_no_lines_and_everything_else(tmp_path: Path, page: Page) -> None:
    space = ParameterSpace(
        (Parameter("<img src=x onerror=alert(1)>", 0.0, 2.0), Parameter("'\"&amp;", 0.0, 1.0, "</b>"))
    )
    catalog = Catalog.create(tmp_path / "one.cdb", grid_plan(appearances=(ImportedImages("x"),), space=space))
    with catalog.begin_member("only", dict.fromkeys(space.names, 1.0)) as writer:
        for view in range(42):
            writer.write_image("x", view, picture(view))
    visit(page, f"file://{write_page(catalog.path)}#view=8")
    assert shown(page) == ("only", "x", 8)
    names = page.locator(".parameter .line > span").all_text_contents()
    assert names == ["<img src=x onerror=alert(1)>", "'\"&amp; (</b>)"], "hostile names stay text"
    assert page.locator("#lines").is_hidden()
    page.locator("#parameter-0").press("ArrowRight")
    assert shown(page) == ("only", "x", 8)
    page.get_by_role("tab", name="Compare").click()
    assert shown(page, 1) == ("only", "x", 8)
    page.get_by_role("tab", name="Grid").click()
    assert page.locator(".cell .name").all_text_contents() == ["only"]


def own_cameras(folder: Path) -> Catalog:
    """Two members of opaque pictures on a background; the second one lacks some of the first one's directions."""
    plan = grid_plan(cameras=(), view_splits=(), appearances=(ImportedImages("x"),), background=(1.0, 0.5, 0.0))
    catalog = Catalog.create(folder / "own.cdb", plan)
    cameras = [
        Camera.look_at(
            (1 + 4 * np.cos(a), 4 * np.sin(a), 0.5), (1, 0, 0), vertical_fov_degrees=30, width=SIZE, height=SIZE
        )
        for a in np.arange(8) * np.pi / 4
    ]
    for number, order in enumerate(([0, 1, 2, 3, 4], [6, 5, 4, 2])):
        own = [cameras[i] for i in order]
        with catalog.begin_member(
            f"m{number}", {"x": number, "y<b>": 0.0}, cameras=own, view_splits=["train"] * len(own)
        ) as writer:
            for view in range(len(own)):
                writer.write_image("x", view, picture(100 * number + view, opaque=True))
    return catalog


def test_members_with_cameras_of_their_own(tmp_path: Path, page: Page) -> None:
    """A change of member goes to its nearest view, and so do the other side and the grid."""
    catalog = own_cameras(tmp_path)
    visit(page, f"file://{write_page(catalog.path)}#member=m0&view=2&size=actual")
    assert shown(page) == ("m0", "x", 2)
    assert np.abs(pixels(image_of(page)) - composited(catalog, (0, 0, 0), ("m0", "x", 2))).max() <= 1.0
    assert page.locator(".stage").first.evaluate("e => getComputedStyle(e).backgroundColor") == "rgb(255, 128, 0)"
    page.get_by_label("Next member").click()
    assert shown(page) == ("m1", "x", 3), "the same direction as before"
    page.get_by_role("tab", name="Compare").click()
    assert (shown(page), shown(page, 1)) == (("m1", "x", 3), ("m0", "x", 2))
    page.get_by_role("button", name="Right", exact=True).click()
    assert (shown(page), shown(page, 1)) == (("m1", "x", 3), ("m0", "x", 2))
    page.get_by_role("tab", name="Grid").click()
    page.wait_for_selector(".cell img")
    assert [
        image.split("/")[-3:] for image in page.locator(".cell img").evaluate_all("all => all.map(i => i.src)")
    ] == [
        ["m0", "x", "002.png"],
        ["m1", "x", "003.png"],
    ]
