"""Parameters that a later call of a command names otherwise are refused, whatever their bounds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from insitu.commands.reading import ReadingOptions
from insitu.members.agreement import READING, disagreements
from insitu.members.planning import PlanOptions
from tests.catalogs.conftest import make_plan

SPACE = ParameterSpace((Parameter("a", 0.0, 1.0), Parameter("b", 0.0, 1.0)))


@pytest.fixture
def plan() -> CatalogPlan:
    return replace(make_plan(), space=SPACE, provenance={READING: {"names": "a,b"}})


@pytest.fixture
def source(tmp_path: Path) -> str:
    with h5py.File(tmp_path / "e.h5", "w") as file:
        file["field"] = np.random.default_rng(0).random((3, 4, 4, 4))
        file["params"] = [[0.0, 1.0], [1.0, 0.0], [0.5, 0.25]]  # of the same bounds
        file.attrs["spacing"] = (1.0, 1.0, 1.0)
    return str(tmp_path / "e.h5")


@pytest.mark.parametrize("names", [None, "a,b"])
def test_the_same_names_agree(plan: CatalogPlan, source: str, names: str | None) -> None:
    stored = ReadingOptions(names=names).as_in(plan).open([source])
    assert stored.space == SPACE
    assert disagreements(plan, PlanOptions(space=stored.space)) == []


def test_columns_in_another_order_are_refused(plan: CatalogPlan, source: str) -> None:
    stored = ReadingOptions(names="b,a").as_in(plan).open([source])
    named = disagreements(plan, PlanOptions(space=stored.space))
    assert any('"b" here, "a" in the catalog' in text for text in named)


def test_another_name_is_refused(plan: CatalogPlan, source: str) -> None:
    with pytest.raises(ValueError, match=r"--bounds of b, but the parameters are a, c"):
        ReadingOptions(names="a,c").as_in(plan).open([source])
