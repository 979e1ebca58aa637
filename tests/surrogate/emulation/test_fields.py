"""All fields of a catalog are emulated, stored and read together."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.quantity import Quantity
from catalogs.vocabulary.scene import ViewPlan
from surrogate.emulation import EmulatedFields
from tests.support.hooked import FUNCTION, blob

AT = (100.0, 120.0, 150.0, 190.0)
BETWEEN = 135.0


def rendered(path: Path, *sizes: int) -> Catalog:
    """A catalog of members with two fields that grow with Re."""
    looks = [VolumeRendering("dvr", FUNCTION, field="q"), Isosurface("surface", 4.0, field="speed")]
    options = {"space": {"Re": (100.0, 200.0)}, "appearances": looks, "fields": {"q": "1/s²", "speed": "m/s"}}
    with insitu.Session(path, views=ViewPlan(frequency=1, width=16, height=16), **options) as session:
        for number, value in enumerate(AT):
            size = sizes[number % len(sizes)]
            fields = {"q": blob(size=size) * value / 100.0, "speed": blob(size=size) * 4.0 + value / 100.0}
            session.render_member(fields, {"Re": value}, spacing=(1.1 / (size - 1),) * 3)
    return Catalog.open(path)


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> EmulatedFields:
    return EmulatedFields.fit(rendered(tmp_path_factory.mktemp("catalog") / "a.cdb", 12))


def test_fields_between_members_are_predicted(emulated: EmulatedFields) -> None:
    assert list(emulated) == ["q", "speed"]
    point = emulated.space.normalize([BETWEEN])
    truth = blob(size=12) * BETWEEN / 100.0
    assert np.abs(emulated["q"].at(point).values - truth).max() < 0.02 * truth.max()
    assert emulated.quantity("speed").unit == "m/s"
    with pytest.raises(KeyError, match="no field 'p' is emulated, only q, speed"):
        emulated["p"]


def test_stored_fields_are_read_again(tmp_path: Path, emulated: EmulatedFields) -> None:
    emulated.save(tmp_path)
    loaded = EmulatedFields.load(tmp_path)
    assert (loaded.space, loaded.quantities, loaded.megabytes) == (
        emulated.space,
        emulated.quantities,
        emulated.megabytes,
    )
    point = emulated.space.normalize([BETWEEN])
    for name in emulated:
        np.testing.assert_array_equal(loaded[name].at(point).values, emulated[name].at(point).values)
    assert repr(loaded) == repr(emulated)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda record: record.update(fields={}), "fields must be at most"),
        (lambda record: record.update(fields=[1]), "fields must be at most"),
        (lambda record: record["fields"][1].pop("shape"), "'shape' is missing"),
        (lambda record: record["fields"][0].update(field=3), "name of a quantity"),
        (lambda record: record["fields"].append(dict(record["fields"][0])), "is missing"),
        (lambda record: record.update(parameters=[]), "0 parameters"),
        (lambda record: record.pop("parameters"), "'parameters' is missing"),
    ],
)
def test_damage_is_named(
    tmp_path: Path, emulated: EmulatedFields, change: Callable[[dict[str, Any]], object], complaint: str
) -> None:
    emulated.save(tmp_path)
    record = json.loads((tmp_path / "model.json").read_text())
    change(record)
    (tmp_path / "model.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=complaint):
        EmulatedFields.load(tmp_path)


def test_fields_on_other_grids_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"the coarse field 'q' of .* has 13 x 13 x 13 .*, that of .* 12 x 12 x 12"):
        EmulatedFields.fit(rendered(tmp_path / "a.cdb", 12, 13))


def test_a_catalog_without_fields_has_none(tmp_path: Path) -> None:
    catalog = rendered(tmp_path / "a.cdb", 12)
    assert len(EmulatedFields.fit(catalog, splits=("test",))) == 0


def test_an_unnamed_field_goes_by_the_name_of_its_quantity(emulated: EmulatedFields) -> None:
    alone = EmulatedFields(emulated.space, {"": emulated["q"]}, {"": Quantity("energy", "J")})
    point = alone.space.normalize([BETWEEN])
    assert alone["energy"] is alone[""]
    assert alone.quantity("energy") == alone.field("energy", point).quantity == Quantity("energy", "J")
    assert ": energy, " in repr(alone)
    assert len(repr(alone.field("energy", point))) < 130
    with pytest.raises(KeyError, match="no field 'q' is emulated, only energy"):
        alone["q"]
