"""What the ensemble fixes before its first member."""

from __future__ import annotations

from pathlib import Path

import pytest

from insitu.planning import Pilot, appearances_from_toml, combine_pilots
from render import SampleDistance


def step(distance: float, decibels: float) -> SampleDistance:
    return SampleDistance(distance, decibels, milliseconds=1.0)


def test_several_pilots_give_the_widest_box_and_the_finest_step() -> None:
    pilots = [
        Pilot(((0, 0, 0), (1, 1, 1)), {"": (0.0, 5.0)}, {"a": step(0.2, 51.0), "b": step(0.1, 52.0)}),
        Pilot(((-1, 0, 0), (1, 3, 1)), {"": (1.0, 7.0)}, {"a": step(0.3, 53.0), "b": step(0.05, 54.0)}),
    ]
    combined = combine_pilots(pilots)
    assert combined.bounds == ((-1.0, 0.0, 0.0), (1.0, 3.0, 1.0))
    assert combined.ranges == {"": (0.0, 7.0)}
    assert combined.distances == {"a": step(0.2, 51.0), "b": step(0.05, 54.0)}


@pytest.mark.parametrize(
    "text",
    ["[[appearance", "x = 1", "appearance = 3", '[[appearance]]\nkind = "volume"', '[[appearance]]\nkind = "solid"'],
)
def test_a_wrong_appearance_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "look.toml").write_text(text)
    with pytest.raises(ValueError, match=r"look\.toml"):
        appearances_from_toml(tmp_path / "look.toml")
