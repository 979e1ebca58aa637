"""Places of blocks, and the parts of an image where they are visible."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catalogs.vocabulary.cameras import Camera, orbit
from render.blocks import Lattice, footprint, region
from render.partition import Piece
from tests.support.decomposed import kd_boxes

WHOLE = Lattice((12, 20, 16), (0.1, 0.2, 0.3), (5.0, -2.0, 1e3))


def test_index_and_place_are_inverse_and_the_bounds_reach_from_the_first_to_the_last_sample() -> None:
    np.testing.assert_allclose(WHOLE.index(np.array(WHOLE.place((3, 7, 11)))), [3, 7, 11], atol=1e-9)
    low, high = WHOLE.bounds
    np.testing.assert_allclose(low, WHOLE.place((0, 0, 0)))
    np.testing.assert_allclose(high, WHOLE.place((11, 19, 15)))


def test_the_space_of_pieces_joins_and_ends_with_the_last_sample() -> None:
    first, second = Piece(0, (0, 0, 0), (12, 20, 16)).cut(2, 6)
    assert region(WHOLE, first)[1][0] == region(WHOLE, second)[0][0]
    np.testing.assert_allclose(region(WHOLE, second)[1], WHOLE.bounds[1])


def test_a_piece_that_begins_with_the_last_sample_has_no_space() -> None:
    low, high = region(WHOLE, Piece(0, (11, 0, 0), (12, 20, 16)))
    assert low[2] == high[2]


@given(seed=st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_a_piece_is_seen_in_its_footprint_alone(seed) -> None:
    rng = np.random.default_rng(seed)
    low, high = WHOLE.bounds
    camera = orbit((low + high) / 2, float(np.linalg.norm(high - low)) / 2, width=61, height=47)[int(rng.integers(252))]
    for piece in kd_boxes(WHOLE.shape, 5, rng):
        rows, columns = footprint(WHOLE, piece, camera)
        points = rng.uniform(*region(WHOLE, piece), size=(200, 3))
        pixels, _ = camera.project(points)
        inside = ((pixels >= 0) & (pixels <= [camera.width, camera.height])).all(axis=1)
        x, y = pixels[inside].T
        assert ((x >= columns.start) & (x <= columns.stop) & (y >= rows.start) & (y <= rows.stop)).all()


@pytest.mark.parametrize("behind", [False, True])
def test_a_camera_within_or_before_a_piece_sees_it_anywhere_or_nowhere(behind) -> None:
    piece = Piece(0, (0, 0, 0), (12, 20, 16))
    low, high = WHOLE.bounds
    center = (low + high) / 2
    eye = center if not behind else center + np.array([1e3, 0, 0])
    camera = Camera.look_at(eye, eye + np.array([1.0, 0.0, 0.0]), width=30, height=20, vertical_fov_degrees=60)
    rows, columns = footprint(WHOLE, piece, camera)
    assert (rows, columns) == (slice(0, 20), slice(0, 30))
