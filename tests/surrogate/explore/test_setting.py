"""Settings are drawn by several threads at once, and silently where they lie out of bounds."""

from __future__ import annotations

import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from surrogate.explore.setting import Setting
from surrogate.model import DeformedGaussians, Surrogate
from tests.support.models import following

OUTSIDE = [
    Setting({"p": 1.5}),
    Setting({"p": 0.5}, {"isovalue": 0.9}),
    Setting({"p": 0.5}, {"c2_opacity": 0.31}),
    Setting({"p": 1.5}, color_map="viridis"),
]


@pytest.mark.parametrize("setting", OUTSIDE, ids=str)
def test_values_out_of_bounds_bring_no_warning(setting: Setting) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(setting.member(following())) > 0


def test_threads_draw_at_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    surrogate, together, at = following(), threading.Barrier(3), Surrogate.at

    def meeting(self: Surrogate, *values: Any, **more: Any) -> DeformedGaussians:
        together.wait(timeout=60)  # broken unless all three are inside at once
        return at(self, *values, **more)

    monkeypatch.setattr(Surrogate, "at", meeting)
    settings = [Setting({"p": p}) for p in (0.0, 0.5, 1.5)]
    with ThreadPoolExecutor(3) as pool:
        drawn = list(pool.map(lambda setting: setting.member(surrogate), settings))
    for setting, gaussians in zip(settings, drawn, strict=True):
        np.testing.assert_array_equal(gaussians.means, at(surrogate, outside="allow", **setting.parameters).means)
