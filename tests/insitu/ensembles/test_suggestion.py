"""Suggested transfer functions: they parse, leave the background clear and reach the wanted opacity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.plan import name_problem
from insitu.ensembles.probe import probe_fields
from insitu.ensembles.suggestion import appearance_names, contact_sheet, suggest
from insitu.members.planning import appearances_from_toml
from render import to_grid


def shell(background: float, seed: int = 0):
    """A noisy background with a ball of rare values in it."""
    random = np.random.default_rng(seed)
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, 20)] * 3, indexing="ij")
    values = background + 0.02 * random.standard_normal(x.shape)
    radius = np.sqrt(x**2 + y**2 + z**2)
    values[radius < 0.6] = 5.0 + 3.0 * radius[radius < 0.6]
    return to_grid(values, spacing=0.1)


@pytest.mark.parametrize("alpha", [0.3, 0.6])
def test_it_reaches_the_wanted_alpha_and_parses(tmp_path: Path, alpha: float) -> None:
    grids = [shell(1.0), shell(1.5)]
    found = suggest(probe_fields(grids), grids, alpha=alpha)
    assert np.mean(found.alphas) == pytest.approx(alpha, abs=0.03)
    path = tmp_path / "appearance.toml"
    path.write_text(found.toml())
    assert appearances_from_toml(path) == (found.appearance,)


def test_what_fills_one_member_stays_clear_in_all() -> None:
    grids = [shell(1.0), *(shell(2.0, seed) for seed in range(1, 9))]  # 1.0 is rare over all members
    function = suggest(probe_fields(grids), grids).appearance.transfer_function
    assert function.opacities([1.0, 2.0]).max() < 0.005
    assert function.opacities([5.5, 6.5]).min() > 0.2


@pytest.mark.parametrize("value", [0.0, -7.0])
def test_a_constant_field_gets_a_range_around_it(value: float) -> None:
    grids = [to_grid(np.full((4, 4, 4), value))]
    low, high = suggest(probe_fields(grids), grids).appearance.transfer_function.bounds
    assert low < value < high


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e8])
def test_it_does_not_depend_on_units(scale: float) -> None:
    grids = [to_grid(scale * shell(1.0).values, spacing=0.1)]
    function = suggest(probe_fields(grids), grids).appearance.transfer_function
    reference = [shell(1.0)]
    wanted = suggest(probe_fields(reference), reference).appearance.transfer_function
    values = np.linspace(1.0, 6.8, 20)
    assert np.allclose(function.opacities(scale * values), wanted.opacities(values), atol=0.01)
    assert np.allclose(function.colors(scale * values), wanted.colors(values), atol=0.01)


def test_alpha_must_be_a_fraction() -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        suggest(probe_fields([shell(1.0)]), [shell(1.0)], alpha=1.5)


def test_the_contact_sheet_is_opaque_white_around_the_members() -> None:
    grids = [shell(1.0), shell(2.0)]
    sheet = contact_sheet(grids, suggest(probe_fields(grids), grids).appearance, size=32)
    assert sheet.shape == (64, 160, 4)
    assert (sheet[..., 3] == 255).all()
    assert (sheet[0, 0] == 255).all()
    assert sheet[..., :3].min() < 200


def test_appearances_are_called_like_their_fields_and_no_two_alike() -> None:
    fields = ["q", "a b", "a-b", "a-b-2", "α", "β", "x" * 200, "x" * 201]
    names = appearance_names(fields)
    assert list(names) == fields
    assert list(names.values())[:4] == ["dvr-q", "dvr-a-b", "dvr-a-b-2", "dvr-a-b-2-2"]
    assert len(set(names.values())) == len(fields)
    assert all(name_problem(name) is None for name in names.values())
