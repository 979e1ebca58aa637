"""Points inside the visual hull: the largest body whose silhouettes are those of the pictures.

Laurentini 1994, "The visual hull concept for silhouette-based image understanding"; carved out of a grid of voxels as
by Szeliski 1993, "Rapid octree construction from image sequences", without the octree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Normalization
from surrogate.initialization.pictures import Picture, Points, foreground, straight_colors, training_pictures

RESOLUTION = 64  # voxels along the longest side of the box
CANDIDATES = 4  # places tried for each point that is wanted
SLACK = 2.0**0.5  # pixels: how far two points can be nearer than the middles of their pixels


def hull_points(
    catalog: Catalog,
    member: Member,
    appearance: str,
    normalization: Normalization,
    count: int,
    random: np.random.Generator,
) -> Points:
    """Up to `count` points spread uniformly over the visual hull of one member, from its training pictures.

    A point's colour is the mean straight RGB, weighted by alpha, of the pixels that it projects to.

    Nothing that is seen lies outside the hull, but the hull knows only silhouettes: it has no dents that no view shows in
    profile, and it is solid where the volume may be hollow.  A colour mixes what lies before and behind its point.  In opaque
    pictures what has the colour of the background is taken for that.  Views that see only a part of the box say
    nothing about the rest; what no view sees is left empty.  There are fewer points than `count` where the hull is thinner than
    the voxels, a 64th of the box, that it is sought in.

    Raises ValueError where the member has no training pictures, and where the hull is empty.
    """
    pictures = training_pictures(catalog, member, appearance, normalization)
    views = [Picture(camera, foreground(pixels, catalog.plan.background)) for camera, pixels in pictures]
    centers, sides = voxels(normalization.points(catalog.plan.bounds))  # [N, 3], [3]
    kept = centers[occupied(centers, views, radius=float(np.linalg.norm(sides)) / 2.0, slack=SLACK)]  # [K, 3]
    if len(kept):
        tried = kept[random.integers(len(kept), size=CANDIDATES * count)]  # [M, 3]
        tried += sides * random.uniform(-0.5, 0.5, tried.shape)
        kept = tried[occupied(tried, views)[:count]]
    if not len(kept):
        raise ValueError(
            f"the visual hull of member {member.name} is empty: no place in the catalog's box is inside the silhouettes of all "
            f'{len(views)} training views; check the box and the background, or set training.initialization = "random"'
        )
    return Points(kept, straight_colors(sum((_seen(kept, *view) for view in views), np.zeros((len(kept), 4)))))


def voxels(box: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres (N, 3) and sides (3,) of nearly cubic voxels that fill `box` (2, 3), `RESOLUTION` along its longest side."""
    lengths = box[1] - box[0]  # [3]
    shape = np.maximum(1, np.rint(RESOLUTION * lengths / lengths.max())).astype(int)  # [3]
    axes = [low + length * (np.arange(n) + 0.5) / n for low, length, n in zip(box[0], lengths, shape, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), lengths / shape


def occupied(
    centers: NDArray[np.float64], views: Sequence[Picture], *, radius: float = 0.0, slack: float = 0.0
) -> NDArray[np.intp]:
    """Which balls, by index (K,), reach into the silhouette of every view that sees their centre, and are seen by one.

    Parameters
    ----------
    centers : (N, 3).
    radius : of all balls.
    slack : pixels that a ball may be away from a silhouette.
    """
    points = np.ascontiguousarray(centers.T, dtype=np.float32)  # [3, N]
    left, seen = np.arange(len(centers)), np.zeros(len(centers), dtype=bool)
    for camera, picture in views:
        pixels, inside, depths = _pixels(points, camera)
        away = np.linalg.norm(points[:, inside] - camera.position[:, None].astype(np.float32), axis=0)  # [K]
        reach = _reach(radius, camera, depths, away) + np.float32(slack)  # [K]
        empty = np.zeros(len(left), dtype=bool)
        empty[inside] = _away(picture)[pixels] > reach
        seen[left[inside]] = True
        left, points = left[~empty], points.compress(~empty, axis=1)
    return left[seen[left]]


def _reach(
    radius: float, camera: Camera, depths: NDArray[np.float32], distances: NDArray[np.float32]
) -> NDArray[np.float32]:
    """How many pixels (K,) a ball reaches at most from where its centre is seen, at `depths` and `distances` (K,) from the camera.

    A point r away, for a centre (X, Y, Z) in the camera's axes, is seen f (r_xy Z - r_z (X, Y)) / (Z (Z + r_z)) beside it, so by no
    more than f |r| |(X, Y, Z)| / (Z (Z - |r|)): far from the axis a ball looks longer than on it.
    """
    focal, before = np.float32(radius * max(camera.fx, camera.fy)), depths - np.float32(radius)
    reach = np.full_like(depths, np.inf)  # of a ball that reaches behind the camera
    return np.divide(focal * distances, depths * before, out=reach, where=before > 0)


def _away(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Distance in pixels, flat (H * W,), from each pixel of RGBA (H, W, 4) to the nearest that is not empty."""
    empty = picture[..., 3] == 0
    if empty.all():  # of which scipy makes finite distances
        return np.full(empty.size, np.inf, dtype=np.float32)
    return distance_transform_edt(empty).astype(np.float32).ravel()


def _seen(places: NDArray[np.float64], camera: Camera, picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Premultiplied RGBA (M, 4) in [0, 1] of the pixels that `places` (M, 3) project to; 0 outside the picture."""
    pixels, inside, _ = _pixels(np.ascontiguousarray(places.T, dtype=np.float32), camera)
    colors = np.zeros((len(places), 4))
    colors[inside] = picture.reshape(-1, 4)[pixels] / 255.0
    return colors


def _pixels(
    points: NDArray[np.float32], camera: Camera
) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.float32]]:
    """The pixel (K,), as a flat index, and the depth (K,) of each of `points` (3, N) that is in the picture (N,).

    In float32: normalized coordinates are of order one, and a hundredth of a pixel is exact enough.
    """
    lens = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    matrix = (lens @ camera.world_to_camera[:3]).astype(np.float32)  # [3, 4]
    across, down, depths = np.einsum("ij,jn->in", matrix[:, :3], points) + matrix[:, 3:]  # [N] each; BLAS is slower
    before = depths > 0
    scale = np.divide(np.float32(1.0), depths, out=np.full_like(depths, np.inf), where=before)
    with np.errstate(invalid="ignore", over="ignore"):  # behind the camera, and beside it
        across, down = across * scale, down * scale
    inside = before & (across >= 0) & (across < camera.width) & (down >= 0) & (down < camera.height)
    flat = down[inside].astype(np.intp) * camera.width + across[inside].astype(np.intp)
    return flat, inside, depths[inside]
