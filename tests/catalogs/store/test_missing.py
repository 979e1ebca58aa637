"""Records of missing members: found, removed, and harmless where they are damaged."""

from __future__ import annotations

import json

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.store.missing import MISSING, missing_members, no_longer_missing, report_missing
from catalogs.tools.check import check
from tests.catalogs.conftest import add_member


def test_what_is_missing_is_found_until_it_is_there(catalog: Catalog) -> None:
    report_missing(catalog.path, "b", {"Re": np.float64(120.0), "Pr": float("nan"), "x": "y"}, "ValueError: bad\nworse")
    report_missing(catalog.path, "a2", {}, "")
    first, second = catalog.missing
    assert (second.name, second.parameters, str(second)) == ("b", {"Re": 120.0}, "b: ValueError: bad")
    assert str(first) == "a2: no reason recorded"
    no_longer_missing(catalog.path, "a2")
    no_longer_missing(catalog.path, "never")
    assert [member.name for member in catalog.missing] == ["b"]
    add_member(catalog, "b", 130.0)  # by a program that knows nothing of such records
    assert catalog.missing == ()
    assert check(catalog.path) == []


@pytest.mark.parametrize(
    "damage", ["", "{", "[]", '{"parameters": 5, "reason": ""}', '{"parameters": {"a": "b"}, "reason": 1}', "\x00"]
)
def test_damaged_records_are_left_out(catalog: Catalog, damage: str) -> None:
    report_missing(catalog.path, "b", {}, "x" * 10**6)
    (catalog.path / MISSING / "c.json").write_text(damage)
    assert [member.name for member in missing_members(catalog.path)] == ["b"]
    assert len(json.dumps(catalog.missing[0].reason)) < 3000


@pytest.mark.parametrize("name", ["../x", "", "a/b", "12"])
def test_what_could_be_no_member_is_not_recorded(catalog: Catalog, name: str) -> None:
    report_missing(catalog.path, name, {}, "reason")
    assert catalog.missing == ()
    assert not (catalog.path / MISSING).exists()
