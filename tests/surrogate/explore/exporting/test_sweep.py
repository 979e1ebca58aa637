from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from surrogate.explore.exporting.sweep import Axis, Sweep, axis_of, check, pictures, settings
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from tests.support.models import following, plain

CAMERA = Camera.look_at((3.0, 4.0, 1.0), (0, 0, 0), vertical_fov_degrees=31.0, width=20, height=16)
BASE = Setting({"p": 0.5}, {"c1_value": 0.1}, "viridis")
BACKGROUND = (0.25, 0.5, 0.75)


def test_one_parameter_takes_values_at_equal_distances_from_end_to_end() -> None:
    shown = settings(Sweep(BASE, Axis("p", 0.0, 1.0, 5)))
    assert [s.parameters for s in shown] == [{"p": value} for value in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert all(s.visualization == BASE.visualization and s.color_map == "viridis" for s in shown)
    assert BASE.parameters == {"p": 0.5}


def test_a_visualization_parameter_may_vary_also_one_that_the_base_leaves_out() -> None:
    shown = settings(Sweep(BASE, Axis("c2_opacity", -0.2, 0.2, 3)))
    assert [s.visualization for s in shown] == [{"c1_value": 0.1, "c2_opacity": v} for v in (-0.2, 0.0, 0.2)]


def test_two_parameters_make_a_grid_row_by_row() -> None:
    sweep = Sweep(BASE, Axis("c1_value", 0.0, 0.2, 3), Axis("p", 0.0, 1.0, 2))
    places = [(s.parameters["p"], s.visualization["c1_value"]) for s in settings(sweep)]
    assert places == [(0.0, 0.0), (0.0, 0.1), (0.0, 0.2), (1.0, 0.0), (1.0, 0.1), (1.0, 0.2)]
    assert len(sweep) == len(places)


def test_pictures_are_those_of_the_settings_and_drawn_when_asked_for() -> None:
    surrogate, told = following(), []
    sweep = Sweep(BASE, Axis("p", 0.0, 1.0, 3))
    drawn = pictures(sweep, surrogate, CAMERA, BACKGROUND, progress=lambda *counts: told.append(counts))
    assert told == []
    for i, setting in enumerate(settings(sweep), start=1):
        expected = setting.member(surrogate).render(CAMERA, background=BACKGROUND)[..., :3]
        np.testing.assert_array_equal(next(drawn), expected)
        assert told[-1] == (i, 3)
    assert next(drawn, None) is None


def test_what_progress_raises_ends_the_sweep() -> None:
    class Enough(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise Enough

    drawn = pictures(Sweep(BASE, Axis("p", 0.0, 1.0, 200)), following(), CAMERA, BACKGROUND, progress=stop)
    with pytest.raises(Enough):
        list(drawn)


@pytest.mark.parametrize(
    ("axis", "complaint"),
    [
        (("p", 0.0, 1.0, 1), "over p has 2 to 200 steps, got 1: choose"),
        (("p", 0.0, 1.0, 201), "over p has 2 to 200 steps, got 201: choose"),
        (("p", 1.0, 1.0, 3), "over p goes from a finite value to a larger one, got 1 to 1"),
        (("p", 1.0, 0.0, 3), "got 1 to 0"),
        (("p", 0.0, math.inf, 3), "got 0 to inf"),
        (("p", math.nan, 1.0, 3), "got nan to 1"),
        (("", 0.0, 1.0, 3), "over a parameter that is a number, got ''"),
    ],
)
def test_wrong_axes_are_named(axis: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Axis(*axis)


def test_too_many_pictures_are_refused() -> None:
    with pytest.raises(ValueError, match="at most 400 pictures, got 420: choose fewer steps"):
        Sweep(BASE, Axis("p", 0, 1, 21), Axis("c1_value", 0, 1, 20))
    with pytest.raises(ValueError, match="two different parameters, got p twice"):
        Sweep(BASE, Axis("p", 0, 1, 2), Axis("p", 0, 1, 2))
    large = CAMERA.resized(1024, 1024)
    with pytest.raises(
        ValueError, match=r"200 pictures of 1024x1024 are more than .* pixels: choose fewer steps or smaller"
    ):
        pictures(Sweep(BASE, Axis("p", 0, 1, 200)), following(), large, BACKGROUND)


@pytest.mark.parametrize(
    ("axis", "complaint"),
    [
        (Axis("q", 0.0, 1.0, 3), r"can't be shown at q = 0: .*unknown q"),
        (Axis("c1_value", 0.0, 1.1, 3), r"can't be shown at c1_value = 1.1: opacity_points must have strictly"),
        (Axis("c1_opacity", 0.0, 0.74, 3), r"can't be shown at c1_opacity = 0.74: opacity_points must have"),
        (Axis("c1_opacity", 0.0, 5.0, 3), r"can't be shown at c1_opacity = 5: c1_opacity = 5 lies too far outside"),
        (Axis("isovalue", 0.3, 0.5, 3), r"can't be shown at isovalue = 0.3: .* belong to different variations"),
    ],
)
def test_what_the_surrogate_can_not_show_is_told_before_anything_is_drawn(axis: Axis, complaint: str) -> None:
    base = Setting({"p": 0.5}, {"c1_value": 0.1})
    with pytest.raises(ValueError, match=complaint):
        pictures(Sweep(base, axis), following(), CAMERA, BACKGROUND)
    grid = Sweep(base, Axis("p", 0.0, 1.0, 2), axis)
    with pytest.raises(ValueError, match=r"at p = 0, (q|c1_value|c1_opacity|isovalue) = "):
        check(grid, following())


def test_labels_tell_all_values_apart() -> None:
    assert Axis("Re", 1500, 2500, 3).labels == ["Re = 1500", "Re = 2000", "Re = 2500"]
    assert Axis("time", 0, 1, 4, "s").labels == ["time = 0 s", "time = 0.3333 s", "time = 0.6667 s", "time = 1 s"]
    assert Axis("Re", 1500, 1500.5, 3).labels == ["Re = 1500", "Re = 1500.25", "Re = 1500.5"]
    assert len(set(Axis("Re", 1.0, 1.0 + 1e-13, 5).labels)) == 5


def test_an_axis_goes_over_the_bounds_of_its_parameter_or_to_other_ends() -> None:
    run = Run("following", following())
    assert axis_of(run, "p", 5) == Axis("p", 0.0, 1.0, 5)
    assert axis_of(run, "p", 5, -0.5, 0.25) == Axis("p", -0.5, 0.25, 5)
    assert axis_of(run, "isovalue", 2).low == 0.1
    assert (axis_of(run, "c2_value", 2).high, axis_of(run, "c2_value", 2).origin) == (0.4, 2.0)
    with pytest.raises(ValueError, match="lies too far outside its bounds"):
        axis_of(run, "p", 5, 0.0, 9.0)
    with pytest.raises(ValueError, match=r"unknown parameter 'isovalue': this surrogate has p$"):
        axis_of(Run("plain", plain()), "isovalue", 2)
