"""The order of blocks, against an oracle that walks along rays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from render.partition import Piece, Plane, front_to_back, pieces_of, space_partition
from tests.support.decomposed import kd_boxes, pinwheel


def seen_along(pieces, eye, direction, shape):
    """The pieces that a ray meets, in its order, by many small steps; cells belong to their first sample's."""
    met = []
    for distance in np.linspace(0.0, 4.0 * max(shape), 4001):
        index = np.floor(eye + distance * direction)
        if ((index < 0) | (index >= shape)).any():
            continue
        found = [
            n for n, p in enumerate(pieces) if all(a <= i < b for a, i, b in zip(p.start, index, p.stop, strict=True))
        ]
        assert len(found) == 1, f"{index} lies in {len(found)} pieces"
        if not met or met[-1] != found[0]:
            met.append(found[0])
    return met


def samples_of(pieces, shape):
    """The number of pieces that own each sample."""
    counts = np.zeros(shape, dtype=int)
    for piece in pieces:
        counts[tuple(map(slice, piece.start, piece.stop))] += 1
    return counts


@given(seed=st.integers(0, 10**6), count=st.integers(1, 24))
@settings(max_examples=60, deadline=None)
def test_kd_blocks_are_not_cut_and_come_in_the_order_of_every_ray(seed, count) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(9, 40, 3).tolist())
    boxes = kd_boxes(shape, count, rng)
    tree = space_partition(boxes)
    assert sorted(p.owner for p in pieces_of(tree)) == list(range(count))
    eye = rng.uniform(-1.0, 2.0, 3) * shape  # also within the box
    ordered = list(front_to_back(tree, eye))
    direction = rng.normal(size=3)
    met = seen_along(ordered, eye, direction / np.linalg.norm(direction), shape)
    assert met == sorted(met)


@pytest.mark.parametrize("size", [9, pytest.param(30, marks=pytest.mark.slow)])
def test_blocks_that_hide_one_another_in_a_circle_are_cut(size) -> None:
    boxes = pinwheel(size)
    shape = (size,) * 3
    assert (samples_of(boxes, shape) == 1).all()
    tree = space_partition(boxes)
    pieces = pieces_of(tree)
    assert len(boxes) < len(pieces) <= len(boxes) + 6
    assert (samples_of(pieces, shape) == 1).all()
    assert all(
        np.all(np.array(boxes[p.owner].start) <= p.start) and np.all(np.array(p.stop) <= boxes[p.owner].stop)
        for p in pieces
    )
    rng = np.random.default_rng(3)
    for _ in range(40):
        eye = rng.normal(size=3) * 4 * size
        ordered = list(front_to_back(tree, eye))
        towards = rng.uniform(0, size, 3) - eye
        met = seen_along(ordered, eye, towards / np.linalg.norm(towards), shape)
        assert met == sorted(met)


def test_one_piece_needs_no_plane_and_two_need_one() -> None:
    lower, upper = Piece(0, (0, 0, 0), (4, 8, 8)).cut(0, 3)
    assert space_partition([lower]) == lower
    assert space_partition([upper, lower]) == Plane(0, 3, lower, upper)
    assert [p.start[0] for p in front_to_back(Plane(0, 3, lower, upper), np.array([3.0, 0.0, 0.0]))] == [3, 0]
