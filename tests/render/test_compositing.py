"""Layers put together, against sums written out."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from render.compositing import PictureLayer, nearest, over, packed, unpacked


def layer(rows, columns, pixel, depth=None):
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    image = np.broadcast_to(np.array(pixel), (*shape, 4)).astype(np.uint8 if depth is not None else np.float32)
    return PictureLayer(rows, columns, image, None if depth is None else np.full(shape, depth, dtype=np.float32))


def test_volumes_lie_one_behind_the_other() -> None:
    front = layer(slice(0, 2), slice(0, 3), (0.2, 0.1, 0.0, 0.5))
    back = layer(slice(1, 4), slice(1, 5), (0.0, 0.4, 0.8, 0.8))
    image = over([front, back], 4, 5)
    assert image.dtype == np.float32
    np.testing.assert_allclose(image[0, 0], [0.2, 0.1, 0.0, 0.5])
    np.testing.assert_allclose(image[1, 1], [0.2, 0.3, 0.4, 0.9], rtol=1e-6)
    np.testing.assert_allclose(image[3, 4], [0.0, 0.4, 0.8, 0.8])
    assert not image[3, 0].any()
    np.testing.assert_allclose(over([back, front], 4, 5)[1, 1], [0.04, 0.42, 0.8, 0.9], rtol=1e-6)


def test_rounding_never_makes_more_than_one() -> None:
    half = layer(slice(0, 1), slice(0, 1), (0.7, 0.7, 0.7, 0.7000001))
    assert over([half] * 40, 1, 1).max() <= 1.0


def test_of_surfaces_the_nearest_is_seen_in_whatever_order() -> None:
    near = layer(slice(0, 2), slice(0, 2), (9, 9, 9, 255), 0.25)
    far = layer(slice(0, 3), slice(1, 3), (5, 5, 5, 255), 0.5)
    for layers in ([near, far], [far, near]):
        image = nearest(layers, 3, 3, "uint8")
        assert image.dtype == np.uint8
        assert image[..., 0].tolist() == [[9, 9, 5], [9, 9, 5], [0, 5, 5]]


def test_no_layers_are_an_empty_picture() -> None:
    assert not over([], 2, 3).any()
    assert nearest([], 2, 3, "float32").shape == (2, 3, 4)


@given(
    seed=st.integers(0, 10**6),
    height=st.integers(0, 7),
    width=st.integers(0, 11),
    share=st.sampled_from([0.0, 0.3, 1.0]),
    dtype=st.sampled_from(["uint8", "float32"]),
    surfaces=st.booleans(),
)
def test_layers_are_the_same_after_they_were_sent(seed, height, width, share, dtype, surfaces) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(1, 255, (height, width, 4)).astype(dtype)
    hidden = rng.random((height, width)) >= share
    image[hidden] = 0
    depths = np.where(hidden, 1.0, rng.random((height, width))).astype(np.float32) if surfaces else None
    layer = PictureLayer(slice(3, 3 + height), slice(5, 5 + width), image, depths)
    sent = np.concatenate([packed(layer), packed(layer), np.array([7], dtype=np.uint8)])
    first, left = unpacked(sent, layer.rows, layer.columns, dtype, surfaces=surfaces)
    second, left = unpacked(left, layer.rows, layer.columns, dtype, surfaces=surfaces)
    assert left.tolist() == [7]
    for found in (first, second):
        np.testing.assert_array_equal(found.image, image)
        assert found.image.dtype == image.dtype
        if depths is not None:
            np.testing.assert_array_equal(found.depths, depths)
