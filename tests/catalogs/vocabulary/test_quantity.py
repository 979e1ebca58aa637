"""Names and units of fields: how they are given, kept in a catalog and shown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from catalogs.browse.description import describe as page_data
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.plan import CatalogPlan
from catalogs.tools.show import describe
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.quantity import Quantity, quantities_from, quantities_of
from catalogs.vocabulary.scene import Scene
from catalogs.vocabulary.variations import isovalue_family, transfer_function_family
from tests.catalogs.conftest import add_member, make_plan
from tests.support.transfer_functions import BASE, FUNCTION, FUNCTIONS

Q = Quantity("Q", "1/s²")
SEVERAL = (VolumeRendering("dvr", FUNCTION, field="q"), Isosurface("surface", 0.25, field="speed"))
LOGARITHMIC = ParameterSpace((Parameter("Re", 100.0, 2000.0, "", "log"), Parameter("Pr", 0.5, 2.0)))


@pytest.mark.parametrize(
    ("quantity", "label"),
    [
        (Q, "Q (1/s²)"),
        (Quantity("Q"), "Q"),
        (Quantity("", "K"), "K"),
        (Quantity(" T ", " K "), "T (K)"),
        (Quantity(), ""),
    ],
)
def test_labels(quantity: Quantity, label: str) -> None:
    assert str(quantity) == label
    assert bool(quantity) == bool(label)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ("Q", "fields must be units by the names of fields"),
        ({"Q": 5}, "the unit of field 'Q' must be printable text, got 5"),
        ({"Q": "1/s\0"}, "the unit of field 'Q' must be printable text"),
        ({5: "m"}, "the name of a field must be printable text, got 5"),
        ({"Q": {"name": "Q", "units": "m"}}, "the unit of field 'Q' must be printable text"),
    ],
)
def test_what_describes_no_field_is_named(fields: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        quantities_from(fields)


def test_an_only_field_without_a_name_is_given_one() -> None:
    assert quantities_of(quantities_from({"Q": "1/s²"}), ("",)) == {"": Q}
    assert quantities_of(quantities_from({"q": Q, "speed": "m/s"}), ("q", "speed")) == {
        "q": Q,
        "speed": Quantity("speed", "m/s"),
    }


@pytest.mark.parametrize(
    ("fields", "shown", "message"),
    [
        ({"q": "m", "heat": "K"}, ("",), r"give exactly one entry in fields, got q, heat"),
        ({"heat": "K"}, ("q", "speed"), r"fields describes heat, but the appearances show q, speed"),
        ({"heat": "K"}, ("q",), r"fields describes heat, but the appearances show q"),
    ],
)
def test_what_is_not_shown_is_not_described(fields: Any, shown: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        quantities_of(quantities_from(fields), shown)


def test_a_plan_says_what_its_fields_are_called(tmp_path: Path) -> None:
    plan = make_plan(quantities={"Q": "1/s²"})
    assert plan.field_label() == plan.field_label("") == "Q (1/s²)"
    assert Catalog.create(tmp_path / "a.cdb", plan).plan.differences(plan) == []
    assert Catalog.open(tmp_path / "a.cdb").plan.quantities == {"": Q}
    record = json.loads((tmp_path / "a.cdb" / "catalog.json").read_text())
    assert record["fields"] == {"": {"name": "Q", "unit": "1/s²"}}


def test_several_fields_each_have_their_label() -> None:
    plan = make_plan(appearances=SEVERAL, quantities={"speed": "m/s"})
    assert [plan.field_label(name) for name in ("", "q", "speed")] == ["q", "q", "speed (m/s)"]


def test_a_plan_without_says_nothing_and_is_written_as_before() -> None:
    assert make_plan().field_label() == ""
    assert "fields" not in make_plan().to_json()


@pytest.mark.parametrize("fields", [5, {"": 5}, {"": {"name": 5}}, {"a": "m", "b": "m"}, [1]])
def test_damaged_fields_are_named(tmp_path: Path, fields: Any) -> None:
    path = Catalog.create(tmp_path / "a.cdb", make_plan()).path / "catalog.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "fields": fields}))
    with pytest.raises(CatalogError, match="is damaged"):
        Catalog.open(tmp_path / "a.cdb")


def test_values_of_a_field_have_its_unit() -> None:
    surfaces = isovalue_family("dvr", train=(0.2, 0.4), style={"color": (1, 0, 0)})
    named = CatalogPlan(**{**vars(make_plan()), "appearances": (VolumeRendering("dvr", FUNCTION), *surfaces.appearances),
                           "variations": (surfaces.variation,), "quantities": {"T": "K"}})  # fmt: skip
    assert [p.unit for p in named.variations[0].space.parameters] == ["K"]
    functions = transfer_function_family(BASE, first_step=(0.1, 0.05), second_step=(0.1, 0.05), unit="°C")
    said = make_plan(
        appearances=(BASE, *functions.appearances), variations=(functions.variation,), quantities={"T": "K"}
    )
    assert [p.unit for p in said.variations[0].space.parameters] == ["°C", "", "°C", ""]  # what a variation says stays
    said = make_plan(
        appearances=(BASE, *FUNCTIONS.appearances), variations=(FUNCTIONS.variation,), quantities={"T": "K"}
    )
    assert [p.unit for p in said.variations[0].space.parameters] == ["K", "", "K", ""]


def test_it_is_shown_to_people(tmp_path: Path) -> None:
    surfaces = (Isosurface("iso", 0.25), Isosurface("iso2", 0.5))
    made = Catalog.create(tmp_path / "a.cdb", make_plan(appearances=(BASE, *surfaces), quantities={"Q": "1/s²"}))
    add_member(made, "a", 150.0)
    text = describe(made.path)
    assert "Q (1/s²)" in text
    assert "isosurface of Q at 0.25 1/s²" in text
    assert "Q (1/s²)" in made._repr_html_()
    page = page_data(made)
    assert page["visualization"][0]["unit"] == "1/s²"
    assert page["appearances"][1]["title"] == "iso (isovalue 0.25 1/s²)"


def test_a_logarithmic_scale_is_kept(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "a.cdb", make_plan(space=LOGARITHMIC))
    assert Catalog.open(made.path).plan.space == LOGARITHMIC
    assert "(log)" in describe(made.path)
    assert [p.get("scale") for p in page_data(made)["parameters"]] == ["log", None]


SCENE = """
name = "a"
[source]
kind = "simulation"
[[parameters]]
name = "nu"
low = 1e-4
high = 1e-2
unit = "m²/s"
scale = "log"
[members]
train = 4
[[appearance]]
kind = "isosurface"
name = "iso"
isovalue = 1.0
"""


def test_a_scene_takes_units_and_scales(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(SCENE + '[fields]\nQ = "1/s²"\n')
    scene = Scene.load(tmp_path / "a.toml")
    assert str(scene.space) == "nu in [0.0001, 0.01] m²/s (log)"
    assert scene.quantities == {"": Q}
    below = [m for m in scene.members if m.parameters["nu"] < 1e-3]
    assert len(below) == 2  # half of the members in each of the two decades


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('"log"', '"ln"', "parameter nu: scale must be one of"),
        ("low", "lowest", r"parameter 'nu': missing keys low, unknown keys lowest"),
        ("1e-4", "-1.0", 'scale "log", so its bounds must be positive'),
        ("[members]", "[fields]\nQ = 5\n[members]", "the unit of field 'Q' must be printable text, got 5"),
    ],
)
def test_a_wrong_scene_is_named(tmp_path: Path, before: str, after: str, message: str) -> None:
    (tmp_path / "a.toml").write_text(SCENE.replace(before, after, 1))
    with pytest.raises(ValueError, match=rf"a\.toml: .*{message}"):
        Scene.load(tmp_path / "a.toml")
