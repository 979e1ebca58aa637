"""A surrogate in a notebook: facts, a picture, and never an exception."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catalogs.files.images import read_image
from catalogs.store.notebook.cards import on_background
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate import Surrogate
from surrogate.model import DeformedGaussians
from surrogate.notebook import WIDTH, first_camera
from tests.support.cards import Tags, images
from tests.support.field_blobs import FUNCTION, ISOVALUE
from tests.support.surrogates import some_surrogate
from tests.support.visualizations import base, of_functions, of_isovalue, surrogate

MIDDLE = {"Re": 2000.0, "time": 1.0}


def shown_pixels(html: str, folder: Any) -> np.ndarray:
    """The only picture of a piece of HTML, [H, W, 3]."""
    (file,) = images(html)
    (folder / "shown.png").write_bytes(file)
    return read_image(folder / "shown.png")[..., :3]


def test_a_surrogate_says_what_it_is() -> None:
    training = {"seconds": 61.4, "steps": 21000, "appearance": "dvr"}
    text = Tags(replace(some_surrogate(12), training=training)._repr_html_()).text
    for fact in (
        "Re from 1500 to 2500",
        "time from 0 to 2 s",
        "30, colours depend on the direction",
        "bilinear",
        "MB",
        "21,000 steps in 61 s on pictures of dvr",
        "at Re 2000, time 1",
    ):
        assert fact in text


def test_its_picture_is_at_the_middle_of_the_parameters_on_its_background(tmp_path: Any) -> None:
    made = some_surrogate()
    picture = made.at(**MIDDLE).render(first_camera(made.normalization), background=made.background)
    np.testing.assert_array_equal(shown_pixels(made._repr_html_(), tmp_path), on_background(picture))
    assert np.ptp(on_background(picture), axis=(0, 1)).max() > 50  # there is something to see


def test_all_of_the_box_is_seen() -> None:
    normalization = some_surrogate().normalization
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    pixels, depth = first_camera(normalization).project(normalization.center + normalization.extent * corners)
    assert (depth > 0).all()
    assert (pixels > 0).all()
    assert (pixels < WIDTH).all()


def test_what_it_follows_is_said() -> None:
    fitted = base()
    both = surrogate(fitted, of_isovalue(fitted), of_functions(fitted))
    text = Tags(both._repr_html_()).text
    (isovalue,) = ISOVALUE.space.parameters
    assert f"isovalue from {isovalue.low:g} to {isovalue.high:g}" in text
    low, high = FUNCTION.bounds
    assert f"any transfer function over field values {low:g} to {high:g}" in text


def test_gaussians_at_some_parameters_say_which(tmp_path: Any) -> None:
    deformed = some_surrogate().at(Re=1830.0, time=0.5)
    html = deformed._repr_html_()
    assert "Re1830time0.5Gaussians30" in Tags(html).text
    picture = on_background(deformed.render(first_camera(deformed.normalization)))
    np.testing.assert_array_equal(shown_pixels(html, tmp_path), picture)


def test_hostile_names_are_only_names() -> None:
    space = ParameterSpace((Parameter("<script>", 0.0, 1.0), Parameter("'\"&", 0.0, 1.0, "<b>")))
    made = replace(some_surrogate(), space=space, training={"appearance": "<i>"})
    for shown in (made, made.at(**{"<script>": 0.5, "'\"&": 0.5})):
        tags = Tags(shown._repr_html_())
        assert {"script", "b", "i"}.isdisjoint(tag for tag, _ in tags.seen)
        assert "<script>" in tags.text


def test_without_a_picture_the_facts_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("no <kernels>")

    monkeypatch.setattr(DeformedGaussians, "render", fail)
    text = Tags(some_surrogate()._repr_html_()).text
    assert "Re from 1500 to 2500" in text
    assert "no picture: RuntimeError: no <kernels>" in text
    assert "can't be shown" in Tags(some_surrogate().at(**MIDDLE)._repr_html_()).text


def test_odd_records_do_not_raise() -> None:
    made = some_surrogate()
    assert "trained" not in Tags(made._repr_html_()).text
    assert "can't be shown" in Tags(replace(made, training={"steps": "many", "seconds": 1})._repr_html_()).text
    one = Surrogate(made.gaussians, made.deformation, ParameterSpace(()), made.normalization, made.rasterizer)
    assert "30" in Tags(one._repr_html_()).text


def test_it_is_shown_at_once() -> None:
    made, seconds = some_surrogate(), []
    for _ in range(3):
        started = time.process_time()
        made._repr_html_()
        seconds.append(time.process_time() - started)
    assert min(seconds) < 0.3
