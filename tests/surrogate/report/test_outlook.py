"""The parameters that matter, and what a model can't answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from surrogate.model import Surrogate
from surrogate.model.representation import GAUSSIANS
from surrogate.report.outlook import lengths_line, outlook_record
from tests.support.field_catalogs import rendered
from tests.support.varied_blobs import varied_catalog, varied_surrogate


@pytest.fixture(scope="module")
def surrogate() -> Surrogate:
    return varied_surrogate()


@pytest.fixture(scope="module")
def catalog(surrogate: Surrogate, tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return varied_catalog(tmp_path_factory.mktemp("outlook") / "a.cdb", surrogate)


def test_importance_is_the_change_of_pictures_at_members(surrogate: Surrogate, catalog: Catalog) -> None:
    record = outlook_record(surrogate, catalog)
    [(name, change)] = record["importance"].items()
    assert name == "p"
    ends = [surrogate.at({"p": p}).render(catalog.members[0].cameras[0]) for p in (0.0, 1.0)]
    assert change > 0.3 * np.abs(ends[1] - ends[0]).mean()
    assert (record["gains"], record["lengths"], record["learning_curve"]) == ([], None, None)
    assert lengths_line(record) == ""


@pytest.mark.parametrize(("has_fields", "remedy"), [(False, "--add-coarse-fields"), (True, "`surrogate train a.cdb")])
def test_a_model_without_fields_says_how_to_get_them(surrogate: Surrogate, tmp_path: Path, has_fields, remedy) -> None:
    catalog = rendered(tmp_path / "a.cdb") if has_fields else varied_catalog(tmp_path / "a.cdb", surrogate)
    plain = replace(surrogate, training={**surrogate.training, "appearance": catalog.plan.appearance_names[0]})
    said = outlook_record(plain, catalog)["lacks"]
    assert said.startswith("This model holds no emulated fields")
    assert remedy in said
    assert ("--add-coarse-fields" in said) != has_fields
    assert outlook_record(replace(plain, only=GAUSSIANS), catalog)["lacks"] == ""


def test_length_scales_are_said_from_the_shortest_on() -> None:
    assert "first: time 0.37, Re 0.99." in lengths_line({"lengths": {"Re": 0.99, "time": 0.37}})
    assert lengths_line({"lengths": {}}) == ""
