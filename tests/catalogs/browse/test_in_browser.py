"""What a real browser shows, and how it answers to the hand."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

from catalogs.appearance import ImportedImages
from catalogs.browse import CatalogServer, write_page
from catalogs.cameras import Camera
from catalogs.catalog import Catalog
from tests.catalogs.browse.conftest import SIZE, grid_plan, picture
from tests.catalogs.chromium import Browser

SHOWN = "document.documentElement?.dataset.shown"


def shown(browser: Browser) -> tuple[str, str, int]:
    """Member, appearance and view of the picture on the screen, once it is the one that the page wants."""
    browser.wait_for(
        f"{SHOWN} && {SHOWN} === addressOf(member(), shown.appearance, shown.view) "
        "&& document.getElementById('picture').complete"
    )
    _, member, appearance, file = unquote(browser.evaluate(SHOWN)).split("/")
    return member, appearance, int(file.removesuffix(".png"))


def composited(catalog: Catalog, background: tuple[int, int, int], of: tuple[str, str, int]) -> np.ndarray:
    image = catalog.image(*of, dtype="float32") * 255.0
    return image[..., :3] + (1.0 - image[..., 3:] / 255.0) * np.array(background)


@pytest.mark.parametrize(
    ("name", "color"), [("black", (0, 0, 0)), ("white", (255, 255, 255)), ("dark", (0x10, 0x12, 0x16))]
)
def test_a_browser_shows_the_pixels_of_the_catalog(
    grid: Catalog, server: CatalogServer, browser: Browser, name: str, color: tuple[int, int, int]
) -> None:
    for of in (("m4", "second", 11), ("m0", "first", 30)):
        member, appearance, view = of
        fields = f"member={member}&appearance={appearance}&view={view}&background={name}&size=actual"
        browser.open(f"{server.address}#{fields}")
        assert shown(browser) == of
        screen = browser.pixels("#picture")
        assert screen.shape == (SIZE, SIZE, 3)
        assert np.abs(screen - composited(grid, color, of)).max() <= 1.0
    assert browser.complaints() == []


def test_the_page_works_from_the_file_system(grid: Catalog, browser: Browser) -> None:
    page = write_page(grid.path)
    try:
        browser.open(f"file://{page}#member=m3&view=5&background=white&size=actual")
        assert shown(browser) == ("m3", "first", 5)
        expected = composited(grid, (255, 255, 255), ("m3", "first", 5))
        assert np.abs(browser.pixels("#picture") - expected).max() <= 1.0
        assert browser.complaints() == []
    finally:
        page.unlink()


def slider(browser: Browser, number: int) -> tuple[float, float, float]:
    """Left end, length of travel and height in the window of a slider's thumb."""
    box = browser.evaluate(
        f"(({{x, y, width, height}}) => [x, y, width, height])"
        f"(document.getElementById('parameter-{number}').getBoundingClientRect())"
    )
    return box[0] + 8, box[2] - 16, box[1] + box[3] / 2


def test_sliders_move_to_members(server: CatalogServer, browser: Browser) -> None:
    browser.open(f"{server.address}#member=m0&view=3")
    assert shown(browser) == ("m0", "first", 3)
    left, length, y = slider(browser, 0)
    browser.mouse("mousePressed", left, y)
    browser.mouse("mouseMoved", left + 0.47 * length, y)
    assert shown(browser)[0] == "m2"
    browser.mouse("mouseMoved", left + 0.95 * length, y)
    assert shown(browser) == ("m4", "first", 3), "the other parameter and the view stay"
    browser.mouse("mouseReleased", left + 0.95 * length, y)
    assert browser.evaluate("+document.getElementById('parameter-0').value") == 2.0, "the thumb falls on the member"
    left, length, y = slider(browser, 1)
    browser.mouse("mousePressed", left + 0.9 * length, y)
    browser.mouse("mouseReleased", left + 0.9 * length, y)
    assert shown(browser)[0] == "m5"
    caption = browser.evaluate("document.getElementById('caption').textContent")
    assert "x 2" in caption
    assert "y<b> 5 m/s" in caption
    assert "test member" in caption
    browser.evaluate("document.getElementById('parameter-0').focus()")
    for key, expected in (("ArrowLeft", "m3"), ("ArrowLeft", "m1"), ("ArrowLeft", "m1"), ("ArrowRight", "m3")):
        browser.press(key)
        assert shown(browser)[0] == expected
    assert browser.complaints() == []


def test_menus_choose_member_and_appearance(server: CatalogServer, browser: Browser) -> None:
    browser.open(server.address)
    choose = "(id, value) => {{ const s = document.getElementById(id); s.value = value; s.onchange({{target: s}}); }}"
    browser.evaluate(f"({choose.format()})('member', '4')")
    assert shown(browser)[:2] == ("m4", "first")
    assert browser.evaluate("+document.getElementById('parameter-0').value") == 2.0
    browser.evaluate(f"({choose.format()})('appearance', '1')")
    assert shown(browser)[:2] == ("m4", "second")


OFFERED = "[...document.getElementById('appearance').options].map(option => option.text)"


def test_the_menu_offers_what_a_member_shows(varied: Catalog, browser: Browser) -> None:
    browser.open(f"file://{write_page(varied.path)}#member=all&appearance=dvr-train-65&view=3")
    assert shown(browser) == ("all", "dvr-train-65", 3)
    titles = browser.evaluate(OFFERED)
    assert len(titles) == 82
    assert titles[65] == "dvr-train-65 (c1_value -0.1)"
    assert browser.evaluate("document.getElementById('appearance').title") == titles[65]
    groups = browser.evaluate("[...document.querySelectorAll('#appearance optgroup')].map(group => group.label)")
    assert groups == [
        *(f"transfer functions, {split}" for split in ("train", "validation", "test")),
        *(f"isovalues, {split}" for split in ("train", "test")),
    ]
    assert browser.evaluate("document.getElementById('appearance').offsetWidth") < 250
    choose = "(id, value) => { const s = document.getElementById(id); s.value = value; s.onchange({target: s}); }"
    browser.evaluate(f"({choose})('member', '1')")
    assert browser.evaluate("catalog.members[1].name") == "isosurfaces"
    assert shown(browser) == ("isosurfaces", "iso=0.2", 3), "the first that it shows"
    assert browser.evaluate(OFFERED) == ["iso=0.2 (isovalue 0.2)", "iso=0.5 (isovalue 0.5)"]
    browser.evaluate(f"({choose})('appearance', document.getElementById('appearance').options[1].value)")
    assert shown(browser) == ("isosurfaces", "iso=0.5", 3)
    left, length, y = slider(browser, 0)
    browser.mouse("mousePressed", left + 0.5 * length, y)
    browser.mouse("mouseReleased", left + 0.5 * length, y)
    assert shown(browser) == ("some", "iso=0.5", 3), "it shows that too"
    assert len(browser.evaluate(OFFERED)) == 3
    assert browser.evaluate("document.getElementById('appearance').selectedOptions[0].text") == "iso=0.5 (isovalue 0.5)"
    assert browser.complaints() == []


def test_an_address_asks_only_for_what_a_member_shows(varied: Catalog, browser: Browser) -> None:
    page = write_page(varied.path)
    for fields, expected in {
        "member=isosurfaces&appearance=dvr&view=2": ("isosurfaces", "iso=0.2", 2),
        "member=isosurfaces&view=2": ("isosurfaces", "iso=0.2", 2),
        "member=some&appearance=dvr-train-07&view=2": ("some", "dvr-train-07", 2),
    }.items():
        browser.open(f"file://{page}#{fields}")
        assert shown(browser) == expected
        browser.evaluate("document.getElementById('stage').focus()")
        browser.press("ArrowRight")
        assert shown(browser)[:2] == expected[:2]
        assert browser.complaints() == []
    browser.evaluate("location.hash = 'member=isosurfaces&appearance=dvr-train-07&view=2'")
    browser.wait_for("member().name === 'isosurfaces'")
    assert shown(browser) == ("isosurfaces", "iso=0.2", 2)


def test_dragging_turns_the_thing_with_the_pointer(grid: Catalog, server: CatalogServer, browser: Browser) -> None:
    """A point on the near side, followed from picture to picture by its cameras, goes where the pointer goes.

    Only roughly: 42 viewpoints lie 36 degrees apart.
    """
    middle = np.mean(grid.plan.bounds, axis=0)
    poles = {view for view, camera in enumerate(grid.plan.cameras) if abs(camera.forward[2]) > 0.99}
    agreements = []
    for start in (0, 5, 12, 20, 33, 41):
        for drag in ((150, 0), (-150, 0), (0, 150), (0, -150)):
            browser.open(f"{server.address}#member=m0&view={start}")
            assert shown(browser)[2] == start
            browser.mouse("mousePressed", 400, 350)
            for i in range(1, 11):
                browser.mouse("mouseMoved", 400 + drag[0] * i / 10, 350 + drag[1] * i / 10)
            browser.mouse("mouseReleased", 400 + drag[0], 350 + drag[1])
            view = shown(browser)[2]
            assert view != start
            if {start, view} & poles:
                continue  # where "up" is another, pictures roll as they turn
            before, after = grid.plan.cameras[start], grid.plan.cameras[view]
            near = middle - 0.5 * before.forward
            moved = (after.project(near[None])[0] - before.project(near[None])[0])[0]
            agreements.append(float(np.dot(moved, drag) / np.linalg.norm(moved) / np.linalg.norm(drag)))
    assert len(agreements) >= 10
    assert min(agreements) > 0.4
    assert np.mean(agreements) > 0.8


def test_arrow_keys_and_the_globe_turn_too(server: CatalogServer, browser: Browser) -> None:
    browser.open(f"{server.address}#member=m0&view=20")
    assert shown(browser)[2] == 20
    browser.evaluate("document.getElementById('stage').focus()")
    seen = {20}
    for key in ("ArrowRight", "ArrowUp", "ArrowLeft", "ArrowDown"):
        before = shown(browser)[2]
        browser.press(key)
        browser.wait_for(f"shown.view !== {before}")
        seen.add(shown(browser)[2])
    assert len(seen) >= 3
    box = browser.evaluate("(r => [r.x, r.y])(document.getElementById('globe').getBoundingClientRect())")
    before = shown(browser)[2]
    browser.mouse("mousePressed", box[0] + 85, box[1] + 45)
    browser.mouse("mouseReleased", box[0] + 85, box[1] + 45)
    assert shown(browser)[2] != before


def test_the_address_keeps_what_is_seen(server: CatalogServer, browser: Browser) -> None:
    browser.open(f"{server.address}#member=none&view=999&background=url(x)&size=huge&appearance=second")
    assert shown(browser)[:2] == ("m0", "second")
    browser.evaluate("document.querySelector('button[data-background=white]').click()")
    browser.evaluate("document.querySelector('button[data-size=actual]').click()")
    address, seen = browser.evaluate("location.href"), shown(browser)
    assert "background=white" in address
    browser.open(address)
    assert shown(browser) == seen
    assert browser.evaluate("document.getElementById('stage').dataset.size") == "actual"
    assert browser.complaints() == []


def test_a_missing_picture_is_said_and_the_next_one_shown(catalog: Catalog, browser: Browser) -> None:
    catalog.image_path("first", "dvr", 4).unlink()
    browser.open(f"file://{write_page(catalog.path)}#member=first&view=4")
    browser.wait_for(SHOWN)
    assert "members/first/dvr/004.png can't be shown" in browser.evaluate(
        "document.getElementById('message').innerText"
    )
    browser.evaluate("document.getElementById('stage').focus()")
    browser.press("ArrowRight")
    assert shown(browser)[2] != 4
    assert browser.evaluate("document.getElementById('message').hidden")


def test_an_empty_catalog_says_so(tmp_path: Path, browser: Browser) -> None:
    browser.open(f"file://{write_page(Catalog.create(tmp_path / 'x.cdb', grid_plan()).path)}")
    assert browser.evaluate("document.getElementById('message').innerText") == "The catalog has no members yet."
    assert browser.complaints() == []


def test_members_with_cameras_of_their_own(tmp_path: Path, browser: Browser) -> None:
    """Opaque pictures on a background; a change of member goes to its nearest view."""
    plan = grid_plan(cameras=(), view_splits=(), appearances=(ImportedImages("x"),), background=(1.0, 0.5, 0.0))
    catalog = Catalog.create(tmp_path / "own.cdb", plan)
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
    browser.open(f"file://{write_page(catalog.path)}#member=m0&view=2&size=actual")
    assert shown(browser) == ("m0", "x", 2)
    assert np.abs(browser.pixels("#picture") - composited(catalog, (0, 0, 0), ("m0", "x", 2))).max() <= 1.0
    assert browser.evaluate("getComputedStyle(document.getElementById('stage')).backgroundColor") == "rgb(255, 128, 0)"
    browser.evaluate("chooseMember(1)")
    assert shown(browser) == ("m1", "x", 3), "the same direction as before"
    assert browser.complaints() == []
