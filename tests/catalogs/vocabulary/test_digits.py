"""Numbers in as many digits as tell them apart."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.store.catalog import Catalog
from catalogs.tools.show import describe
from catalogs.vocabulary.numbers import text, texts
from catalogs.vocabulary.parameters import Parameter, ParameterSpace

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize(
    ("value", "width", "shown"),
    [
        (1830.123456789, 1000.0, "1830.12"),
        (59000.0416666667, 0.125, "59000.041667"),
        (1.7e9 + 0.5, 10.0, "1700000000.5"),
        (1.7e9 + 0.5, 0.0, "1700000000.5"),
        (0.1 + 0.2, 0.0, "0.3"),
        (1e-30, 1.0, "1e-30"),
        (0.0, 0.0, "0"),
        (-59000.25, 1.0, "-59000.25"),
    ],
)
def test_digits_follow_the_range(value: float, width: float, shown: str) -> None:
    assert text(value, width) == shown


@given(st.lists(NUMBERS, max_size=20))
def test_numbers_that_differ_are_shown_differently(values: list[float]) -> None:
    shown = texts(values)
    assert len({float(t) for t in shown}) == len(set(values))
    np.testing.assert_allclose([float(t) for t in shown], values, rtol=5e-6)


@pytest.mark.parametrize(("low", "high", "learnt"), [(1.0, 10.0, True), (1.0, 9.9, False), (0.0, 10.0, False)])
def test_a_catalog_says_what_is_learnt_by_its_logarithm(low: float, high: float, learnt: bool, tmp_path: Path) -> None:
    from tests.catalogs.conftest import make_plan

    Catalog.create(tmp_path / "a.cdb", make_plan(space=ParameterSpace((Parameter("nu", low, high),))))
    assert ("; learnt by its logarithm" in describe(tmp_path / "a.cdb")) == learnt


def test_a_parameter_says_its_bounds_and_values_in_these_digits() -> None:
    days = ParameterSpace((Parameter("time", 59000.0, 59000.125, "d"),))
    assert str(days) == "time in [59000, 59000.125] d"
    assert "time = 59000.25 lies outside its bounds [59000, 59000.125]" in days.outside([59000.25])["time"]
    assert str(ParameterSpace((Parameter("Re", 1500.0, 2500.0),))) == "Re in [1500, 2500]"


def test_the_table_of_members_tells_them_apart(tmp_path: Path) -> None:
    from tests.catalogs.conftest import make_plan

    space = ParameterSpace((Parameter("time", 59000.0, 59000.125),))
    catalog = Catalog.create(tmp_path / "a.cdb", make_plan(space=space))
    times = [59000.0, 59000.041667, 59000.0416671, 59000.125]
    for number, time in enumerate(times):
        with catalog.begin_member(f"m{number}", {"time": time}) as writer:
            for view in range(len(catalog.plan.cameras)):
                for appearance in catalog.appearance_names:
                    writer.write_image(appearance, view, np.zeros((12, 16, 4), np.uint8))
    rows = [line.split() for line in describe(catalog.path).splitlines() if line.strip().startswith("m")]
    assert [float(row[2]) for row in rows if row[0] in ("m0", "m1", "m2", "m3")] == times
