"""The appearance that shows visualization parameters, also those that no setting has."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.variations.field import field_variation
from catalogs.vocabulary.variations.isovalue import isovalue_family
from catalogs.vocabulary.variations.transfer_function import transfer_function_family

FUNCTION = TransferFunction(
    ((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.0, 0.0), (0.3, 0.4), (0.6, 0.5), (1.0, 1.0)), 1.0
)
BASE = VolumeRendering("dvr", FUNCTION)


def test_every_setting_is_shown_by_its_own_appearance() -> None:
    for family in (
        isovalue_family("dvr", train=[0.2, 0.8], validation=[0.5], style={"color": [0.1, 0.2, 0.3]}),
        transfer_function_family(BASE, first_step=(0.05, 0.1), second_step=(0.05, 0.1)),
    ):
        known = (BASE, *family.appearances)
        named = {appearance.name: appearance for appearance in known}
        for setting in family.variation.settings:
            shown = family.variation.appearance_at(setting.values, known)
            expected = named[setting.appearance]
            if isinstance(shown, VolumeRendering) and isinstance(expected, VolumeRendering):
                assert shown.transfer_function == expected.transfer_function
            elif isinstance(shown, Isosurface) and isinstance(expected, Isosurface):
                assert (shown.isovalue, shown.color) == (expected.isovalue, expected.color)
            else:
                pytest.fail(f"{setting} is shown by {shown}")
        assert family.variation.appearance_at(None, known) is BASE


def test_values_between_settings_are_shown_too() -> None:
    isovalues = isovalue_family("dvr", train=[0.2, 0.8])
    shown = isovalues.variation.appearance_at((0.37,), (BASE, *isovalues.appearances))
    assert isinstance(shown, Isosurface)
    assert shown.isovalue == 0.37
    functions = transfer_function_family(BASE, first_step=(0.05, 0.1), second_step=(0.05, 0.1))
    shown = functions.variation.appearance_at((0.01, -0.02, 0.03, 0.04), (BASE, *functions.appearances))
    assert isinstance(shown, VolumeRendering)
    np.testing.assert_allclose(shown.transfer_function.opacity_points[1:3], [(0.31, 0.38), (0.63, 0.54)])


def test_other_fields_are_shown_by_their_appearances() -> None:
    speed, pressure = (VolumeRendering(name, FUNCTION) for name in ("speed", "pressure"))
    variation = field_variation("dvr", appearances=["speed", "pressure"])
    known = (BASE, speed, pressure)
    assert variation.appearance_at((0.0, 1.0), known) is pressure
    assert variation.appearance_at(None, known) is BASE
    with pytest.raises(ValueError, match="there is no appearance 'pressure', only dvr, speed"):
        variation.appearance_at((0.0, 1.0), (BASE, speed))
