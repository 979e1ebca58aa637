"""Clip boxes and slices in pages: drawn as the engine draws them, and worked by keys and mouse."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.cuts import cut_of
from surrogate.explore.exporting.marks import annotations_of
from surrogate.explore.probing import seen_place
from surrogate.explore.request import frame_request, setting_of
from surrogate.explore.run import Run
from surrogate.explore.server.notebook import NotebookExplorer
from surrogate.explore.setting import Setting
from surrogate.storage.picture_records import record_of
from tests.support.browsers import serious_findings
from tests.support.drawn_models import carrying
from tests.support.drawn_pages import decibels, field_drawn, opened, places_of
from tests.support.emulated_models import BOX, MODELS, ORIGIN, SPACING, SPAN, both, cameras, surfaces
from tests.support.explored import assert_shown, go, open_explorer, saved, shown

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow


def clip(*shares: float) -> list[float]:
    return [*(BOX[0] + SPAN * shares[:3]), *(BOX[0] + SPAN * shares[3:])]


CUTS: dict[str, dict[str, Any]] = {
    "a part": {"clip": clip(0.12, 0.31, 0.0, 0.83, 1.0, 0.6)},  # no sample of a picture lies on an edge of a surface
    "wider than the field": {"clip": clip(-1.0, -9.0, -1.0, 2.0, 2.0, 99.0)},
    "thinner than a step": {"clip": clip(0.0, 0.0, 0.5, 1.0, 1.0, 0.502)},
    "flat": {"clip": clip(0.0, 0.3, 0.0, 1.0, 0.3, 1.0)},
    "outside": {"clip": clip(1.1, 0.0, 0.0, 1.2, 1.0, 1.0)},
    "a slice": {"slice": ["z", float(BOX[0][2] + 0.43 * SPAN[2])]},
    "a slice along samples": {"slice": ["x", ORIGIN[0] + 7 * SPACING[0]]},
    "a slice at the last face": {"slice": ["y", float(BOX[1][1])]},
    "a slice in a box": {"clip": clip(0.1, 0.2, 0.0, 0.9, 0.9, 1.0), "slice": ["y", float(BOX[0][1] + 0.5 * SPAN[1])]},
    "a slice outside": {"slice": ["z", float(BOX[1][2] + 0.1)]},
}


@pytest.mark.parametrize("name", ["volume", "shaded volume with holes", "volume on a scale, by the distance that fits"])
def test_the_page_cuts_volumes_as_the_engine_does(page: Page, tmp_path: Path, name: str) -> None:
    surrogate = MODELS[name][0]()
    opened(page, surrogate, tmp_path)
    parameters = next(iter(places_of(surrogate)))
    pairs = list(itertools.product(CUTS, (0, 2)))
    cases = [{"parameters": parameters, "camera": cameras()[k].to_json(), "cut": CUTS[cut]} for cut, k in pairs]
    expected = [
        Setting(parameters, cut=cut_of(CUTS[cut])).member(surrogate).render(cameras()[k], background=WHITE)
        for cut, k in pairs
    ]
    for engine in ("card", "scripts"):
        for pair, found, wanted in zip(pairs, field_drawn(page, cases, engine), expected, strict=True):
            assert decibels(found, wanted) >= 95.0, (engine, pair)


def test_the_page_cuts_surfaces_as_the_engine_does(page: Page, tmp_path: Path) -> None:
    surrogate, camera, surface = surfaces("still"), cameras()[0], {"isovalue": 0.1}
    opened(page, surrogate, tmp_path)
    cuts = [cut for name, cut in CUTS.items() if "slice" not in name]
    shared = {"parameters": surrogate.space.middle, "visualization": surface, "camera": camera.to_json()}
    cases = [{**shared, "cut": cut} for cut in cuts]
    whole = surrogate.using("field").at(surrogate.space.middle, **surface)
    for engine in ("card", "scripts"):
        for cut, found in zip(cuts, field_drawn(page, cases, engine), strict=True):
            box = cut_of(cut).box  # type: ignore[union-attr]
            assert decibels(found, whole.within(*box).render(camera, background=WHITE)) >= 95.0  # type: ignore[misc]


def rested(page: Page) -> np.ndarray:
    """The pixels of the picture in [0, 1], once it rests."""
    page.wait_for_function("() => window.explorer.resting")
    return shown(page)


def message(page: Page) -> dict[str, Any]:
    return page.evaluate("window.explorer.request(false).settings[0]")  # type: ignore[no-any-return]


def test_keys_and_mouse_cut_and_slice(page: Page, tmp_path: Path) -> None:
    opened(page, both(), tmp_path)
    whole, box = rested(page), np.ravel(page.evaluate("window.explorer.facts.box"))
    page.locator("#clip-x-from").focus()
    for _ in range(3):
        page.keyboard.press("PageUp")
    assert message(page)["clip"] == pytest.approx([box[0] + 0.3 * (box[3] - box[0]), *box[1:]], rel=1e-4)
    assert np.abs(rested(page) - whole).max() > 20 / 255
    assert "emulated field" in page.locator("#status").inner_text()
    page.keyboard.press("End")  # no farther than the other end
    assert message(page)["clip"][0] == box[3]
    page.keyboard.press("Home")
    assert "clip" not in message(page)
    track = page.locator("#clip-y-to").bounding_box()
    assert track is not None
    page.mouse.move(track["x"] + track["width"] - 8, track["y"] + track["height"] / 2)
    page.mouse.down()
    page.mouse.move(track["x"] + track["width"] / 2, track["y"] + track["height"] / 2, steps=3)
    page.mouse.up()
    assert message(page)["clip"][4] == pytest.approx((box[1] + box[4]) / 2, abs=0.02 * (box[4] - box[1]))
    page.get_by_label("Clip z to, exact value").fill(str(box[2] + 1.0))
    page.keyboard.press("Enter")
    assert message(page)["clip"][5] == pytest.approx(box[2] + 1.0)
    page.get_by_label("Clip z from, exact value").fill(str(box[5]))
    page.keyboard.press("Enter")
    assert "can't be drawn" in page.locator("section[aria-label='Clip and slice'] .refused:visible").inner_text()
    page.locator("#reset-clip").click()
    np.testing.assert_array_equal(rested(page), whole)
    page.locator("#slice-axis").select_option("z")
    assert message(page)["slice"] == ["z", pytest.approx((box[2] + box[5]) / 2, rel=1e-4)]
    sliced = rested(page)
    page.locator("#slice-z").focus()
    page.keyboard.press("PageUp")
    assert np.abs(rested(page) - sliced).max() > 5 / 255
    assert "slice at z" in (page.locator("#stage svg").first.text_content() or "")
    page.locator("#using").select_option("gaussians-scripts")  # waits until nothing is cut
    assert "using" not in message(page)
    assert serious_findings(page) == []
    page.locator("#slice-axis").select_option("")
    assert message(page)["using"] == "gaussians-scripts"


def test_orthographic_keeps_the_size_of_what_is_in_the_middle(page: Page, tmp_path: Path) -> None:
    opened(page, both(), tmp_path)
    orbit = "window.explorer.state.orbit"
    before = page.evaluate(orbit)
    page.locator("#orthographic").click()
    flat = page.evaluate(orbit)
    half = [np.tan(np.radians(one["field"]) / 2) * one["distance"] for one in (before, flat)]
    assert (flat["field"], half[1]) == (1.0, pytest.approx(half[0]))
    assert page.locator("#orthographic").get_attribute("aria-pressed") == "true"
    page.reload()
    page.wait_for_function("() => document.documentElement.dataset.shown")
    assert page.locator("#orthographic").get_attribute("aria-pressed") == "true"
    page.locator("#stage").focus()
    page.keyboard.press("o")
    after = page.evaluate(orbit)
    assert (after["field"], after["distance"]) == (before["field"], pytest.approx(before["distance"]))
    page.keyboard.press("o")
    page.evaluate("document.getElementById('orthographic').closest('details').open = true")
    assert serious_findings(page) == []


def test_links_hold_cuts_and_name_what_they_cannot(page: Page, tmp_path: Path) -> None:
    opened(page, both(), tmp_path)
    script = """async address => {
      const { addressOf, stateOf } = await import("explore/address.js"), { facts } = window.explorer;
      const { state, notes } = stateOf(address, facts);
      return [state.settings[0].clip, state.settings[0].slice, notes, addressOf(state, facts)];
    }"""
    found, plane, notes, address = page.evaluate(script, "#a.clip=-30,5,2,-28,6,4.5&a.slice=y,5.25")
    assert (found, plane, notes) == ([-30, 5, 2, -28, 6, 4.5], ["y", 5.25], [])
    assert "a.clip=-30%2C5%2C2%2C-28%2C6%2C4.5" in address
    assert "a.slice=y%2C5.25" in address
    for clip_, plane_ in (
        ("1,2", "w,1"),
        ("1,2,3,0,0,0", "xy,1"),
        ("1,,3,4,5,6", "x,"),
        ("a,2,3,4,5,6", "x,1,2"),
        ("1,2,3,4,5,1e999", "x,NaN"),
    ):
        found, plane, notes, _ = page.evaluate(script, f"#a.clip={clip_}&a.slice={plane_}")
        assert (found, plane, len(notes)) == (None, None, 2), (clip_, plane_)


def test_a_page_without_a_field_offers_no_cuts(page: Page, tmp_path: Path) -> None:
    opened(page, carrying(), tmp_path)
    assert page.locator("#slice-axis").count() == 0
    page.evaluate("location.hash = '#a.slice=z,0.5'")
    page.wait_for_function("() => document.querySelector('#note li')")
    assert "there is no emulated field here" in page.locator("#note li").inner_text()


def test_the_place_under_the_pointer_is_one_that_is_left(page: Page, tmp_path: Path) -> None:
    surrogate = both()
    opened(page, surrogate, tmp_path)
    place = (BOX[0] + SPAN * [1.4, -1.6, 2.1]).tolist()
    seen = {"position": place, "target": (BOX[0] + SPAN * 0.5).tolist(), "up": [0.0, 0.0, 1.0], "field": 40.0}
    camera = Camera.look_at(place, seen["target"], vertical_fov_degrees=40.0, width=64, height=48)
    script = "async ([request, pixel]) => (await (await import('draw/local.js')).probed(request, pixel, [])).seen"
    for name in ("a part", "a slice", "a slice outside"):
        setting = {"parameters": surrogate.space.middle, "visualization": {}, "color_map": "", **CUTS[name]}
        request = {"settings": [setting], "camera": seen, "size": [64, 48]}
        found = page.evaluate(script, [request, [30.0, 25.0]])
        expected = seen_place(setting_of(setting, surrogate).member(surrogate), camera, (30.0, 25.0))  # type: ignore[arg-type]
        assert (found is None) == (expected is None) == (name == "a slice outside"), name
        if found is not None:
            assert found["place"] == pytest.approx(expected, abs=1e-6), name
            assert found["value"] is not None, name


def test_films_go_from_box_to_box(page: Page, tmp_path: Path) -> None:
    opened(page, both(), tmp_path)
    script = """async addresses => {
      const { stateOf } = await import("explore/address.js"), { stateBetween } = await import("explore/journey.js");
      const { facts } = window.explorer, [first, last] = addresses.map(address => stateOf(address, facts).state);
      const { clip, slice } = stateBetween(first, last, 0.5, facts).settings[0];
      return [clip, slice, facts.box.flat()];
    }"""
    clip_, plane, box = page.evaluate(script, ["#a.slice=z,3", "#a.slice=z,4&a.clip=-29,6,3,-28,7,4"])
    assert clip_ == pytest.approx(np.mean([box, [-29, 6, 3, -28, 7, 4]], axis=0))
    assert plane == ["z", 3.5]
    assert page.evaluate(script, ["#a.slice=z,3", "#a.slice=x,-29"])[0] is None


CUT = "a.clip=-29.5,5.5,2.2,-26.5,8.5,5.5&a.slice=z,4"


@pytest.fixture
def own_explorer() -> Iterator[str]:
    """The address of an explorer of a surrogate with Gaussians and a field."""
    explored = NotebookExplorer(Run("a run", both()))
    yield explored.address
    explored.close()


def test_the_program_draws_and_saves_what_is_cut(
    page: Page, own_explorer: str, tmp_path: Path, complaints: list[str]
) -> None:
    open_explorer(page, own_explorer, f"full=256&drawn=program&{CUT}&over=Re")
    assert_shown(page, both())
    assert "maps are of whole pictures" in page.locator("section[aria-label=Ask]").inner_text()
    assert (
        record_of(saved(page, "png", tmp_path)).items()
        >= {"clip": [-29.5, 5.5, 2.2, -26.5, 8.5, 5.5], "slice": ["z", 4]}.items()
    )
    assert (
        b".within((-29.5, 5.5, 2.2), (-26.5, 8.5, 5.5)).slice('z', 4.0).render("
        in saved(page, "python", tmp_path).read_bytes()
    )
    page.locator("#export-kind").select_option("ply")
    page.locator("#export").click()
    page.wait_for_function("() => document.getElementById('alert').textContent.includes('whole Gaussians')")
    assert "400" in complaints.pop()


MARKS = """async size => {
  const [{ annotationsOf, scaleOf }, { saidOf }, { current }] =
    await Promise.all(["annotations", "overlay", "state"].map(name => import(`explore/${name}.js`)));
  const { state, facts } = window.explorer, { camera } = window.explorer.request(false);
  return annotationsOf({ ...saidOf(current(state), state, facts), shown: ["box", "legend"], camera, size, scale: scaleOf(size) });
}"""


MARKED = (
    CUT,
    "a.slice=x,-28",
    "a.clip=-99,-99,-99,99,99,4",
    "a.slice=z,1e300",
    "a.clip=-29.5,5.5,2.2,-26.5,8.5,3&a.slice=z,4",
)


def test_the_box_is_marked_alike_in_page_and_files(page: Page, tmp_path: Path) -> None:
    surrogate, size = both(), (700, 500)
    opened(page, surrogate, tmp_path)
    for cut in MARKED:
        go(page, f"#{cut}")
        request = frame_request({**page.evaluate("window.explorer.request(false)"), "size": size}, surrogate)
        expected = annotations_of(Run("a run", surrogate), request.settings[0], ("box", "legend")).marks(request.camera)
        found = page.evaluate(MARKS, size)
        assert [mark[0] for mark in found] == [mark[0] for mark in expected], cut
        for own, twin in zip(found, expected, strict=True):
            np.testing.assert_allclose(np.ravel(own[1]), np.ravel(twin[1]), atol=1e-6, err_msg=cut)
