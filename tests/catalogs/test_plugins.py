"""Kinds that other packages add by entry points."""

from __future__ import annotations

from pathlib import Path

import pytest

from catalogs.plugins import plugins
from tests.support.foreign_packages import install

GROUP = "gs_surrogate.readers"


def test_an_installed_package_adds_its_kinds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = plugins(GROUP)
    install(tmp_path, "foreign", {GROUP: {"mine": "foreign:MINE"}}, "MINE = 'a reader'\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert plugins(GROUP) == {**before, "mine": "a reader"}
    monkeypatch.undo()
    assert plugins(GROUP) == before


def test_one_that_does_not_load_leaves_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = {"bad": "broken:MISSING", "good": "broken:GOOD"}
    install(tmp_path, "broken", {GROUP: points}, "GOOD = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.warns(
        UserWarning, match=r"'bad' of broken in gs_surrogate.readers is left out: it does not load: Attr"
    ):
        found = plugins(GROUP)
    assert found["good"] == 1
    assert "bad" not in found


def test_two_packages_of_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("first", "second"):
        install(tmp_path, package, {GROUP: {"same": f"{package}:VALUE"}}, f"VALUE = {package!r}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.warns(UserWarning, match="another package has this name"):
        assert plugins(GROUP)["same"] in ("first", "second")
