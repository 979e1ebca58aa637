from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from surrogate.explore.exporting.sheets import captioned, strip
from surrogate.explore.exporting.sweep import Axis, Sweep
from surrogate.explore.setting import Setting
from surrogate.storage.picture_records import record_of

BASE = Setting({"p": 0.5})
DARK, BRIGHT = (0.0, 0.0, 0.25), (1.0, 1.0, 0.75)


def flat(count: int, size: tuple[int, int] = (40, 60)) -> list[NDArray[np.uint8]]:
    """Pictures of one colour each, all different: red counts them."""
    return [np.full((*size, 3), (10 + i, 200, 100), np.uint8) for i in range(count)]


def seen(content: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(content)))


def boxes(sheet: NDArray[np.uint8], count: int) -> list[tuple[int, int, int, int]]:
    """Top, left, height and width of every picture of `flat`, each of which must be whole."""
    found = []
    for i in range(count):
        rows, columns = np.nonzero((sheet == (10 + i, 200, 100)).all(axis=2))
        top, left, height, width = rows.min(), columns.min(), np.ptp(rows) + 1, np.ptp(columns) + 1
        assert len(rows) == height * width
        found.append((int(top), int(left), int(height), int(width)))
    return found


def ink(sheet: NDArray[np.uint8], background: Any, count: int) -> NDArray[np.bool_]:
    """Pixels of text: neither paper nor image."""
    paper = (sheet == np.round(np.array(background) * 255)).all(axis=2)
    return ~paper & ~((sheet[..., 1] == 200) & (sheet[..., 2] == 100))


@pytest.mark.parametrize("background", [DARK, BRIGHT])
def test_a_strip_shows_every_picture_under_its_label(background: Any) -> None:
    sheet = seen(strip(Sweep(BASE, Axis("p", 0.0, 1.0, 5)), flat(5), background=background))
    placed = boxes(sheet, 5)
    assert {box[0] for box in placed} == {placed[0][0]}
    assert {box[2:] for box in placed} == {(40, 60)}
    lefts = [left for _, left, _, _ in placed]
    assert lefts == sorted(lefts)
    text = ink(sheet, background, 5)
    for top, left, _, width in placed:
        assert text[:top, left : left + width].sum() > 20
    assert not text[placed[0][0] :].any()
    brightest = sheet[text].max(axis=0).tolist() if background == DARK else sheet[text].min(axis=0).tolist()
    assert brightest == ([255] * 3 if background == DARK else [0] * 3)


def test_long_strips_are_broken_into_rows_of_which_each_is_labelled() -> None:
    sheet = seen(strip(Sweep(BASE, Axis("p", 0.0, 1.0, 20)), flat(20), background=BRIGHT))
    placed = boxes(sheet, 20)
    tops = sorted({top for top, *_ in placed})
    assert 2 <= len(tops) <= 5
    assert placed == sorted(placed)
    text = ink(sheet, BRIGHT, 20)
    for top, left, _, width in placed:
        assert text[top - 20 : top, left : left + width].sum() > 20


def test_a_grid_is_labelled_above_and_on_the_left() -> None:
    sweep = Sweep(BASE, Axis("p", 0.0, 1.0, 3), Axis("isovalue", 0.1, 0.5, 2))
    sheet = seen(strip(sweep, flat(6), background=BRIGHT))
    placed = boxes(sheet, 6)
    assert len({top for top, *_ in placed}) == 2
    assert len({left for _, left, *_ in placed}) == 3
    assert placed == sorted(placed)
    text, left = ink(sheet, BRIGHT, 6), min(left for _, left, *_ in placed)
    for top in {top for top, *_ in placed}:
        assert text[top : top + 40, :left].sum() > 20
    for column in {left for _, left, *_ in placed}:
        assert text[: placed[0][0], column : column + 60].sum() > 20
    assert not text[placed[0][0] :, left:].any()


def test_labels_wider_than_a_picture_do_not_touch() -> None:
    sweep = Sweep(BASE, Axis("a_very_long_name", 0.0, 1.0, 3, "kg/m³"))
    sheet = seen(strip(sweep, flat(3, (16, 16)), background=BRIGHT))
    placed = boxes(sheet, 3)
    columns = ink(sheet, BRIGHT, 3).any(axis=0)
    gaps = [b - a for a, b in zip(*[np.nonzero(columns)[0][k:] for k in (0, 1)], strict=False)]
    assert sum(gap >= 8 for gap in gaps) >= 2
    assert sheet.shape[1] > placed[-1][1] + 16


def test_float_pictures_and_the_record_are_kept() -> None:
    drawn = [picture.astype(np.float32) / 255.0 for picture in flat(2)]
    content = strip(Sweep(BASE, Axis("p", 0.0, 1.0, 2)), drawn, background=DARK, record={"over": "p"})
    boxes(seen(content), 2)
    assert record_of(content) == {"over": "p"}


def test_sheets_that_nobody_could_open_are_refused_after_the_first_picture() -> None:
    def endless() -> Any:
        yield np.zeros((1000, 1000, 3), np.uint8)
        raise AssertionError("a second picture was drawn")

    with pytest.raises(
        ValueError, match=r"a sheet of 200 pictures of 1000x1000 would have \d+x\d+ pixels, more than 16384"
    ):
        strip(Sweep(BASE, Axis("p", 0.0, 1.0, 200)), endless(), background=DARK)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_more_or_fewer_pictures_than_the_sweep_has_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match=r"zip\(\) argument 2 is|needs as many, got none"):
        strip(Sweep(BASE, Axis("p", 0.0, 1.0, 3)), flat(count), background=DARK)


def test_captions_stand_below_unchanged_pictures() -> None:
    sweep = Sweep(BASE, Axis("p", 0.0, 1.0, 3, "m"))
    framed = list(captioned(flat(3), sweep, background=BRIGHT))
    bands = []
    for picture, frame in zip(flat(3), framed, strict=True):
        assert frame.shape[1] == 60
        assert frame.shape[0] % 2 == 0
        np.testing.assert_array_equal(frame[:40], picture)
        bands.append(frame[40:])
        assert (bands[-1] < 128).all(axis=2).sum() > 10
    assert not np.array_equal(bands[0], bands[1])
