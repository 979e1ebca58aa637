"""Messages name the differences between a request and a catalog."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from insitu.members.agreement import differing, disagreements
from insitu.members.planning import Pilot, PlanOptions, plan_catalog, space_from
from render import SampleDistance

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


def test_a_plan_agrees_with_the_wishes_it_came_from_and_no_others() -> None:
    options = PlanOptions(SPACE, (VOLUME, Isosurface("iso", 4.0)), ViewPlan(frequency=2, width=32, height=32), BOX)
    plan = plan_catalog(Pilot(BOX, {"": (0.0, 9.0)}, {"dvr": SampleDistance(0.1, 51.0)}), options)
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


def test_isosurfaces_have_no_sample_distances_so_any_target_agrees() -> None:
    views = ViewPlan(frequency=1, width=32, height=32)
    options = PlanOptions(SPACE, (Isosurface("iso", 4.0),), views, BOX, target_decibels=50.0)
    assert disagreements(plan_catalog(Pilot(BOX, {"": (0.0, 9.0)}, {}), options), options) == []
