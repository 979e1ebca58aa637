from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surrogate import Surrogate
from surrogate.explore.request import (
    FrameRequest,
    MessageError,
    camera_of,
    color_of,
    frame_request,
    setting_of,
)
from tests.support.models import following, plain
from tests.support.requests import CAMERA, WRONG, message


@pytest.fixture(scope="module")
def surrogate() -> Surrogate:
    return following()


def test_a_good_message_says_what_to_draw(surrogate: Surrogate) -> None:
    request = frame_request(message(), surrogate)
    assert isinstance(request, FrameRequest)
    assert dict(request.settings[0].parameters) == {"p": 0.25}
    assert (request.camera.width, request.camera.height) == (64, 48)
    np.testing.assert_allclose(request.camera.position, CAMERA["position"], atol=1e-12)
    assert request.camera.vertical_fov_degrees == pytest.approx(30)
    assert request.background == pytest.approx((1.0, 128 / 255, 0.0))
    assert (request.form, request.difference, request.truth) == ("png", False, False)


@pytest.mark.parametrize(
    "shown",
    [
        {"visualization": {"isovalue": 0.3}},
        {"visualization": {"c1_value": 0.1}},
        {"visualization": {"c1_value": 0.1, "c2_opacity": -0.05}, "color_map": "viridis"},
        {"color_map": "plasma"},
    ],
)
def test_every_kind_of_setting_can_be_asked_for_and_drawn(surrogate: Surrogate, shown: dict[str, Any]) -> None:
    setting = setting_of({"parameters": {"p": 0.5}, **shown}, surrogate)
    assert dict(setting.visualization) == shown.get("visualization", {})
    assert len(setting.member(surrogate)) == len(surrogate.gaussians)


def test_what_is_drawn_is_what_the_surrogate_draws(surrogate: Surrogate) -> None:
    asked = setting_of({"parameters": {"p": 0.5}, "visualization": {"isovalue": 0.3}}, surrogate)
    camera = frame_request(message(), surrogate).camera
    expected = surrogate.at(p=0.5, isovalue=0.3).render(camera)
    np.testing.assert_array_equal(asked.member(surrogate).render(camera), expected)


@pytest.mark.parametrize(("changes", "complaint"), WRONG)
def test_a_wrong_message_is_refused_in_one_sentence(
    surrogate: Surrogate, changes: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(MessageError, match=complaint.replace("(", r"\(")) as refused:
        frame_request(message(**changes), surrogate)
    assert len(str(refused.value)) < 400


@pytest.mark.parametrize("nothing", [None, 3, "x", [], b"\x00", [[]], {3: 4}])
def test_what_is_no_message_is_refused(surrogate: Surrogate, nothing: Any) -> None:
    with pytest.raises(MessageError):
        frame_request(nothing, surrogate)


def test_a_surrogate_that_follows_nothing_says_so() -> None:
    with pytest.raises(MessageError, match="no parameters"):
        setting_of({"parameters": {"p": 0.5}, "visualization": {"isovalue": 1.0}}, plain())
    with pytest.raises(MessageError, match="follows no transfer functions"):
        setting_of({"parameters": {"p": 0.5}, "color_map": "viridis"}, plain())


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5) | st.integers(), inner, max_size=4),
    max_leaves=12,
)
NAMES = st.sampled_from(["settings", "camera", "size", "background", "form", "difference", "truth"])


@pytest.mark.slow
@settings(max_examples=300)
@given(st.dictionaries(NAMES, VALUES, min_size=1))
def test_no_message_whatever_raises_anything_else(changes: dict[str, Any]) -> None:
    with contextlib.suppress(MessageError):
        frame_request(message(**changes), plain())


@given(st.tuples(*[st.floats(-5, 5)] * 3), st.tuples(*[st.floats(-1, 1)] * 3), st.floats(1, 150))
@settings(max_examples=200)
def test_a_camera_is_exactly_the_one_that_was_asked_for(position: Any, up: Any, field: float) -> None:
    record = {"position": list(position), "target": [0.0, 0.0, 0.0], "up": list(up), "field": field}
    try:
        camera = camera_of(record, [40, 30], plain())
    except MessageError:
        return
    np.testing.assert_allclose(camera.position, position, atol=1e-9)
    assert camera.vertical_fov_degrees == pytest.approx(field)


def test_colors_are_those_of_css() -> None:
    assert color_of("#FFffFF") == (1.0, 1.0, 1.0)
    assert color_of("#000000") == (0.0, 0.0, 0.0)
