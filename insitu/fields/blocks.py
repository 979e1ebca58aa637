"""A member whose fields lie in blocks, one on each of several ranks.

Every rank makes `Blocks` of what it has; rank 0 asks for pictures and summaries, and the others do their part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from catalogs.store.coarse import CoarseField
from catalogs.store.plan import CatalogPlan
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import (
    Appearance,
    Isosurface,
    TransferFunction,
    VolumeRendering,
    field_of,
    shown_fields,
)
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.quantity import Quantity
from insitu.fields.boxes import Box, checked_box
from insitu.fields.coarse import coarse_fields
from insitu.fields.member_fields import LocalField
from insitu.fields.share import Share, share_of
from insitu.fields.summarize import FieldPart, summarize_shown
from insitu.mpi.layout import BlockExtent, BlockLayout, UnevenBlocks, layout
from insitu.mpi.neighbours import block_of
from insitu.mpi.ranks import CollectiveError, RankGroup, call_all
from insitu.mpi.resampling import common_lattice, even_layout, resampled
from native.ray_casting.functions import drawn_range
from render.blocks import Block, Lattice, footprint
from render.compositing import nearest, over, packed, unpacked
from render.grids import Triple
from render.isosurface import SUPERSAMPLING, box_average
from render.layers import BlockRenderer
from render.partition import Piece, Plane, front_to_back, pieces_of, space_partition
from render.steepness import drawn_cells, root_mean_square, squared_changes

AT_ONCE = 1 << 28  # bytes of layers that a rank draws before it sends them


class Blocks:
    """This rank's share of a member; `commands` is what rank 0 may ask of it, `take` how it begins.

    `field` is what the simulation has here.
    """

    def __init__(
        self,
        ranks: RankGroup,
        field: LocalField,
    ) -> None:
        self.ranks, self.field = ranks, field
        self._blocks: dict[str, Block | None] = {}
        self._ranges: Mapping[str, tuple[float, float]] = {}
        self._laid: BlockLayout
        self._order: Plane | Piece
        self._pieces: list[Piece]
        self._renderer: BlockRenderer | None = None
        self._appearance: Appearance
        self.commands: Mapping[str, Callable[..., Any]] = {
            "take": self._take,
            "open": self._open,
            "draw": self._draw,
            "change": self._change,
            "summarize": self._summarize,
            "coarsen": self._coarsen,
        }

    @property
    def whole(self) -> Lattice:
        """The grid that all blocks fill."""
        return self._laid.whole

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free what drawing holds."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def take(self, appearances: Sequence[Appearance], all_appearances: Sequence[Appearance]) -> BlockFields:
        """The fields that `appearances` show, for rank 0 within `insitu.mpi.ranks.lead`; see
        `insitu.fields.member_fields.as_fields`.

        Raises ValueError or TypeError naming the rank whose block is not acceptable.
        """
        fields: BlockFields = self.call_all("take", tuple(appearances), tuple(all_appearances), self.field.location.nan)
        return fields

    def call_all(self, name: str, *arguments: Any) -> Any:
        """Let every rank do a command; see `insitu.mpi.ranks.call_all`."""
        return call_all(self.ranks, self.commands, name, *arguments)

    def _take(self, appearances: Sequence[Appearance], all_appearances: Sequence[Appearance], nan: str) -> BlockFields:
        names = shown_fields(appearances) or ("",)
        share = share_of(self.field.loaded, appearances, replace(self.field.location, nan=nan), all_appearances)
        quantities: Mapping[str, Quantity] = next(
            (q for q in self.ranks.gather(share and share.quantities) if q is not None), {}
        )
        notes: tuple[str, ...] = ()
        extents = self.ranks.gather(share and share.own)
        if not any(extents):
            raise CollectiveError(ValueError("no rank has a block of the field"))
        self._check_types(share, names)
        try:
            self._laid = layout(extents)
        except UnevenBlocks as reason:
            self._check_layers(share, str(reason))
            share, notes = self._on_one_grid(share, names, nan, str(reason))
        except ValueError as error:
            raise CollectiveError(error) from None
        for name in names:
            self._blocks[name] = block_of(None if share is None else share.owned(name), self._laid, self.ranks)
        self._order = space_partition(self._laid.boxes)
        self._pieces = pieces_of(self._order)
        self._ranges = {name: _range(self._parts([name])[name], self.ranks) for name in names}
        return BlockFields(self, checked_box(self._laid.whole.bounds), notes, self._ranges, quantities)

    def _check_types(self, share: Share | None, names: Sequence[str]) -> None:
        """Whole numbers beside others would be taken for whole ones everywhere.  Collective."""
        everyone = self.ranks.gather(share and share.types)
        for name in names:
            first: dict[bool, str] = {}
            for rank, types in enumerate(everyone):
                if types and types[name]:
                    first.setdefault("int" in types[name], f"rank {rank} has {types[name]}")
            if len(first) > 1:
                of = f" of field {name!r}" if name else ""
                listed = ", ".join(sorted(first.values()))
                raise CollectiveError(
                    ValueError(f"the blocks{of} must have one type of numbers, but {listed}: convert them")
                )

    def _check_layers(self, share: Share | None, reason: str) -> None:
        """Blocks of one spacing that fill no grid may have forgotten their ghost layers.  Collective."""
        layers_by_rank = [
            (rank, s) for rank, s in enumerate(self.ranks.gather(share and (share.layers, share.own.spacing))) if s
        ]
        (rank, (layers, spacing)), *others = layers_by_rank
        for other, (theirs, at) in others:
            if at == spacing and theirs != layers and all(a == b for a, b in (*theirs, *layers)):
                one, two = ([before for before, _ in sides] for sides in (layers, theirs))
                raise CollectiveError(
                    ValueError(
                        f"the blocks fill no grid ({reason}): ghosts of rank {rank} are {one}, of rank {other} {two}"
                    )
                )

    def _on_one_grid(
        self, share: Share | None, names: Sequence[str], nan: str, reason: str
    ) -> tuple[Share | None, tuple[str, ...]]:
        """The rank's share of the fields resampled onto one grid, and what is to be said about it."""
        whole = common_lattice(self.ranks.gather(share and share.own))
        self._laid, blocks = even_layout(whole, self.ranks.size), {}
        extents = () if share is None else (share.extent, share.own)
        for name in names:
            samples, missing = resampled(None if share is None else share.fields[name], extents, self._laid, self.ranks)
            gaps = sum(self.ranks.gather(missing))
            if gaps and nan == "refuse":
                raise CollectiveError(
                    ValueError(
                        f"the blocks fill no grid ({reason}), and {gaps} of the {np.prod(whole.shape)} samples of the one that "
                        'they are resampled to lie in none of them: give ghost layers (ghosts=), or nan="transparent"'
                    )
                )
            if samples is not None:
                blocks[name] = samples
        nz, ny, nx = whole.shape
        note = f"the blocks fill no grid as they are ({reason}): they were resampled to {nx} x {ny} x {nz} samples (trilinear)"
        mine = self._laid.owned[self.ranks.number]
        if mine is None:
            return None, (note,)
        shape = next(iter(blocks.values())).values.shape
        extent = BlockExtent((shape[0], shape[1], shape[2]), whole.spacing, whole.place(mine.start))
        return Share(blocks, extent, extent), (note,)

    def _parts(self, names: Sequence[str]) -> dict[str, FieldPart]:
        whole = self._laid.whole
        blocks = {name: self._blocks[name] for name in names}
        return {n: FieldPart.none_of(whole) if block is None else FieldPart.of(block) for n, block in blocks.items()}

    def _open(self, appearance: Appearance, sample_distance: float | None) -> None:
        """Make ready to draw an appearance."""
        self.close()
        self._appearance, name = appearance, field_of(appearance)
        block = self._blocks[name]
        if block is not None:
            volume = isinstance(appearance, VolumeRendering)
            visible = drawn_range(self._ranges[name], appearance.transfer_function) if volume else None  # type: ignore[union-attr]
            self._renderer = BlockRenderer(block, appearance, sample_distance=sample_distance, value_range=visible)

    def _draw(self, cameras: Sequence[Camera], float_output: bool) -> list[NDArray[Any]]:
        """Pictures, on rank 0: every rank draws its block of all, and puts the layers of one together."""
        form = LayerAssembly(
            self._laid.whole, self._order, self._pieces, isinstance(self._appearance, Isosurface), float_output
        )
        sent = [self._packed_layers(form, camera) for camera in cameras]
        received = self.ranks.send(sent + [_EMPTY] * (self.ranks.size - len(sent)))
        number = self.ranks.number
        image = form.put_together(received, cameras[number]) if number < len(cameras) else None
        to_root = _EMPTY if image is None else np.ascontiguousarray(image).reshape(-1).view(np.uint8)
        arrived = self.ranks.send([to_root, *[_EMPTY] * (self.ranks.size - 1)])
        if number:
            return []
        dtype = np.float32 if float_output else np.uint8
        return [data.view(dtype).reshape(c.height, c.width, 4) for data, c in zip(arrived, cameras, strict=False)]

    def _packed_layers(self, form: LayerAssembly, camera: Camera) -> NDArray[np.uint8]:
        """The layers of this rank's pieces, one after the other."""
        layers = []
        for piece, rows, columns in form.footprints(camera, self.ranks.number):
            assert self._renderer is not None
            layers.append(self._renderer.layer(camera, piece, rows, columns, float_output=form.float_output))
        return np.concatenate([_EMPTY, *map(packed, layers)])

    def _change(self, field: str, transfer: TransferFunction) -> float:
        """See `render.steepness.mean_change`."""
        cells, block, part = drawn_cells(self._laid.whole.shape), self._blocks[field], self._parts([field])[field]
        squares = np.empty(0)
        if block is not None:
            squares = squared_changes(block.grid, transfer, cells[part.owns(cells)] - part.first)
        return root_mean_square(np.concatenate(self.ranks.gather(squares)))

    def _summarize(self, names: Sequence[str], plan: CatalogPlan) -> dict[str, FieldSummary]:
        return summarize_shown(self._parts(names), plan, self.ranks)

    def _coarsen(self, names: Sequence[str]) -> dict[str, CoarseField]:
        return coarse_fields(self._parts(names), self.ranks)


@dataclass(frozen=True, eq=False)
class BlockFields:
    """The fields of a member in blocks, for rank 0; attributes as in `insitu.fields.member_fields.MemberFields`."""

    blocks: Blocks
    box: Box
    notes: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    quantities: Mapping[str, Quantity]

    def backend(self, appearance: Appearance, wanted: str, usual: str) -> str:
        """See `MemberFields`: blocks are VTK's."""
        return "vtk"

    def drawable(self, appearance: Appearance, backend: str) -> BlockField:
        """See `MemberFields`."""
        return BlockField(self.blocks, field_of(appearance))

    def summaries(self, names: Sequence[str], plan: CatalogPlan) -> dict[str, FieldSummary]:
        """See `MemberFields`."""
        summaries: dict[str, FieldSummary] = self.blocks.call_all("summarize", tuple(names), plan)
        return summaries

    def coarse(self, names: Sequence[str]) -> dict[str, CoarseField]:
        """See `MemberFields`."""
        fields: dict[str, CoarseField] = self.blocks.call_all("coarsen", tuple(names))
        return fields


@dataclass(frozen=True, eq=False)
class BlockField:
    """One field in blocks, for rank 0; see `render.quality.Drawable`."""

    blocks: Blocks
    name: str

    @property
    def spacing(self) -> Triple:
        """See `Drawable`."""
        return self.blocks.whole.spacing

    @property
    def shape(self) -> tuple[int, int, int]:
        """See `Drawable`."""
        return self.blocks.whole.shape

    def pictures(
        self, appearance: Appearance, cameras: Sequence[Camera], sample_distance: float | None, *, float_output: bool
    ) -> Iterator[NDArray[Any]]:
        """See `Drawable`; as many at once as there are ranks, or as their memory bears."""
        self.blocks.call_all("open", appearance, sample_distance)
        share = at_once(appearance, cameras, self.blocks.ranks.size)
        for start in range(0, len(cameras), share):
            yield from self.blocks.call_all("draw", tuple(cameras[start : start + share]), float_output)

    def mean_change(self, transfer: TransferFunction) -> float:
        """See `Drawable`."""
        return float(self.blocks.call_all("change", self.name, transfer))


@dataclass(frozen=True, eq=False)
class LayerAssembly:
    """Images put together from layers of blocks.

    Attributes
    ----------
    whole : where the samples lie.
    order, pieces : the tree that orders the blocks, and its leaves.
    surfaces : whether the layers are those of an isosurface, `SUPERSAMPLING` times as large and with depths.
    float_output : float32 pictures, else uint8.
    """

    whole: Lattice
    order: Plane | Piece
    pieces: Sequence[Piece]
    surfaces: bool
    float_output: bool

    def footprints(self, camera: Camera, owner: int) -> Iterable[tuple[Piece, slice, slice]]:
        """The pieces of a rank, one of an isosurface, with the rows and columns of the layer that each adds to a picture."""
        mine = [piece for piece in self.pieces if piece.owner == owner]
        if not self.surfaces:
            return [(piece, *footprint(self.whole, piece, camera)) for piece in mine]
        if not mine:
            return []
        start, stop = np.min([p.start for p in mine], axis=0), np.max([p.stop for p in mine], axis=0)
        block = Piece(owner, tuple(start.tolist()), tuple(stop.tolist()))
        return [(block, *footprint(self.whole, block, self._large(camera)))]

    def put_together(self, received: Sequence[NDArray[np.uint8]], camera: Camera) -> NDArray[Any]:
        """The picture [height, width, 4] of the layers that came from each rank."""
        layers = {}
        for owner, data in enumerate(received):
            for piece, rows, columns in self.footprints(camera, owner):
                layers[piece], data = unpacked(data, rows, columns, self._layer_type, surfaces=self.surfaces)
        if self.surfaces:
            large = self._large(camera)
            image = nearest(layers.values(), large.height, large.width, self._layer_type)
            return box_average(image, SUPERSAMPLING)
        ordered = front_to_back(self.order, self.whole.index(camera.position))
        image = over((layers[piece] for piece in ordered), camera.height, camera.width)
        return image if self.float_output else np.rint(np.float32(255.0) * image).astype(np.uint8)

    @property
    def _layer_type(self) -> str:
        return "uint8" if self.surfaces and not self.float_output else "float32"

    @staticmethod
    def _large(camera: Camera) -> Camera:
        return camera.resized(SUPERSAMPLING * camera.width, SUPERSAMPLING * camera.height)


def at_once(appearance: Appearance, cameras: Sequence[Camera], ranks: int) -> int:
    """The number of views that are drawn before layers are sent."""
    per_pixel = 8 * SUPERSAMPLING**2 if isinstance(appearance, Isosurface) else 16  # bytes
    largest = max((camera.width * camera.height for camera in cameras), default=1)
    return max(1, min(ranks, AT_ONCE // (per_pixel * largest)))


_EMPTY = np.empty(0, dtype=np.uint8)


def _range(part: FieldPart, ranks: RankGroup) -> tuple[float, float]:
    """Smallest and largest finite value of a field in blocks.  Collective; raises CollectiveError where there is none."""
    own = part.values[part.window(0, part.shape[0])]
    if part.holes is not None:
        own = own[~part.holes[part.window(0, part.shape[0])]]
    ranges = [ends for ends in ranks.gather((float(own.min()), float(own.max())) if own.size else None) if ends]
    if not ranges:
        raise CollectiveError(ValueError("not one value of the field is finite"))
    return min(low for low, _ in ranges), max(high for _, high in ranges)
