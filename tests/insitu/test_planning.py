"""What the ensemble fixes, and how differences are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.parameters import Parameter, ParameterSpace
from catalogs.scene import ViewPlan
from insitu.boxes import box_around, box_of, check_inside, is_smaller
from insitu.planning import (
    Pilot,
    PlanOptions,
    appearances_from_toml,
    combine_pilots,
    differing,
    disagreements,
    plan_catalog,
    space_from,
)
from render import SampleDistance, to_grid

SPACE = ParameterSpace((Parameter("Re", 1.0, 2.0),))
VOLUME = VolumeRendering("dvr", TransferFunction(((0, 0, 0, 1), (1, 1, 0, 0)), ((0, 0), (1, 0.5)), 0.3))
BOX = ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))

JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


@given(JSON, JSON)
def test_differences_are_found_exactly_where_there_are_some(first, second) -> None:
    assert differing(first, first, "x") == []
    if first is not None and second is not None and first != second and None not in _leaves([first, second]):
        assert differing(first, second, "x")


def _leaves(value) -> list:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else None
    return [value] if inner is None else [leaf for part in inner for leaf in _leaves(part)]


def test_a_difference_names_its_place_and_both_values() -> None:
    first = [{"name": "dvr", "points": [[0.0, 1.0], [2.0, 3.0]]}]
    second = [{"name": "dvr", "points": [[0.0, 1.0], [2.5, 3.0]]}]
    assert differing(first, second, "appearances") == ["appearances.dvr.points.1.0: 2.0 here, 2.5 in the catalog"]


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


def test_a_plan_agrees_with_the_wishes_it_came_from_and_no_others() -> None:
    options = PlanOptions(SPACE, (VOLUME, Isosurface("iso", 4.0)), ViewPlan(frequency=2, width=32, height=32), BOX)
    plan = plan_catalog(Pilot(BOX, {"": (0.0, 9.0)}, {"dvr": step(0.1, 51.0)}), options)
    assert disagreements(plan, options) == []
    assert plan.provenance["value_range"] == [0.0, 4.0]
    assert plan.provenance["bounds_from"] == "given"
    assert disagreements(plan, PlanOptions()) == []
    assert disagreements(plan, PlanOptions(views=ViewPlan(frequency=2, width=32, height=32, fill=0.8)))
    assert disagreements(plan, PlanOptions(views=ViewPlan(frequency=2, width=32, height=32, vertical_fov_degrees=31.0)))
    assert disagreements(plan, PlanOptions(bounds=((0, 0, 0), (1, 2, 3.01))))
    assert not disagreements(plan, PlanOptions(bounds=((0, 0, 0), (1, 2, 3.000001))))
    assert disagreements(plan, PlanOptions(target_decibels=40.0)) == ["target_decibels: 40.0 here, 50.0 in the catalog"]
    assert disagreements(plan, PlanOptions(sample_distance=0.2))
    assert not disagreements(plan, PlanOptions(sample_distance=0.1))
    assert disagreements(plan, PlanOptions(image_format="exr"))
    assert disagreements(plan, PlanOptions(space=space_from({"Re": (1.0, 3.0)})))


def test_boxes_are_judged_by_their_size() -> None:
    box = box_of(to_grid(np.zeros((4, 3, 2)), spacing=(1.0, 1.0, 1.0)))
    assert box_around([box]) == BOX
    check_inside(box, BOX)
    check_inside(box, ((0, 0, 0), (1, 2, 3 - 1e-7)))
    with pytest.raises(ValueError, match=r"\(1, 2, 3\)"):
        check_inside(box, ((0, 0, 0), (1, 2, 2.9)))
    assert not is_smaller(box, ((0, 0, 0), (1, 2, 3.01)))
    assert is_smaller(box, ((0, 0, 0), (1, 2, 3.1)))


@pytest.mark.parametrize(
    "text",
    ["[[appearance", "x = 1", "appearance = 3", '[[appearance]]\nkind = "volume"', '[[appearance]]\nkind = "solid"'],
)
def test_a_wrong_appearance_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "look.toml").write_text(text)
    with pytest.raises(ValueError, match=r"look\.toml"):
        appearances_from_toml(tmp_path / "look.toml")
