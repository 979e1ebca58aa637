"""The library's functions, called from Python."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from insitu.bindings.build import HEADER, declarations
from insitu.bindings.calls import DONE, FAILED, UNKNOWN, LibraryCalls

EXAMPLE = Path(__file__).parents[3] / "examples" / "embedding"
SCENE = str(EXAMPLE / "scene.toml")
SHAPE = (6, 5, 4)  # x, y, z
VALUES = np.sin(np.arange(120.0))


def set_field(calls: LibraryCalls, name: str = "", values=VALUES, shape=SHAPE) -> int:
    return calls.set_field(name, shape, lambda count: values[:count])


@pytest.fixture
def calls(tmp_path: Path) -> LibraryCalls:
    found = LibraryCalls()
    assert found.initialize(SCENE, str(tmp_path / "a.cdb")) == DONE, found.error
    assert found.set_parameter("k", 2.0) == DONE
    assert found.set_grid([0.1, 0.1, 0.1], [0.0, 0.0, 0.0]) == DONE
    return found


def test_members_are_rendered_once_and_known(calls, tmp_path: Path) -> None:
    assert calls.has(0.5) == 0
    for _ in range(2):  # the second is skipped
        assert set_field(calls) == DONE
        assert calls.render(0.5) == DONE, calls.error
    assert calls.has(0.5) == 1
    assert calls.finalize() == DONE
    (member,) = Catalog.open(tmp_path / "a.cdb").members
    assert dict(member.parameters) == {"k": 2.0, "time": 0.5}
    (summary,) = member.summaries().values()
    assert (summary.minimum, summary.maximum) == pytest.approx((VALUES.min(), VALUES.max()))


def test_the_field_is_read_where_it_lies_x_fastest(calls, monkeypatch) -> None:
    seen = []
    monkeypatch.setattr(calls._session, "render_member", lambda field, *_, **place: seen.append((field, place)))
    set_field(calls)
    calls.set_ghosts([1, 0, 2])
    calls.render(math.nan)
    ((field, place),) = seen
    assert np.shares_memory(field, VALUES)
    np.testing.assert_array_equal(field[1, 2], VALUES[6 * (5 + 2) : 6 * (5 + 2) + 6])
    assert place == {"time": None, "spacing": (0.1,) * 3, "origin": (0.0,) * 3, "ghosts": (1, 0, 2)}


def test_several_fields_go_by_their_names(calls, monkeypatch) -> None:
    seen = []
    monkeypatch.setattr(calls._session, "render_member", lambda field, *_, **place: seen.append(field))
    set_field(calls, "q")
    set_field(calls, "speed")
    calls.render(0.0)
    assert [*seen[0]] == ["q", "speed"]
    calls.render(0.0)
    assert seen[1] is None  # forgotten


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (lambda c: c.render(0.0), "TypeError"),
        (lambda c: set_field(c, shape=(0, 5, 4)), "ValueError: field '': shape must be three positive numbers"),
        (lambda c: set_field(c, shape=(1 << 20, 1 << 20, 1 << 20)), "ValueError: field '': shape must be three"),
        (lambda c: c.initialize(SCENE, "b.cdb"), "ValueError: insitu_initialize was called twice"),
        (lambda c: set_field(c, values=VALUES * np.nan) or c.render(0.0), "ValueError: 120 of 120 values are NaN"),
    ],
)
def test_mistakes_are_told_and_the_next_member_is_rendered(calls, mistake, message) -> None:
    assert mistake(calls) == FAILED
    assert calls.error.startswith(message)
    assert set_field(calls) == DONE
    assert calls.error == ""
    assert calls.render(1.0) == DONE, calls.error


def test_nothing_works_before_the_beginning_or_after_the_end(calls) -> None:
    for other in (LibraryCalls(), calls):
        if other is calls:
            assert calls.finalize() == DONE
        assert other.render(0.0) == FAILED
        assert "insitu_initialize must be called" in other.error
        assert other.has(0.0) == UNKNOWN
        assert other.finalize() == FAILED


def test_a_scene_that_is_none_is_told() -> None:
    calls = LibraryCalls()
    assert calls.initialize("nothing.toml", "a.cdb") == FAILED
    assert calls.error.startswith("FileNotFoundError: scene nothing.toml does not exist")


def test_the_header_declares_what_the_interpreter_defines() -> None:
    from importlib.resources import files

    from insitu.bindings.build import START

    declared = declarations((files("insitu.bindings") / HEADER).read_text())
    names = [line.split("(")[0].split()[-1].lstrip("*") for line in declared.split(";") if "(" in line]
    assert len(names) == 11
    assert [f"def {name}(" in START for name in names] == [True] * 11
