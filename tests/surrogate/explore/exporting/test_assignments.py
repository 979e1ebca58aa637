import pytest

from surrogate.explore.exporting.options import _assignment

KNOWN = ("Re", "a", "a=b", " Re", "lambda", "appearance")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Re=3", ("Re", 3.0)),
        ("Re = 3", ("Re", 3.0)),
        (" Re=3", (" Re", 3.0)),
        ("a=3", ("a", 3.0)),
        ("a=b=3e2", ("a=b", 300.0)),
        ("lambda= -1", ("lambda", -1.0)),
        ("appearance=iso=1", ("appearance", "iso=1")),
        ("other=2", ("other", 2.0)),
    ],
)
def test_names_may_hold_an_equals_sign_or_a_space(text: str, expected: tuple[str, float | str]) -> None:
    assert _assignment(text, KNOWN) == expected


@pytest.mark.parametrize("text", ["Re", "Re=", "Re=many", "=3x"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="parameters are given as NAME=VALUE"):
        _assignment(text, KNOWN)
