"""Cards for notebooks: escaped, bounded, readable on any background."""

from __future__ import annotations

import re

import numpy as np

from catalogs.files.images import read_image
from catalogs.store.notebook.cards import LONGEST, CardImage, card, never_failing, on_background
from tests.support.cards import HOSTILE, Tags, images


def noise(side: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (side, side, 3)).astype(np.uint8)


def test_whatever_is_said_is_escaped_and_can_be_sent() -> None:
    picture = CardImage(noise(8), HOSTILE, HOSTILE)
    html = card(HOSTILE, [(HOSTILE, HOSTILE)], [picture], [HOSTILE])
    html.encode()  # as the kernel's messages are
    tags = Tags(html)
    assert {tag for tag, _ in tags.seen} == {"div", "table", "tr", "th", "td", "figure", "img", "figcaption"}
    assert all(set(attributes) <= {"style", "src", "alt", "title"} for _, attributes in tags.seen)
    assert tags.text.count("<script>alert(1)</script>") == 5


def test_colours_are_the_themes_own() -> None:
    html = card("a", [("b", "c")], [CardImage(noise(4), "d")], ["e"])
    assert not re.search(r"(?<!-)color:(?!inherit)", html)
    assert set(re.findall(r"background:(\w+)", html)) == {"transparent"}


def test_long_facts_are_cut() -> None:
    text = Tags(card("name", [("what", "x" * 10_000)])).text
    assert len(text) == len("name") + len("what") + LONGEST
    assert text.endswith("x…")


def test_pictures_are_kept_or_averaged(tmp_path) -> None:  # type: ignore[no-untyped-def]
    rgb = np.repeat(
        np.repeat(np.arange(24, dtype=np.uint8).reshape(2, 4, 3) * 10, 30, axis=0), 30, axis=1
    )  # [60, 120, 3]
    for width, expected in ((120, rgb), (4, rgb[::30, ::30])):
        (tmp_path / "a.png").write_bytes(images(card("a", [], [CardImage(rgb)], width=width))[0])
        np.testing.assert_array_equal(read_image(tmp_path / "a.png")[..., :3], expected)


def test_transparent_pixels_show_the_background() -> None:
    rgba = np.array([[[0, 0, 0, 0], [100, 0, 0, 100], [10, 20, 30, 255]]], np.uint8)
    assert on_background(rgba).tolist() == [[[255, 255, 255], [255, 155, 155], [10, 20, 30]]]
    assert on_background(rgba, (0.0, 1.0, 0.0)).tolist() == [[[0, 255, 0], [100, 155, 0], [10, 20, 30]]]


def test_a_failure_is_said_in_words() -> None:
    def fail() -> str:
        raise KeyError("<gone>")

    assert "KeyError: '<gone>'" in Tags(never_failing("Catalog", fail)).text
