"""The one call that turns a field into pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from catalogs.files.png import LARGEST_SIDE
from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.plugin_appearance import PluginAppearance
from render.backends import backend_of
from render.casting import cast_views, prepared
from render.grids import Grid
from render.isosurface import SUPERSAMPLING, box_average, surface_scene
from render.placement import Placement
from render.volume import volume_scene
from render.window import aim, open_window


class Renderer:
    """VTK's pictures of one field under one appearance: upload or extract once, draw many views, free on exit.

    `sample_distance` is for volumes (see `render.volume`), `samples` how many lie along each side of a pixel, by default as many as
    `supersampling` says.  An empty isosurface is valid: its pictures are empty.
    Raises TypeError for an appearance that is not drawn from a field.
    """

    def __init__(
        self, grid: Grid, appearance: Appearance, *, sample_distance: float | None = None, samples: int | None = None
    ) -> None:
        self._closed, self._supersampling = False, samples or supersampling(appearance)
        self._placement, self._window = Placement.of(grid), open_window()
        self._is_volume = isinstance(appearance, VolumeRendering)
        if isinstance(appearance, VolumeRendering):
            self._scene = volume_scene(grid, appearance, self._placement, sample_distance)
        elif isinstance(appearance, Isosurface):
            self._scene = surface_scene(grid, appearance, self._placement)
        else:
            raise TypeError(f"{type(appearance).__name__} {appearance.name!r} cannot be rendered from a field")
        if self._scene is not None:
            self._window.add(self._scene)

    def render(self, camera: Camera, *, float_output: bool = False) -> NDArray[Any]:
        """Premultiplied RGBA [height, width, 4], top row first: uint8, or float32 in [0, 1]."""
        if self._closed:
            raise RuntimeError("this renderer is closed")
        check_size(camera, self._supersampling, self._window.longest_side)
        if self._scene is None:
            return np.zeros((camera.height, camera.width, 4), dtype=np.float32 if float_output else np.uint8)
        width, height = self._supersampling * camera.width, self._supersampling * camera.height
        local = self._placement.camera(camera).resized(width, height)
        aim(self._scene, local, *self._placement.clipping_range(local))
        image = self._window.draw(self._scene, width, height, float_output=float_output, once=self._is_volume)
        return image if self._supersampling == 1 else box_average(image, self._supersampling)

    def close(self) -> None:
        """Free the volume or surface, here and in graphics memory."""
        self._closed = True
        if self._scene is not None:
            self._window.remove(self._scene)
            self._scene = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def supersampling(appearance: Appearance) -> int:
    """The number of pixels drawn along each side of one of an image's."""
    return SUPERSAMPLING if isinstance(appearance, Isosurface) else 1


def check_sizes(by_opengl: Iterable[Appearance], cameras: Sequence[Camera]) -> None:
    """Raise ValueError where pictures of a camera's size are larger than is drawn.

    This machine's OpenGL would leave those of appearances that it draws empty.
    """
    for camera in cameras:
        if max(camera.width, camera.height) > LARGEST_SIDE:
            raise ValueError(
                f"pictures of {camera.width} x {camera.height} pixels are too large: choose width and height up to {LARGEST_SIDE}"
            )
    factors = [supersampling(appearance) for appearance in by_opengl]
    if factors:
        longest = open_window().longest_side
        for camera in cameras:
            check_size(camera, max(factors), longest)


def check_size(camera: Camera, supersampling: int, longest: int) -> None:
    """Raise ValueError where an image drawn at `factor` times its size is longer than `longest` pixels."""
    if max(camera.width, camera.height) * supersampling > longest:
        larger = f", which for isosurfaces are drawn {supersampling} times as large" if supersampling > 1 else ""
        raise ValueError(
            f"pictures of {camera.width} x {camera.height} pixels{larger}, are more than this machine's OpenGL draws: "
            f"choose width and height up to {longest // supersampling}"
        )


def render_views(
    grid: Grid,
    appearance: Appearance,
    cameras: Iterable[Camera],
    *,
    sample_distance: float | None = None,
    float_output: bool = False,
    backend: str = "auto",
) -> Iterator[NDArray[Any]]:
    """Premultiplied RGBA pictures [height, width, 4], top row first, one per camera, in order.

    An appearance of another package draws its own, which are checked for shape and dtype (ValueError).
    uint8, or float32 in [0, 1] with `float_output`.  `sample_distance` (world units) is for volumes: by default
    half the smallest spacing (`choose_sample_distance` finds the largest that is good enough).  `backend` draws: "vtk"; "cpu",
    which casts rays without OpenGL; or "auto" (`render.backends`).  The field is uploaded once and freed when the iterator ends or
    is closed.

    Examples
    --------
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from render import render_views, to_grid
    >>> grid = to_grid(simulate(0.8, 0.3), **PLACE)
    >>> for picture in render_views(grid, APPEARANCE, [CAMERA, CAMERA.resized(64, 64)], float_output=True):
    ...     print(picture.shape, picture.dtype)
    (128, 128, 4) float32
    (64, 64, 4) float32
    """
    if isinstance(appearance, PluginAppearance):
        yield from _plugin_pictures(grid, appearance, list(cameras), float_output)
        return
    if backend_of(grid, appearance, backend) == "cpu":
        assert isinstance(appearance, VolumeRendering | Isosurface)
        yield from cast_views(prepared(grid, appearance), cameras, sample_distance, float_output=float_output)
        return
    with Renderer(grid, appearance, sample_distance=sample_distance) as renderer:
        for camera in cameras:
            yield renderer.render(camera, float_output=float_output)


def _plugin_pictures(
    grid: Grid, appearance: PluginAppearance, cameras: Sequence[Camera], float_output: bool
) -> Iterator[NDArray[Any]]:
    wanted = np.dtype(np.float32 if float_output else np.uint8)
    for camera, picture in zip(cameras, appearance.pictures(grid, cameras, float_output=float_output), strict=True):
        if picture.shape != (camera.height, camera.width, 4) or picture.dtype != wanted:
            raise ValueError(
                f"appearance {appearance.name!r} drew a picture {picture.shape} of {picture.dtype}, where "
                f"({camera.height}, {camera.width}, 4) of {wanted} was asked for"
            )
        yield picture
