"""Requests for a member: its time among the parameters, its name, and all refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from insitu.members.request import MemberArguments, member_request

RUN = ParameterSpace((Parameter("Re", 100.0, 200.0),))
DUMPS = ParameterSpace((*RUN.parameters, Parameter("time", 0.0, 10.0, "s")))
SHORT = ParameterSpace((Parameter("t", 0.0, 10.0),))
BOTH = ParameterSpace((Parameter("t", 0.0, 10.0), Parameter("time", 0.0, 10.0)))
KNOWN = (Isosurface("one", 0.5), Isosurface("two", 0.6))


@pytest.mark.parametrize(
    ("space", "parameters", "time", "filled", "recorded"),
    [
        (RUN, {"Re": 150}, None, {"Re": 150.0}, None),
        (RUN, {"Re": 150}, 3.0, {"Re": 150.0}, 3.0),
        (DUMPS, {"Re": 150}, 3.0, {"Re": 150.0, "time": 3.0}, 3.0),
        (DUMPS, {"time": 3, "Re": 150}, None, {"Re": 150.0, "time": 3.0}, 3.0),
        (DUMPS, {"Re": 150, "time": 3.0}, np.float32(3.0), {"Re": 150.0, "time": 3.0}, 3.0),
        (
            DUMPS,
            {"Re": 150, "time": 0.1},
            np.float32(0.1),
            {"Re": 150.0, "time": 0.1},
            0.1,
        ),  # rounded to single precision
        (DUMPS, {"Re": 150, "time": 0.0}, 0.0, {"Re": 150.0, "time": 0.0}, 0.0),
        (SHORT, {}, 2.5, {"t": 2.5}, 2.5),
        (BOTH, {"t": 1.0}, 2.5, {"t": 1.0, "time": 2.5}, 2.5),
    ],
)
def test_time_is_a_parameter_where_the_space_has_it(
    space: ParameterSpace, parameters: dict[str, float], time: Any, filled: dict[str, float], recorded: float | None
) -> None:
    request = member_request(space, KNOWN, MemberArguments(parameters, time=time))
    assert dict(request.parameters) == filled
    assert list(request.parameters) == list(space.names)
    assert request.record.get("time") == recorded
    assert all(repr(value) in request.name for value in filled.values())


@pytest.mark.parametrize(
    ("space", "parameters", "changes", "message"),
    [
        (DUMPS, {"Re": 150, "time": 3.0}, {"time": 4.0}, r"time=4.0 and the parameter time = 3.0 disagree: give one"),
        (DUMPS, {"Re": 150}, {}, r"missing time"),
        (DUMPS, {"Re": 150, "time": "late"}, {}, "parameter time must be a finite number, got 'late'"),
        (RUN, {"Re": 150}, {"time": "late"}, "time must be a finite number, got 'late'"),
        (RUN, {"Re": 150}, {"time": np.inf}, "time must be a finite number, got inf"),
        (RUN, [150], {}, r"parameters must be values by name, such as .*, got \[150\]"),
        (RUN, 150.0, {}, "parameters must be values by name, such as .*, got 150.0"),
        (RUN, {"re": 150}, {}, r"parameters must be exactly Re: missing Re, unknown re"),
        (RUN, {"Re": "fast"}, {}, "parameter Re must be a number, got 'fast'"),
        (RUN, {"Re": 150}, {"name": 5}, "a name must be 1 to 100 letters, .*, got 5"),
        (RUN, {"Re": 150}, {"name": ""}, "a name must be 1 to 100 letters, .*, got ''"),
        (RUN, {"Re": 150}, {"split": "holdout"}, "split must be one of .*, got 'holdout'"),
        (RUN, {"Re": 150}, {"split": ["train"]}, "split must be one of"),
        (RUN, {"Re": 150}, {"appearances": ["three"]}, "three"),
        (
            RUN,
            {"Re": 150},
            {"provenance": {"solver": object()}},
            "the provenance of member Re-150.0 must hold JSON values",
        ),
    ],
)
def test_what_is_wrong_with_a_request_is_named(
    space: ParameterSpace, parameters: Any, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        member_request(space, KNOWN, MemberArguments(parameters, **changes))


def test_names_tell_large_from_small_numbers_and_zero_has_no_sign() -> None:
    space = ParameterSpace((Parameter("k", -1e30, 1e30),))
    values = [1e18, 1e-18, -0.0, -1e18]
    names = [member_request(space, KNOWN, MemberArguments({"k": value})).name for value in values]
    assert names == ["k-1e+18", "k-1e-18", "k-0.0", "k--1e+18"]
