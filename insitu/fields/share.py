"""One rank's part of a member's fields, as its simulation hands it over."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Appearance
from catalogs.vocabulary.quantity import Quantity
from insitu.fields.field import Field
from insitu.fields.location import FieldLocation, Ghosts
from insitu.fields.member_fields import as_fields
from insitu.mpi.layout import BlockExtent
from insitu.mpi.neighbours import BlockSamples
from render.grids import Grid
from render.partition import Index
from render.xarray_fields import is_labelled_set

Layers = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]  # before and after, along x, y, z
NO_LAYERS: Layers = (0, 0), (0, 0), (0, 0)


@dataclass(frozen=True, eq=False)
class Share:
    """One rank's block of a member's fields.

    Attributes
    ----------
    fields : by name, all at `extent`.
    extent, own : where the samples lie, with ghost layers and without.
    quantities : the names and units that the data state, by name.
    types : of the numbers in the data, by name, as far as they are known.
    layers : ghost layers.
    """

    fields: Mapping[str, BlockSamples]
    extent: BlockExtent
    own: BlockExtent
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    types: Mapping[str, str] = field(default_factory=dict)
    layers: Layers = NO_LAYERS

    def owned(self, name: str) -> BlockSamples:
        """A field without its ghost layers."""
        first = np.rint((np.array(self.own.origin) - self.extent.origin) / self.extent.spacing).astype(int)[::-1]
        window = tuple(slice(a, a + n) for a, n in zip(first.tolist(), self.own.shape, strict=True))
        samples = self.fields[name]
        return BlockSamples(samples.values[window], None if samples.holes is None else samples.holes[window])


def share_of(
    data: Any,
    appearances: Sequence[Appearance],
    location: FieldLocation,
    all_appearances: Sequence[Appearance],
) -> Share | None:
    """This rank's share; None of a rank without a block, whose `data` are None.

    Arguments as in `insitu.fields.member_fields.as_fields`; `location.origin` is that of the first sample, ghost layers
    included.

    Raises ValueError or TypeError where the block is not acceptable.
    """
    if data is None:
        return None
    layers = ghost_layers(location.ghosts)
    has_ghosts = any(map(any, layers))
    missing = "transparent" if has_ghosts else location.nan
    acceptable = _each(data, partial(_acceptable, missing))
    fields = as_fields(acceptable, appearances, replace(location, nan=missing), all_appearances=all_appearances)
    if fields.notes:
        raise ValueError(
            f"{fields.notes[0]}; a block must hold samples of a uniform grid: resample it, then pass the result"
        )
    grid = next(iter(fields.grids.values()))
    shape = _shape(data, grid.shape, location.dims)
    extent = BlockExtent(shape, grid.spacing, grid.origin)
    share = Share(
        {name: _samples(g, shape, _dataset_of(data, name)) for name, g in fields.grids.items()},
        extent,
        _without(extent, layers),
        fields.quantities,
        {name: _type_of(_dataset_of(data, name), name or location.array) for name in fields.grids},
        layers,
    )
    if has_ghosts and location.nan == "refuse":
        _check_no_holes(share)
    return share


def ghost_layers(ghosts: Ghosts) -> Layers:
    """The layers before and after a block along x, y and z; raises ValueError where `ghosts` says no such thing."""
    each = list(ghosts) if isinstance(ghosts, Sequence) else [ghosts] * 3
    pairs = [tuple(g) if isinstance(g, Sequence) else (g, g) for g in each]
    counts = [n for pair in pairs for n in pair]
    if len(pairs) != 3 or len(counts) != 6 or not all(isinstance(n, int) and n >= 0 for n in counts):
        raise ValueError(
            "ghosts must be a number of layers on every side, (x, y, z) numbers, or (x, y, z) pairs (before, after), "
            f"got {ghosts!r}"
        )
    x, y, z = ((int(before), int(after)) for before, after in pairs)
    return x, y, z


def _without(extent: BlockExtent, layers: Layers) -> BlockExtent:
    """The extent of a block without its ghost layers."""
    shape = [n - before - after for n, (before, after) in zip(extent.shape, reversed(layers), strict=True)]
    if min(shape) < 1:
        x, y, z = extent.shape[::-1]
        raise ValueError(f"the block has {x} x {y} x {z} samples, none but its ghost layers {layers}")
    origin = [o + before * s for o, s, (before, _) in zip(extent.origin, extent.spacing, layers, strict=True)]
    return BlockExtent((shape[0], shape[1], shape[2]), extent.spacing, (origin[0], origin[1], origin[2]))


def _each(data: Any, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Any:
    """`data` with its plain arrays changed; anything else is left as it is."""
    if type(data) is dict:
        return {name: _each(value, change) for name, value in data.items()}
    if isinstance(data, Field):
        return replace(data, values=change(data.values))
    return change(data) if type(data) is np.ndarray else data


def _acceptable(missing: str, values: NDArray[Any]) -> NDArray[Any]:
    """An array that makes a grid: single layers twice, and zeros where all is missing; `_shape` and `_samples` undo it."""
    for axis in range(values.ndim):
        if values.shape[axis] == 1:
            values = np.repeat(values, 2, axis=axis)
    return np.zeros_like(values) if missing == "transparent" and _is_empty(values) else values


def _is_empty(values: Any) -> bool:
    """True if an array has no finite number."""
    return type(values) is np.ndarray and values.dtype.kind == "f" and not np.isfinite(values).any()


def _dataset_of(data: Any, name: str) -> Any:
    """The array that was taken for a field of this name."""
    dataset = data if type(data) is not dict else data[name] if name else next(iter(data.values()))
    return dataset.values if isinstance(dataset, Field) else dataset


def _type_of(dataset: Any, array: str | None) -> str:
    """The type of the numbers, "" where the data do not say."""
    if hasattr(dataset, "GetClassName"):
        from pyvista import wrap

        with suppress(KeyError, AttributeError):
            dataset = wrap(dataset).get_array(array) if array else wrap(dataset).active_scalars
    elif array and is_labelled_set(dataset):
        dataset = dataset[array]
    return str(getattr(dataset, "dtype", ""))


def _shape(data: Any, grid_shape: Index, dims: Sequence[str] | None) -> Index:
    """The samples (z, y, x) that there really are."""
    array = _dataset_of(next(iter(data.values())) if type(data) is dict else data, "")
    if type(array) is not np.ndarray:
        return grid_shape
    order = range(3) if dims is None else [list(dims).index(letter) for letter in "zyx"]
    z, y, x = (array.shape[axis] for axis in order)
    return z, y, x


def _samples(grid: Grid, shape: Index, dataset: Any) -> BlockSamples:
    window = tuple(map(slice, shape))
    if _is_empty(dataset):
        return BlockSamples(grid.values[window], np.ones(shape, dtype=bool))
    return BlockSamples(grid.values[window], None if grid.holes is None else grid.holes[window])


def _check_no_holes(share: Share) -> None:
    for name in share.fields:
        holes = share.owned(name).holes
        if holes is not None and holes.any():
            of = f" of field {name!r}" if name else ""
            raise ValueError(
                f"{int(holes.sum())} of {holes.size} values{of} are NaN or infinite: "
                'pass nan="transparent" to leave them out of the picture'
            )
