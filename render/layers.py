"""Pictures of one block of a grid that is spread over several processes."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from render.blocks import Block, Lattice, region
from render.compositing import PictureLayer
from render.isosurface import SUPERSAMPLING, surface_scene
from render.partition import Piece
from render.placement import Placement
from render.shaders import tell_rays
from render.views import check_size
from render.volume import volume_scene
from render.window import aim, open_window

BEYOND = 4.0  # local units: further than any corner of the unit sphere's box


class BlockRenderer:
    """Draws what a block adds to pictures of the whole: upload or extract once, draw many views, free on exit.

    Volumes take the same samples along the same rays as one process that has the whole.  Each sample is taken by the block in whose
    space it lies, half-open, so none is lost or doubled.  `value_range` is the whole's `native.ray_casting.functions.drawn_range`.
    """

    def __init__(
        self,
        block: Block,
        appearance: Appearance,
        *,
        sample_distance: float | None = None,
        value_range: tuple[float, float] | None = None,
    ) -> None:
        self._block, self._window = block, open_window()
        self._placement = Placement.of(block.grid, block.whole)
        self._shader: Any = None
        if isinstance(appearance, VolumeRendering):
            self._scene = volume_scene(
                block.grid, appearance, self._placement, sample_distance, value_range=value_range, block=True
            )
            self._shader = self._scene.GetVolumes().GetItemAsObject(0).GetShaderProperty()
        elif isinstance(appearance, Isosurface):
            self._scene = surface_scene(block.grid, appearance, self._placement, _not_owned(block))
        else:
            raise TypeError(
                f"{type(appearance).__name__} {appearance.name!r} cannot be rendered from blocks of a field"
            )
        if self._scene is not None:
            self._window.add(self._scene)

    def layer(
        self, camera: Camera, piece: Piece, rows: slice, columns: slice, *, float_output: bool = False
    ) -> PictureLayer:
        """The layer that `piece` of the block adds to the `rows` and `columns` of the image that `camera` takes of the whole.

        Volumes are float32.  Surfaces are those of the whole block, uint8 or with `float_output` float32, with their depths, drawn
        at `SUPERSAMPLING` times the picture's size, for which rows and columns count.
        """
        height, width = rows.stop - rows.start, columns.stop - columns.start
        if self._scene is None or not (height and width):
            return _nothing(rows, columns, self._shader is not None, float_output)
        factor = 1 if self._shader is not None else SUPERSAMPLING
        check_size(camera, factor, self._window.longest_side)
        local = self._placement.camera(camera).resized(factor * camera.width, factor * camera.height)
        aim(self._scene, local, *self._placement.clipping_range(local))
        if self._shader is None:
            image, depths = self._window.draw_with_depths(
                self._scene, local.width, local.height, float_output=float_output
            )
            return PictureLayer(rows, columns, image[rows, columns], depths[rows, columns])
        low, high = owned_space(self._block.whole, piece, self._placement)
        tell_rays(self._shader, local, low, high)
        image = self._window.draw(self._scene, local.width, local.height, float_output=True, once=True)
        return PictureLayer(rows, columns, image[rows, columns])

    def close(self) -> None:
        """Free the volume or surface, here and in graphics memory."""
        if self._scene is not None:
            self._window.remove(self._scene)
            self._scene = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def owned_space(whole: Lattice, piece: Piece, placement: Placement) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(low, high) corners (3,), local units, of the space whose samples are a piece's; without end where the whole ends."""
    low, high = map(placement.local, region(whole, piece))
    ends = np.array(piece.stop[::-1]) >= np.array(whole.shape[::-1]) - 1  # [3], x, y, z
    starts = np.array(piece.start[::-1]) == 0
    none = np.array(piece.start[::-1]) >= np.array(whole.shape[::-1]) - 1
    return np.where(starts, -BEYOND, low), np.where(ends & ~none, BEYOND, high)


def _not_owned(block: Block) -> NDArray[np.bool_]:
    """True if each grid cell of a block, by its first corner, begins at a sample that is another's."""
    owned = tuple(
        slice(start - first, stop - first)
        for start, stop, first in zip(block.owned.start, block.owned.stop, block.first, strict=True)
    )
    others = np.ones(block.grid.shape, dtype=bool)
    others[owned] = False
    return others


def _nothing(rows: slice, columns: slice, volume: bool, float_output: bool) -> PictureLayer:
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    image: NDArray[Any] = np.zeros((*shape, 4), dtype=np.float32 if volume or float_output else np.uint8)
    return PictureLayer(rows, columns, image, None if volume else np.ones(shape, dtype=np.float32))
