"""Pictures whose parameters are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from catalogs.files.images import read_image
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import one_line
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.storage.picture_records import record_of

SEARCH = "search"  # for a camera that is not known
FLAT = 2.0 / 255.0  # the contrast below which a picture shows nothing


@dataclass(frozen=True, eq=False)
class Target:
    """A picture as displayed, where its camera stood, and the pixels that count.

    Attributes
    ----------
    picture : (H, W, 3) float32 in [0, 1].
    camera : of the same size; None where it is not known, and must be searched.
    mask : (H, W), True where a pixel counts; None for all.

    Examples
    --------
    >>> from blobs import CAMERA, make_run
    >>> from surrogate import Surrogate, Target
    >>> deformed = Surrogate.load(make_run() / "surrogate").at(separation=0.7, width=0.3)
    >>> picture = deformed.render(CAMERA, background=(1, 1, 1))[..., :3]
    >>> target = Target(picture, CAMERA).resized(32).region((8, 8, 24, 24))  # its middle counts
    >>> target.width, int(target.mask.sum())
    (32, 256)
    """

    picture: NDArray[np.float32]
    camera: Camera | None = None
    mask: NDArray[np.bool_] | None = None

    __repr__ = one_line

    def __post_init__(self) -> None:
        size = self.picture.shape[:2] if self.camera is None else (self.camera.height, self.camera.width)
        if self.picture.shape != (*size, 3):
            raise ValueError(f"a picture must be (H, W, 3) = {(*size, 3)} as its camera, got {self.picture.shape}")
        if not np.isfinite(self.picture).all():
            raise ValueError("a picture must have finite values")
        if self.mask is not None and (self.mask.shape != size or not self.mask.any()):
            raise ValueError(f"a mask must be {size} and mark a pixel, got {self.mask.shape}")
        pixels = self.picture if self.mask is None else self.picture[self.mask]
        if float(np.ptp(pixels.reshape(-1, 3), axis=0).max()) < FLAT:
            raise ValueError("the picture shows one colour alone: no parameters can be read from it")

    @property
    def width(self) -> int:
        """Pixels across."""
        return self.picture.shape[1]

    @property
    def height(self) -> int:
        """Pixels down."""
        return self.picture.shape[0]

    def resized(self, side: int) -> Target:
        """The same with at most `side` pixels along its longer side, by averaging."""
        longest = max(self.width, self.height)
        if longest <= side:
            return self
        width, height = (max(1, round(n * side / longest)) for n in (self.width, self.height))
        channels = [averaged(self.picture[..., c], width, height) for c in range(3)]
        mask = None
        if self.mask is not None:
            shares = averaged(self.mask.astype(np.float32), width, height)
            mask = shares >= min(0.5, float(shares.max()))
        camera = None if self.camera is None else self.camera.resized(width, height)
        return Target(np.stack(channels, axis=-1), camera, mask)

    def region(self, box: tuple[int, int, int, int]) -> Target:
        """The same where only pixels from (x0, y0) to before (x1, y1) count."""
        mask = np.zeros((self.height, self.width), bool)
        mask[inside(box, self)] = True
        return replace(self, mask=mask)


def inside(box: tuple[int, int, int, int], camera: Camera | Target) -> tuple[slice, slice]:
    """Rows and columns of the pixels from (x0, y0) to before (x1, y1); raises ValueError where a picture has not all of them."""
    x0, y0, x1, y1 = box
    if not (0 <= x0 < x1 <= camera.width and 0 <= y0 < y1 <= camera.height):
        raise ValueError(f"a region x0,y0,x1,y1 must lie in {camera.width} x {camera.height}, got {box}")
    return slice(y0, y1), slice(x0, x1)


def stored_target(catalog: Catalog, member: str, view: int, appearance: str | None = None) -> Target:
    """A picture of the catalog, by default in the base appearance; raises ValueError for a view it has not."""
    own = catalog.member(member)
    if not 0 <= view < len(own.cameras):
        raise ValueError(f"{member} has views 0 to {len(own.cameras) - 1}, got {view}")
    image = catalog.image(own, appearance or catalog.appearance_names[0], view)
    return Target(composite(image, catalog.plan.background or WHITE), own.cameras[view])


def views_of(catalog: Catalog) -> Sequence[Camera]:
    """The cameras that members share, else those of the first."""
    return catalog.plan.cameras or (catalog.members[0].cameras if catalog.members else ())


def target_of(catalog: Catalog, text: str, view: int | str | None = None) -> Target:
    """The picture that `text` names: MEMBER:VIEW of the catalog, or a file.

    A file that was exported knows its own camera; others take the number of a stored `view`, or "search" where it is not known.
    Raises ValueError for other text, a file without a camera, and an exported picture of another appearance than the base.
    """
    path = Path(text)
    if not path.is_file():
        member, colon, number = text.rpartition(":")
        if not (colon and number.isdigit() and member in catalog):
            such = f", such as {catalog.members[0].name}:0" if catalog.members else ""
            raise ValueError(f"{text} is neither a file nor MEMBER:VIEW of {catalog.path}{such}")
        return stored_target(catalog, member, int(number))
    camera = recorded_camera(path)
    if view is not None:
        camera = None if view == SEARCH else camera_at(catalog, view)
    elif camera is None:
        last = len(views_of(catalog)) - 1
        raise ValueError(f"{text} does not say where its camera stood: --camera takes a view, 0 to {last}, or {SEARCH}")
    picture = composite(read_image(path), catalog.plan.background or WHITE)
    height, width = picture.shape[:2]
    if camera is None:
        return Target(picture)
    if width * camera.height != height * camera.width:
        raise ValueError(
            f"{text} is {width} x {height}, of another shape than its camera's pictures, {camera.width} x {camera.height}"
        )
    return Target(picture, camera.resized(width, height))


def camera_at(catalog: Catalog, view: int | str) -> Camera:
    """A stored camera by number; raises ValueError for another one."""
    cameras = views_of(catalog)
    if not (str(view).isdigit() and int(view) < len(cameras)):
        raise ValueError(f"--camera takes a view, 0 to {len(cameras) - 1}, or {SEARCH}, got {view!r}")
    return cameras[int(view)]


def recorded_camera(path: Path) -> Camera | None:
    """The camera that an exported picture keeps; None for a file without one.

    Raises ValueError for one that is damaged, and for a picture in another appearance than the base.
    """
    try:
        record = record_of(path)
    except ValueError:
        return None
    if changed := [str(record[name]) for name in ("visualization", "color_map", "function") if record.get(name)]:
        raise ValueError(f"{path} shows {' and '.join(changed)}: parameters are read from the base appearance alone")
    if "camera" not in record:
        return None
    try:
        return Camera.from_json(record["camera"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{path} keeps a camera that is damaged: {error}") from error


def averaged(values: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """One channel (H, W) on fewer pixels."""
    return np.asarray(Image.fromarray(values).resize((width, height), Image.Resampling.BOX), dtype=np.float32)
