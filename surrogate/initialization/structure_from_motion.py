"""Points that several pictures show: features found, matched and triangulated by COLMAP, from cameras that are known.

Schönberger & Frahm 2016, "Structure-from-Motion Revisited", of which only the triangulation is needed; features are those of
Lowe 2004, "Distinctive Image Features from Scale-Invariant Keypoints".
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import write_image
from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.gaussians import Normalization
from surrogate.initialization.pictures import Picture, StartPoints, foreground, straight_colors, training_pictures

FEWEST_POINTS = 200  # fewer say less about where the volume is than its box does
NEIGHBOURS = 8  # nearest views that each is matched with; further ones no longer look alike
EPIPOLAR_ERROR = 2.0  # pixels; COLMAP allows 4, for cameras that are themselves estimated
SHORTEST_TRACK = 3  # views that show a point: two rays may meet by chance, a third won't


@dataclass(frozen=True, eq=False)
class Track:
    """A triangulated point, in normalized coordinates (3,), and the pixels that show it: (L, 3) of view, row and column."""

    place: NDArray[np.float64]  # [3]
    pixels: NDArray[np.intp]  # [L, 3]

    __repr__ = one_line

    @property
    def views(self) -> int:
        """The number of pictures that show it, which may be fewer than its features."""
        return len(np.unique(self.pixels[:, 0]))


def structure_from_motion_points(
    catalog: Catalog, member: Member, appearance: str, normalization: Normalization, *, seed: int = 0
) -> StartPoints:
    """Points inside the box that at least three training pictures of one member show, with their mean straight RGB.

    Features need something to hold on to: texture, edges and corners of surfaces.  What is smooth gives none, and in
    translucent pictures most of what looks like a feature belongs to no one place.  Pictures with alpha are searched over
    black and over white, because each shows features that the other lacks.  One catalog and seed give the same points, however
    many threads there are.

    Raises ValueError where pycolmap is not installed, where the member has no training pictures, and where there are
    fewer than `FEWEST_POINTS` points.
    """
    pycolmap = _load_pycolmap()
    pictures = training_pictures(catalog, member, appearance, normalization)
    cameras = [picture.camera for picture in pictures]
    box = normalization.points(catalog.plan.bounds)  # [2, 3]
    searched = _searched(pictures, catalog.plan.background is None) if len(pictures) >= SHORTEST_TRACK else ()
    candidates = [track for images in searched for track in triangulate(pycolmap, cameras, images, seed)]
    tracks = [t for t in candidates if t.views >= SHORTEST_TRACK and ((t.place >= box[0]) & (t.place <= box[1])).all()]
    if len(tracks) < FEWEST_POINTS:
        raise ValueError(
            f"structure from motion found {len(tracks)} points in {len(pictures)} training images of member {member.name}, at "
            f"least {FEWEST_POINTS} are needed: small, smooth and translucent images have few features that other views "
            'repeat; set training.initialization = "random"'
        )
    foregrounds = [foreground(picture.pixels, catalog.plan.background) for picture in pictures]  # V of [H, W, 4]
    sums = [np.sum([foregrounds[view][row, column] / 255.0 for view, row, column in t.pixels], axis=0) for t in tracks]
    return StartPoints(np.stack([track.place for track in tracks]), straight_colors(np.stack(sums)))


def triangulate(
    pycolmap: Any, cameras: Sequence[Camera], images: Sequence[NDArray[np.uint8]], seed: int
) -> list[Track]:
    """Points that COLMAP triangulates from opaque `images` (V) of (H, W, 4) with given, fixed `cameras` (V)."""
    pycolmap.set_random_seed(seed)
    with TemporaryDirectory(prefix="gs-surrogate-") as name, _quiet(pycolmap):
        folder = Path(name)
        for view, image in enumerate(images):
            write_image(folder / _name(view), image)
        reconstruction = _posed(pycolmap, cameras)
        _match(pycolmap, reconstruction, folder, neighbours(cameras))
        options = pycolmap.IncrementalPipelineOptions(min_num_matches=1, random_seed=seed, extract_colors=False)
        result = pycolmap.triangulate_points(reconstruction, folder / "database.db", folder, folder, options=options)
        return [_track(result, point) for point in sorted(result.point3D_ids())]


def neighbours(cameras: Sequence[Camera]) -> list[tuple[int, int]]:
    """Pairs of views, the lower first, of which one is among the `NEIGHBOURS` that stand nearest to the other."""
    places = np.stack([camera.position for camera in cameras])  # [V, 3]
    distances = np.linalg.norm(places[:, None] - places[None], axis=-1)  # [V, V]
    np.fill_diagonal(distances, np.inf)
    nearest = distances.round(9).argsort(axis=1, kind="stable")[:, : min(NEIGHBOURS, len(cameras) - 1)]
    return sorted({(min(i, int(j)), max(i, int(j))) for i, row in enumerate(nearest) for j in row})


def _posed(pycolmap: Any, cameras: Sequence[Camera]) -> Any:
    """A reconstruction without points.  COLMAP's cameras are ours: OpenCV axes, and (0.5, 0.5) is the middle of the first pixel."""
    reconstruction = pycolmap.Reconstruction()
    for number, camera in enumerate(cameras, 1):  # COLMAP counts from 1
        lens = pycolmap.Camera(
            camera_id=number,
            model="PINHOLE",
            width=camera.width,
            height=camera.height,
            params=[camera.fx, camera.fy, camera.cx, camera.cy],
            has_prior_focal_length=True,
        )
        reconstruction.add_camera_with_trivial_rig(lens)
        image = pycolmap.Image(name=_name(number - 1), camera_id=number, image_id=number)
        reconstruction.add_image_with_trivial_frame(image, pycolmap.Rigid3d(camera.world_to_camera[:3]))
    return reconstruction


def _match(pycolmap: Any, reconstruction: Any, folder: Path, pairs: Sequence[tuple[int, int]]) -> None:
    """Fill the database with features, and with the matches of `pairs` that agree with the known cameras."""
    path, pair_list, cpu = folder / "database.db", folder / "pairs.txt", pycolmap.Device.cpu
    with pycolmap.Database.open(path) as database:
        for number in sorted(reconstruction.images):
            database.write_camera(reconstruction.camera(number), True)
            database.write_rig(reconstruction.rig(number), True)
            database.write_frame(reconstruction.frame(number), True)
            database.write_image(reconstruction.image(number), True)
    pycolmap.extract_features(
        path, folder, image_names=[_name(v) for v in range(len(reconstruction.images))], device=cpu
    )
    pair_list.write_text("\n".join(f"{_name(i)} {_name(j)}" for i, j in pairs))
    # The cameras are known: few matches tell as surely as many, and verification by itself would only guess the cameras.
    geometry = pycolmap.TwoViewGeometryOptions(min_num_inliers=1)
    geometry.ransac.max_error = EPIPOLAR_ERROR
    pycolmap.match_image_pairs(
        path,
        matching_options=pycolmap.FeatureMatchingOptions(skip_geometric_verification=True),
        pairing_options=pycolmap.ImportedPairingOptions(match_list_path=pair_list),
        verification_options=geometry,
        device=cpu,
    )
    pycolmap.guided_geometric_verification(reconstruction, path, two_view_geometry_options=geometry)


def _track(reconstruction: Any, point: int) -> Track:
    place = reconstruction.point3D(point)
    pixels = []
    for element in place.track.elements:
        image = reconstruction.image(element.image_id)
        column, row = image.point2D(element.point2D_idx).xy
        pixels.append((element.image_id - 1, int(row), int(column)))
    return Track(np.array(place.xyz), np.array(pixels))


def _searched(pictures: Sequence[Picture], translucent: bool) -> Iterator[list[NDArray[np.uint8]]]:
    """The pictures, opaque RGBA (H, W, 4): as they are, or, where they have alpha, over black and then over white."""
    for white in (0, 1) if translucent else (0,):
        # No premultiplied channel exceeds alpha: nothing overflows.
        yield [p + (255 - p[..., 3:]) * np.array([white, white, white, 1], dtype=np.uint8) for _, p in pictures]


def _name(view: int) -> str:
    return f"{view:06d}.png"


@contextmanager
def _quiet(pycolmap: Any) -> Iterator[None]:
    """Keep COLMAP from writing what it does to the terminal."""
    before = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = before


def _load_pycolmap() -> Any:
    try:
        import pycolmap
    except ImportError as error:
        raise ValueError(
            "training.initialization = \"sfm\" needs pycolmap, which is not installed: pip install 'gs-surrogate[sfm]'"
        ) from error
    # SIGTERM gets its Python handler again: COLMAP replaces it by one that prints a stack trace and aborts.
    handler = signal.getsignal(signal.SIGTERM)
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)
    return pycolmap
