"""Boxes that fill a lattice of samples, in the order in which an eye sees them.

A binary space partition: boxes on the eye's side of a plane that cuts none come before those behind it.  Source: Fuchs, Kedem &
Naylor 1980, "On visible surface generation by a priori tree structures".  Boxes that hide one another in a circle have no such
plane: some are cut in two.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Index = tuple[int, int, int]  # of a sample, (z, y, x)


@dataclass(frozen=True)
class Piece:
    """A box of samples, from `start` to before `stop`, (z, y, x) indices of the whole lattice, and the number of its owner.

    It owns the space from its first sample to the next piece's, half-open; the last ones end with their last sample.
    """

    owner: int
    start: Index
    stop: Index

    def cut(self, axis: int, plane: int) -> tuple[Piece, Piece]:
        """The parts before sample `plane` along `axis`, and from there on."""
        middle = [plane if a == axis else None for a in range(3)]
        stop = tuple(s if m is None else m for s, m in zip(self.stop, middle, strict=True))
        start = tuple(s if m is None else m for s, m in zip(self.start, middle, strict=True))
        return Piece(self.owner, self.start, stop), Piece(self.owner, start, self.stop)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Plane:
    """The plane through sample `at` along `axis` (0 is z), and the pieces on either side of it."""

    axis: int
    at: int
    below: Plane | Piece
    above: Plane | Piece


def space_partition(pieces: Sequence[Piece]) -> Plane | Piece:
    """The tree of planes between `pieces`, disjoint boxes, at least one; cuts as few as it finds."""
    if len(pieces) == 1:
        return pieces[0]
    axis, at = _separating_plane(pieces)
    below, above = [], []
    for piece in pieces:
        if piece.stop[axis] <= at:
            below.append(piece)
        elif piece.start[axis] >= at:
            above.append(piece)
        else:
            first, second = piece.cut(axis, at)
            below.append(first)
            above.append(second)
    return Plane(axis, at, space_partition(below), space_partition(above))


def pieces_of(tree: Plane | Piece) -> list[Piece]:
    """The pieces, some of them cut, in the tree's own order."""
    return list(front_to_back(tree, np.zeros(3)))


def front_to_back(tree: Plane | Piece, eye: NDArray[np.float64]) -> Iterator[Piece]:
    """The pieces in an order in which none hides one before it from `eye` (3,), fractional indices (z, y, x)."""
    left = [tree]
    while left:
        node = left.pop()
        if isinstance(node, Piece):
            yield node
        else:
            nearer_below = eye[node.axis] < node.at
            left += [node.above, node.below] if nearer_below else [node.below, node.above]


def _separating_plane(pieces: Sequence[Piece]) -> tuple[int, int]:
    """(axis, sample) of the plane that cuts the fewest pieces, and of these the one that halves them best."""
    boxes = np.array([[piece.start, piece.stop] for piece in pieces])  # [N, 2, 3]
    best, chosen = (len(pieces) + 1, 0), (0, 0)
    for axis in range(3):
        starts, stops = np.sort(boxes[:, 0, axis]), np.sort(boxes[:, 1, axis])
        planes = np.unique(starts)[1:]  # [P]
        if not planes.size:
            continue
        begun, ended = np.searchsorted(starts, planes), np.searchsorted(stops, planes, side="right")  # [P] each
        uneven = np.abs(begun + ended - len(pieces))  # [P], twice the pieces that one side has more
        first = int(np.lexsort((uneven, begun - ended))[0])
        score = int(begun[first] - ended[first]), int(uneven[first])
        if score < best:
            best, chosen = score, (axis, int(planes[first]))
    return chosen
