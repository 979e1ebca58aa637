"""Columns of parameters whose names have another meaning in the table."""

import keyword

import pytest

from catalogs.files.cinema import header_problems, parameter_labels

OTHERS = ["appearance", "isovalue", "member", "view", "phi", "theta", "split", "member_split", "view_split", "FILE"]


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (["Re", "time"], ["Re", "time"]),
        (["theta", "phi"], ["parameter_theta", "parameter_phi"]),
        (["member", "parameter_member"], ["parameter_member_2", "parameter_member"]),
        (["profile", "FILE", "Filefile"], ["parameter_profi_le", "parameter_FI_LE", "parameter_Fi_lefi_le"]),
        (["1", "nan", "1e5"], ["parameter_1", "parameter_nan", "parameter_1e5"]),
        (["a,b", 'say "so"', "ν"], ["a,b", 'say "so"', "ν"]),
    ],
)
def test_names_that_the_table_can_not_hold_are_labelled_otherwise(names: list[str], labels: list[str]) -> None:
    assert parameter_labels(names, OTHERS) == labels
    assert header_problems([*labels, *OTHERS]) == []


@pytest.mark.parametrize("name", [*OTHERS, *keyword.kwlist, *dir(object), "self", "outside", "path", "name"])
def test_any_word_has_a_label(name: str) -> None:
    assert header_problems([*parameter_labels([name, "Re"], OTHERS), *OTHERS]) == []
