"""Many pictures at once are what single calls give, bit for bit."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera, orbit
from surrogate import Surrogate
from surrogate.rasterizer import Rasterizer
from surrogate.splatting.threads import one_torch_thread
from tests.support.field_blobs import BLOBS, FUNCTION
from tests.support.surrogates import CENTER, EXTENT, some_surrogate
from tests.support.visualizations import base, of_functions, of_isovalue, surrogate

CAMERAS = orbit(CENTER, EXTENT, width=12, height=9, frequency=1)[:6]
ROWS = np.array([[1500.0, 0.0], [2500.0, 2.0], [1830.0, 0.4], [1500.0, 0.0], [2000.0, 1.0], [1600.0, 0.1]])


def fast(count: int = 30) -> Surrogate:
    return replace(some_surrogate(12, count), rasterizer=Rasterizer())


def varied() -> Surrogate:
    fitted = base()
    return surrogate(fitted, of_isovalue(fitted, 1), of_functions(fitted))


def singly(model: Surrogate, rows: Any, cameras: Any, **options: Any) -> np.ndarray:
    return np.stack([model.at(**row).render(view, **options) for row, view in zip(rows, cameras, strict=True)])


@pytest.mark.parametrize("backend", ["auto", "reference"])
@pytest.mark.parametrize("background", [None, (1.0, 0.5, 0.0)])
def test_a_batch_is_what_single_calls_give(backend: str, background: Any) -> None:
    model = replace(fast(), rasterizer=Rasterizer(backend=backend))
    expected = singly(model, [{"Re": a, "time": b} for a, b in ROWS], CAMERAS, background=background)
    found = model.render(ROWS, CAMERAS, background=background)
    assert (found.dtype, found.shape) == (np.float32, (6, 9, 12, 4))
    assert expected[..., :3].max() > 0.1
    np.testing.assert_array_equal(found, expected)


@pytest.mark.slow
def test_it_is_the_same_with_more_gaussians_than_one_thread_takes() -> None:
    model = fast(20_000)
    np.testing.assert_array_equal(
        model.render(ROWS, CAMERAS), singly(model, [{"Re": a, "time": b} for a, b in ROWS], CAMERAS)
    )


FORMS = [
    pytest.param(ROWS.tolist(), id="lists"),
    pytest.param(torch.from_numpy(ROWS).requires_grad_(), id="tensor"),
    pytest.param(ROWS.astype(object), id="objects"),
    pytest.param({"time": ROWS[:, 1], "Re": ROWS[:, 0].tolist()}, id="mapping of arrays"),
    pytest.param([{"Re": a, "time": b} for a, b in ROWS], id="list of mappings"),
]


@pytest.mark.parametrize("form", FORMS)
def test_parameters_come_in_several_forms(form: Any) -> None:
    model = fast()
    np.testing.assert_array_equal(model.render(form, CAMERAS), model.render(ROWS, CAMERAS))


def test_one_camera_or_one_member_is_taken_for_all() -> None:
    model = fast()
    np.testing.assert_array_equal(model.render(ROWS, CAMERAS[2]), model.render(ROWS, [CAMERAS[2]] * 6))
    np.testing.assert_array_equal(model.render(ROWS[:1], CAMERAS), model.render(ROWS[[0] * 6], CAMERAS))
    np.testing.assert_array_equal(model.render({"Re": 1500.0, "time": 0.0}, CAMERAS), model.render(ROWS[:1], CAMERAS))
    assert model.render(ROWS[:1], CAMERAS[0]).shape == (1, 9, 12, 4)
    assert model.render(ROWS[:0], CAMERAS[0]).shape == (0, 9, 12, 4)


def test_visualization_parameters_are_given_by_name() -> None:
    model, cameras = varied(), BLOBS.cameras()[:3]
    rows: list[dict[str, Any]] = [{"p": 0.3, "isovalue": 0.2}, {"p": 0.1, "c1_value": 0.1}, {"p": 0.3}]
    np.testing.assert_array_equal(model.render(rows, cameras), singly(model, rows, cameras))
    same = model.render({"p": [0.1, 0.3, 0.5], "isovalue": 0.2}, cameras)
    np.testing.assert_array_equal(same, singly(model, [{"p": p, "isovalue": 0.2} for p in (0.1, 0.3, 0.5)], cameras))
    under = model.render([[0.1], [0.2], [0.3]], cameras, transfer_function=FUNCTION)
    np.testing.assert_array_equal(under[1], model.under(FUNCTION, p=0.2).render(cameras[1]))


WIDE = Camera.look_at(CENTER + 100.0, CENTER, vertical_fov_degrees=30, width=16, height=9)
WRONG = [
    (ROWS[:, :1], CAMERAS[0], r"shape \(B, 2\), with columns Re, time, got shape \(6, 1\)"),
    (ROWS[0], CAMERAS[0], r"shape \(B, 2\)"),
    (1500.0, CAMERAS[0], r"shape \(B, 2\)"),
    ([[1500.0], [1500.0, 1.0]], CAMERAS[0], "must be numbers"),
    ({"Re": [1500.0, 1600.0], "time": [0.0, 1.0, 2.0]}, CAMERAS[0], r"as many values each, .*'Re': 2, 'time': 3"),
    ({"Re": ROWS, "time": 1.0}, CAMERAS[0], r"parameter Re must be one value or \(B,\) values"),
    ({"Re": [1500.0]}, CAMERAS[0], r"missing time"),
    ([{"Re": 1500.0, "time": 0.0}, 3], CAMERAS[0], "must be mappings all"),
    ([[math.nan, 1.0]], CAMERAS[0], "Re must be"),
    ([[1e9, 1.0]], CAMERAS[0], "too far outside its bounds"),
    (ROWS, CAMERAS[:4], "one for each of 6 rows of parameters, got 4"),
    (ROWS, [], "cameras must be one or more"),
    (ROWS, ["front"], "got str"),
    (ROWS[:2], [CAMERAS[0], WIDE], "same image size"),
]


@pytest.mark.parametrize(("parameters", "cameras", "complaint"), WRONG, ids=[c[:40] for _, _, c in WRONG])
def test_what_does_not_fit_is_named(parameters: Any, cameras: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        fast().render(parameters, cameras)


def test_values_out_of_bounds_are_told_once() -> None:
    rows = [[2600.0 + k, 1.0] for k in range(6)]
    with pytest.warns(UserWarning, match="outside") as caught:
        fast().render(rows, CAMERAS)
    assert [w.filename for w in caught] == [__file__] * 4
    assert "and 3 more" in str(caught[-1].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fast().render(rows, CAMERAS, outside="allow")


def test_torch_keeps_its_threads() -> None:
    before = torch.get_num_threads()
    fast().render(ROWS, CAMERAS)
    assert torch.get_num_threads() == before
    with one_torch_thread():
        fast().render(ROWS, CAMERAS)
        assert torch.get_num_threads() == 1
