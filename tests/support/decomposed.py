"""Fields cut into blocks, drawn block by block in one process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native.ray_casting.functions import drawn_range
from render.blocks import ABOVE, BELOW, Block, Lattice, footprint
from render.compositing import nearest, over
from render.grids import Grid
from render.isosurface import SUPERSAMPLING, box_average
from render.layers import BlockRenderer
from render.partition import Piece, front_to_back, pieces_of, space_partition


def kd_boxes(shape: tuple[int, ...], count: int, rng: np.random.Generator) -> list[Piece]:
    """Uneven boxes, `count` of them, that fill a lattice of this shape: the longest one is cut repeatedly, anywhere."""
    boxes = [Piece(0, (0, 0, 0), tuple(shape))]  # type: ignore[arg-type]
    while len(boxes) < count:
        boxes.sort(key=lambda box: max(np.subtract(box.stop, box.start)))
        longest = boxes.pop()
        axis = int(np.argmax(np.subtract(longest.stop, longest.start)))
        plane = int(rng.integers(longest.start[axis] + 1, longest.stop[axis]))
        boxes += longest.cut(axis, plane)
    return [Piece(owner, box.start, box.stop) for owner, box in enumerate(boxes)]


def pinwheel(size: int) -> list[Piece]:
    """Boxes that fill a cube of `size` samples so that no plane parts them without cutting one."""
    a, b = size // 3, 2 * size // 3
    bars = [
        ((0, 0, 0), (b, a, size)),
        ((a, a, 0), (size, b, a)),
        ((0, b, 0), (size, size, a)),
        ((0, a, a), (a, size, size)),
        ((b, 0, 0), (size, a, b)),
        ((b, 0, b), (size, b, size)),
        ((a, b, a), (size, size, size)),
        ((b, a, a), (size, b, b)),
        ((a, a, a), (b, b, size)),
        ((0, a, 0), (a, b, a)),
    ]
    return [Piece(owner, start, stop) for owner, (start, stop) in enumerate(bars)]


def blocks_of(grid: Grid, owned: Sequence[Piece]) -> list[Block]:
    """The blocks of a grid, each with its neighbours' layers."""
    whole = Lattice(grid.shape, grid.spacing, grid.origin)
    blocks = []
    for piece in owned:
        first = np.maximum(np.array(piece.start) - BELOW, 0)
        last = np.minimum(np.array(piece.stop) + ABOVE, grid.shape)
        part = tuple(map(slice, first, last))
        holes = None if grid.holes is None else np.ascontiguousarray(grid.holes[part])
        start = tuple(first.tolist())
        here = Grid(np.ascontiguousarray(grid.values[part]), grid.spacing, whole.place(start), holes)  # type: ignore[arg-type]
        blocks.append(Block(here, start, piece, whole))  # type: ignore[arg-type]
    return blocks


def composited(
    grid: Grid,
    owned: Sequence[Piece],
    appearance: Appearance,
    cameras: Sequence[Camera],
    *,
    sample_distance: float | None = None,
    float_output: bool = True,
) -> Iterator[NDArray[Any]]:
    """Pictures as `render_views` makes them, put together from those of the blocks."""
    blocks = blocks_of(grid, owned)
    whole, tree = blocks[0].whole, space_partition(list(owned))
    volume = isinstance(appearance, VolumeRendering)
    drawn = drawn_range(grid.range, appearance.transfer_function) if volume else None  # type: ignore[union-attr]
    with ExitStack() as opened:
        renderers = [
            opened.enter_context(BlockRenderer(b, appearance, sample_distance=sample_distance, value_range=drawn))
            for b in blocks
        ]
        for camera in cameras:
            if volume:
                eye = whole.index(camera.position)
                layers = [
                    renderers[p.owner].layer(camera, p, *footprint(whole, p, camera)) for p in front_to_back(tree, eye)
                ]
                image = over(layers, camera.height, camera.width)
                yield image if float_output else np.rint(255 * image).astype(np.uint8)
            else:
                large = camera.resized(SUPERSAMPLING * camera.width, SUPERSAMPLING * camera.height)
                layers = [
                    renderers[p.owner].layer(camera, p, *footprint(whole, p, large), float_output=float_output)
                    for p in owned
                ]
                dtype = "float32" if float_output else "uint8"
                yield box_average(nearest(layers, large.height, large.width, dtype), SUPERSAMPLING)


__all__ = ["blocks_of", "composited", "kd_boxes", "pieces_of", "pinwheel"]
