"""A comparison holds both pictures and their difference, pixel by pixel, and says what they are."""

from __future__ import annotations

import io
import itertools

import numpy as np
import pytest
from PIL import Image

from catalogs.files.images import to_bytes
from surrogate.explore.exporting.comparison import comparison
from surrogate.explore.exporting.difference import difference_of
from surrogate.explore.exporting.lettering import length, wrapped
from surrogate.storage.picture_records import record_of

RANDOM = np.random.default_rng(2)
FIRST, SECOND = (RANDOM.random((40, 30, 3)).astype(np.float32) for _ in range(2))
WHITE = (1.0, 1.0, 1.0)


def places_of(picture: np.ndarray, sheet: np.ndarray) -> list[tuple[int, int]]:
    """Row and column of where the sheet holds the picture."""
    height, width = picture.shape[:2]
    rows, columns = np.nonzero((sheet == picture[0, 0]).all(axis=2))
    found = itertools.filterfalse(
        lambda at: (
            (sheet[at[0] : at[0] + height, at[1] : at[1] + width].shape != picture.shape)
            or (sheet[at[0] : at[0] + height, at[1] : at[1] + width] != picture).any()
        ),
        zip(rows.tolist(), columns.tolist(), strict=True),
    )
    return list(found)


def test_three_pictures_stand_side_by_side() -> None:
    made = comparison(FIRST, SECOND, [["A: p = 0.1"], ["B: p = 0.9"]], background=WHITE, record={"a": 1})
    sheet = np.asarray(Image.open(io.BytesIO(made)).convert("RGB"))
    shown = [to_bytes(picture) for picture in (FIRST, SECOND, difference_of(FIRST, SECOND).picture)]
    ((top, first),), ((_, second),), ((_, third),) = (places_of(picture, sheet) for picture in shown)
    assert first < second < third
    assert (sheet[:top] < 128).any()  # words, on white
    assert record_of(made) == {"a": 1}


def test_words_that_are_long_are_broken() -> None:
    told = ["A: p = 0.1", "not measured here: " + "the camera is nearer than any stored one and " * 3]
    made = comparison(FIRST, SECOND, [told, ["B"]], background=(0, 0, 0))
    taller, lower = (
        Image.open(io.BytesIO(m)) for m in (made, comparison(FIRST, SECOND, [["A"], ["B"]], background=(0, 0, 0)))
    )
    assert taller.width == lower.width
    assert taller.height > lower.height
    lines = wrapped(told[1], 12, 200)
    assert " ".join(lines) == told[1].strip()
    assert all(length(line, 12) <= 200 for line in lines)
    assert wrapped("unbreakable", 12, 3) == ["unbreakable"]


def test_two_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="of one size"):
        comparison(FIRST, SECOND[1:], [["A"], ["B"]], background=WHITE)
