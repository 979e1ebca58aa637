"""Properties of pictures: their shown pixels, their roughness, and how much changes from member to member."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from surrogate.evaluation.metrics import WHITE
from surrogate.evaluation.scoring import spread
from surrogate.training.data import Example, ImageRow, load_examples, training_rows
from surrogate.training.downsampling import downsampled
from surrogate.training.source import Source

SAMPLED = 64  # pictures that visible pixels and roughness are judged by
CAMERAS, MEMBERS = 6, 24  # at most that are compared
ONE_STEP = 1.01 / 255.0  # of 8 bits
VISIBLE = 0.01  # of a pixel that shows something: its opacity, or how far any channel is from the background


def sampled(source: Source, rows: Sequence[ImageRow]) -> list[Example]:
    """Some pictures of the `rows`, evenly."""
    return load_examples(source.catalog, [rows[i] for i in spread(len(rows), SAMPLED)], source.normalization)


def visible_pixels(source: Source, examples: Sequence[Example]) -> float:
    """The number of pixels of a picture that show something: the mean over `examples`."""
    return statistics.fmean(float(_shows(example.pixels, source).sum()) for example in examples)


def roughness(examples: Sequence[Example]) -> float:
    """Roughness, the share of a picture as fine as its pixels: 0 where it is smooth, 1 and more where neighbours share nothing.

    The mean square by which pixels differ from the mean of their four neighbours, over the variance, each over all `examples`.
    """
    fine = whole = 0.0
    for example in examples:
        colors = example.compared()[..., :3] / 255.0  # [H, W, 3]
        around = colors[2:, 1:-1] + colors[:-2, 1:-1] + colors[1:-1, 2:] + colors[1:-1, :-2]  # [H - 2, W - 2, 3]
        fine += float(((colors[1:-1, 1:-1] - around / 4.0) ** 2).sum()) / colors.size
        whole += float(((colors - colors.mean(axis=(0, 1))) ** 2).mean())
    return fine / whole if whole else 0.0


def empty_images(source: Source) -> tuple[int, int]:
    """The numbers of empty ones among some training images of the base appearance, and of these."""
    rows = training_rows(source.catalog, [source.appearance])
    some = sampled(source, rows)
    return sum(_is_empty(example, source) for example in some), len(some)


def require_content(source: Source) -> None:
    """Raise ValueError where all training images are empty, of the base appearance and of variations."""
    variations = [[s.appearance for s in variation.settings] for variation in source.variations]
    of_all = [training_rows(source.catalog, names) for names in ([source.appearance], *variations)]
    for rows in of_all:
        if not all(_is_empty(example, source) for example in sampled(source, rows)):
            return
    for row in (row for rows in of_all for row in rows):
        [example] = load_examples(source.catalog, [row], source.normalization)
        if not _is_empty(example, source):
            return
    raise ValueError(
        f"all {sum(map(len, of_all)):,} training images of {source.appearance} in {source.catalog.path} are empty, so nothing "
        "can be learnt: render again with a transfer function, isovalue or bounds that show the field"
    )


def changing_share(source: Source, rows: Sequence[ImageRow], factor: int = 1) -> float:
    """The share of the pictures that changes from member to member: 0 where all look the same, about 1 where they share nothing.

    It is the share of the variance of colours, over members and the pixels that show something in any of them, which the mean over
    members leaves.  Mean over some cameras that see several members; 1 where there are none.  Pictures are first downsampled
    by a `factor`.
    """
    shares = [_unexplained([downsampled(e, factor) for e in of], source) for of in _by_camera(source, rows)]
    return statistics.fmean(shares) if shares else 1.0


def _unexplained(examples: Sequence[Example], source: Source) -> float:
    colors = np.stack([example.compared()[..., :3] for example in examples]).astype(np.float64)  # [M, H, W, 3]
    visible = np.any([_shows(example.pixels, source) for example in examples], axis=0)  # [H, W]
    pixels = colors[:, visible]  # [M, V, 3]
    whole = float(((pixels - pixels.mean(axis=(0, 1))) ** 2).sum()) if pixels.size else 0.0
    return float(((pixels - pixels.mean(axis=0)) ** 2).sum()) / whole if whole else 0.0


def _by_camera(source: Source, rows: Sequence[ImageRow]) -> Iterator[list[Example]]:
    """Pictures of several members each, through the same camera and of the same size."""
    through = defaultdict[tuple[object, ...], list[ImageRow]](list)
    for row in rows:
        through[_key(row.member.cameras[row.view])].append(row)
    shared = [of for of in through.values() if len({row.member.name for row in of}) > 1]
    for of in (shared[i] for i in spread(len(shared), CAMERAS)):
        yield load_examples(source.catalog, [of[i] for i in spread(len(of), MEMBERS)], source.normalization)


def _key(camera: Camera) -> tuple[object, ...]:
    matrix = camera.world_to_camera
    size = float(np.abs(matrix).max())
    places = tuple(np.round(matrix / size, 6).ravel() + 0.0)
    return (*places, round(camera.fx, 3), round(camera.fy, 3), camera.width, camera.height)


def _is_empty(example: Example, source: Source) -> bool:
    """True where no pixel differs from the background, or has any opacity."""
    if example.pixels.shape[2] == 4:
        return not example.pixels[..., 3].any()
    background = np.asarray(source.catalog.plan.background or WHITE)
    return bool((np.abs(example.pixels / 255.0 - background) < ONE_STEP).all())


def _shows(pixels: NDArray[np.uint8], source: Source) -> NDArray[np.bool_]:  # [H, W]
    if pixels.shape[2] == 4:
        return pixels[..., 3] > 255.0 * VISIBLE
    background = np.asarray(source.catalog.plan.background or WHITE)
    return (np.abs(pixels / 255.0 - background) > VISIBLE).any(axis=2)
