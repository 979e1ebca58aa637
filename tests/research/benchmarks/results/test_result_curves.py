"""The value of more time has a row for each scene, and a line in the plot."""

from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image

from research.benchmarks.results.curves import curves_section, plot
from research.benchmarks.results.scenes import SceneResults
from tests.research.support.curves import point

CURVE = (point(0.5, 30.0), point(2.0, 31.5, isovalue=25.0))
SCENES = [SceneResults("a", "A", Path("runs/a"), curve=CURVE), SceneResults("b", "B", Path("runs/b"))]


def test_each_scene_and_variation_has_a_row() -> None:
    title, _, rows, picture, source = curves_section(SCENES, is_drawn=True)
    header, _, base, varied = ([cell.strip() for cell in line.strip("|\n").split("|")] for line in rows.splitlines())
    assert title.startswith("## ")
    assert header == ["scene", "0.5 min", "2 min"]
    assert base == ["`a`", "30.00 (100)", "31.50 (100)"]
    assert varied == ["`a`, isovalues", "–", "25.00 (100)"]
    assert "results_curves.png" in picture
    assert "research.benchmarks.training.curves scenes/a.toml" in source
    assert "seed 0" in source


def test_without_any_there_is_neither_section_nor_picture() -> None:
    assert curves_section(SCENES[1:], is_drawn=False) == []
    assert plot(SCENES[1:]) is None


@pytest.mark.slow
def test_the_plot_is_a_picture() -> None:
    drawn = plot(SCENES)
    assert drawn is not None
    with Image.open(BytesIO(drawn)) as picture:
        assert picture.format == "PNG"
