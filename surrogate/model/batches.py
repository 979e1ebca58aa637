"""Many pictures at once: of several members, from several cameras, or both."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.words import joined_names
from native.threads import cores
from surrogate.model.mean_member import MemberModel
from surrogate.model.points import AnyPoint
from surrogate.splatting.threads import one_torch_thread

PARTS = 4  # of the work for each core, so that all end at about the same time

Row = dict[str, Any]  # the parameters of one picture by name


def rows_of(space: ParameterSpace, parameters: Any) -> list[Row]:
    """The parameters of each picture, by name.

    Parameters
    ----------
    parameters : (B, P) in the order of `space`, as an array, a tensor or nested lists.  A mapping of names to (B,) values, or to
        one for all, is taken as well, and a list of B mappings.

    Raises ValueError where it is none of these, or lengths differ.
    """
    if isinstance(parameters, Mapping):
        columns = {name: _column(name, values) for name, values in parameters.items()}
        lengths = {name: len(values) for name, values in columns.items() if values is not None}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"parameters must have as many values each, or one for all, got {lengths}")
        count = next(iter(lengths.values()), 1)
        whole = {n: [parameters[n]] * count if values is None else values for n, values in columns.items()}
        return [{name: values[k] for name, values in whole.items()} for k in range(count)]
    if isinstance(parameters, Sequence) and any(isinstance(row, Mapping) for row in parameters):
        if not all(isinstance(row, Mapping) for row in parameters):
            raise ValueError("parameters must be mappings all, or rows of numbers all")
        return [dict(row) for row in parameters]
    table = _array(parameters)
    if table.ndim != 2 or table.shape[1] != len(space):
        raise ValueError(
            f"parameters must be of shape (B, {len(space)}), with columns {joined_names(space.names)}, got shape {table.shape}: "
            "others are given by name, in a mapping"
        )
    return [dict(zip(space.names, row, strict=True)) for row in table.tolist()]


def paired(rows: Sequence[Row], cameras: Camera | Sequence[Camera]) -> tuple[list[Row], list[Camera], tuple[int, int]]:
    """B rows and as many cameras, and the height and width of the pictures: a single one of either is taken for all.

    Raises ValueError for other lengths, or cameras of different sizes.
    """
    views = [cameras] if isinstance(cameras, Camera) else list(cameras)
    if wrong := [type(view).__name__ for view in views if not isinstance(view, Camera)]:
        raise ValueError(f"cameras must be one catalogs.Camera or a sequence of them, got {wrong[0]}")
    if not views:
        raise ValueError("cameras must be one or more: without any the pictures have no size")
    sizes = {(view.width, view.height) for view in views}
    if len(sizes) > 1:
        raise ValueError(
            f"cameras must all have the same image size, got {joined_names(sorted(sizes))}: use Camera.resized"
        )
    if len(views) != len(rows) and 1 not in (len(views), len(rows)):
        raise ValueError(f"cameras must be one, or one for each of {len(rows)} rows of parameters, got {len(views)}")
    count = len(rows) if len(views) == 1 else len(views)
    same_rows = list(rows) * count if len(rows) == 1 else list(rows)
    return same_rows, views * count if len(views) == 1 else views, (views[0].height, views[0].width)


def draw_all(
    places: Sequence[AnyPoint],
    cameras: Sequence[Camera],
    size: tuple[int, int],
    member_at: Callable[[Any], MemberModel],
    background: NDArray[np.float32] | None,
    *,
    side_by_side: bool,
) -> NDArray[np.float32]:
    """The pictures (B, H, W, 4) of B places, equal ones being the same object, from B cameras, of `size` (H, W).

    Members are made once for each part of the work, and the parts done by as many threads as there are cores, each of which
    draws by itself.  Only as many members as there are threads are in memory at once.
    """
    pictures = np.empty((len(places), *size, 4), dtype=np.float32)
    workers = cores() if side_by_side and len(places) >= cores() else 1  # fewer pictures are drawn by all cores each

    def draw(part: Sequence[int]) -> None:
        member = member_at(places[part[0]])
        for k in part:
            pictures[k] = member.picture(cameras[k], background, threads=1 if workers > 1 else None)

    parts = _parts(places, workers)
    if workers == 1:
        for part in parts:
            draw(part)
    else:
        with one_torch_thread(), ThreadPoolExecutor(workers) as pool:
            for _ in pool.map(draw, parts):
                pass
    return pictures


def warn_of(places: Sequence[AnyPoint], stacklevel: int) -> None:
    """Warn of parameters out of bounds, once for each sentence, and of at most three."""
    sentences = list(dict.fromkeys(itertools.chain.from_iterable(place.warnings for place in places)))
    for sentence in sentences[:3]:
        warnings.warn(sentence, stacklevel=stacklevel + 1)
    if len(sentences) > 3:
        warnings.warn(f"and {len(sentences) - 3} more values lie outside their bounds", stacklevel=stacklevel + 1)


def _parts(places: Sequence[AnyPoint], workers: int) -> list[list[int]]:
    """The pictures by number, those of one member together, in pieces so small that every worker has several."""
    members: dict[int, list[int]] = {}
    for k, place in enumerate(places):
        members.setdefault(id(place), []).append(k)
    most = max(1, -(-len(places) // (workers * PARTS))) if workers > 1 else max(len(places), 1)
    return [numbers[i : i + most] for numbers in members.values() for i in range(0, len(numbers), most)]


def _column(name: str, values: Any) -> list[Any] | None:
    """The values of one parameter; None for a single one."""
    if isinstance(values, str) or not (hasattr(values, "__len__") or hasattr(values, "shape")):
        return None
    if isinstance(values, Sequence):
        return list(values)
    array = _array(values)
    if array.ndim > 1:
        raise ValueError(f"parameter {name} must be one value or (B,) values, got shape {array.shape}")
    return None if array.ndim == 0 else list(array.tolist())


def _array(values: ArrayLike) -> NDArray[Any]:
    """Numbers as an array, also those of a tensor on another device or one that has a gradient."""
    detached: Any = values.detach().cpu() if hasattr(values, "detach") else values
    try:
        return np.asarray(detached, dtype=None if isinstance(detached, np.ndarray) else np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"parameters must be numbers, in rows of equal length: {error}") from None
