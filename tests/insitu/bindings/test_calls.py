"""The library's functions, called from Python."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
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
    assert calls.set_ghosts([0, 0, 0]) == DONE
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
    assert member.coarse_field().values == pytest.approx(VALUES.reshape(4, 5, 6), abs=1e-4)


def test_the_field_is_read_where_it_lies_x_fastest(calls, monkeypatch) -> None:
    seen = []
    monkeypatch.setattr(calls._session, "render_member", lambda field, *_, **place: seen.append((field, place)))
    set_field(calls)
    calls.set_ghosts([0, 0, 0])
    calls.render(math.nan)
    ((field, place),) = seen
    assert np.shares_memory(field, VALUES)
    np.testing.assert_array_equal(field[1, 2], VALUES[6 * (5 + 2) : 6 * (5 + 2) + 6])
    assert place == {"time": None, "spacing": (0.1,) * 3, "origin": (0.0,) * 3, "ghosts": (0, 0, 0)}


def test_several_fields_go_by_their_names(tmp_path: Path, monkeypatch) -> None:
    scene = Path(SCENE).read_text()
    shown = scene.replace('name = "waves"', 'name = "waves"\nfield = "q"')
    more = scene[scene.index("[[appearance]]") : scene.index("[views]")]
    more = more.replace('name = "waves"', 'name = "fast"\nfield = "speed"')
    (tmp_path / "scene.toml").write_text(shown.replace("[views]", f"{more}[views]"))
    calls, seen = LibraryCalls(), []
    assert calls.initialize(str(tmp_path / "scene.toml"), str(tmp_path / "a.cdb")) == DONE, calls.error
    monkeypatch.setattr(calls._session, "render_member", lambda field, *_, **place: seen.append(field))
    set_field(calls, "q")
    set_field(calls, "speed")
    calls.render(0.0)
    assert [*seen[0]] == ["q", "speed"]
    assert set_field(calls, "p") == FAILED
    assert calls.error == "ValueError: field 'p' is shown by no appearance of the scene: they show q, speed"
    assert set_field(calls, "q") == DONE
    assert set_field(calls, "speed", shape=(5, 6, 4)) == FAILED
    assert "'speed' has the shape (5, 6, 4), but 'q' (6, 5, 4)" in calls.error
    calls.render(0.0)
    calls.render(0.0)
    with pytest.raises(TypeError, match="the member has no field: call insitu_set_field before"):
        seen[2]()  # forgotten


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (lambda c: c.render(0.0), "TypeError: the member has no field: call insitu_set_field before"),
        (lambda c: set_field(c, shape=(0, 5, 4)), "ValueError: field '': shape must be three positive numbers"),
        (lambda c: set_field(c, shape=(-6, -5, 4)), "ValueError: field '': shape must be three positive numbers"),
        (lambda c: set_field(c, shape=(1 << 20, 1 << 20, 1 << 20)), "ValueError: field '': shape must be three"),
        (lambda c: set_field(c, shape=(30, 4, 1)), "ValueError: field '': shape must be at least 2 samples"),
        (lambda c: set_field(c) or set_field(c, "q"), "ValueError: field 'q' is the member's second, after ''"),
        (lambda c: c.initialize(SCENE, "b.cdb"), "ValueError: insitu_initialize was called twice"),
        (lambda c: set_field(c, values=VALUES * np.nan) or c.render(0.0), "ValueError: 120 of 120 values are NaN"),
        (lambda c: set_field(c) or c.render(math.inf), "ValueError: time must be a finite number, got inf"),
        (
            lambda c: c.set_parameter("K", 1.0),
            "ValueError: parameters must be exactly k, time: missing none, unknown K",
        ),
        (lambda c: c.set_parameter("k", math.nan), "ValueError: parameter k must be finite, got nan"),
        (lambda c: c.set_grid([0.1, 0.0, 0.1], [0.0] * 3), "ValueError: spacing must be positive, got 0"),
        (lambda c: c.set_grid([0.1] * 3, [0.0, math.inf, 0.0]), "ValueError: origin must be a finite number, got inf"),
        (
            lambda c: c.set_ghosts([1, 1, 1]),
            "ValueError: layers (1, 1, 1) are of a rank's block, but the session has one",
        ),
        (lambda c: c.set_ghosts([0, -1, 0]), "ValueError: ghosts must be a number of layers on every side"),
    ],
)
def test_mistakes_are_reported_by_the_call_that_makes_them_and_change_nothing(calls, mistake, message) -> None:
    assert mistake(calls) == FAILED
    assert calls.error.startswith(message)
    assert set_field(calls) == DONE
    assert calls.error == ""
    assert calls.render(1.0) == DONE, calls.error
    (member,) = calls._session.results
    assert (member.name, member.ranges[""]) == ("k-2.0_time-1.0", pytest.approx((VALUES.min(), VALUES.max())))


def test_nothing_works_before_the_beginning_or_after_the_end(calls) -> None:
    for other in (LibraryCalls(), calls):
        if other is calls:
            assert calls.finalize() == DONE
        assert other.render(0.0) == FAILED
        assert "insitu_initialize must be called" in other.error
        assert other.has(0.0) == UNKNOWN
        assert other.finalize() == FAILED
        assert other.set_parameter("k", 2.0) == other.set_ghosts([0, 0, 0]) == set_field(other) == FAILED
        assert other.set_grid([0.1] * 3, [0.0] * 3) == FAILED


def test_a_session_after_the_end_of_another_begins_anew(calls, tmp_path: Path) -> None:
    assert calls.finalize() == DONE
    assert calls.initialize(SCENE, str(tmp_path / "b.cdb")) == DONE
    assert set_field(calls) == DONE
    assert calls.render(0.5) == FAILED
    assert "missing k" in calls.error


def test_a_scene_that_is_none_is_told() -> None:
    calls = LibraryCalls()
    assert calls.initialize("nothing.toml", "a.cdb") == FAILED
    assert calls.error.startswith("FileNotFoundError: scene nothing.toml does not exist")
