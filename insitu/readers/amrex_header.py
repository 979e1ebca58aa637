"""The headers of an AMReX plotfile, checked against each other and against the files before any value is read.

A plotfile is a folder: `Header`, and in `Level_0`, `Level_1`, ... a file `Cell_H` beside binary files of boxes (AMReX
documentation, "Plotfile format"; `AMReX_PlotFileUtil.cpp`, `AMReX_VisMF.cpp`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import joined_names

VERSION = re.compile(r"(HyperCLaw|NavierStokes)-V\d+\.\d+")
LARGEST = 1 << 28  # bytes of a header
MOST_CELLS = 1 << 21  # along an axis
MOST_BLOCKS = 1 << 26  # into which the boxes of a level cut its domain, when that is checked to be full
LINE = 1 << 12  # bytes
BOX = r"\(\((-?\d+),(-?\d+),(-?\d+)\) \((-?\d+),(-?\d+),(-?\d+)\) \((\d+),(\d+),(\d+)\)\)"
FAB = re.compile(r"FAB \(\((\d+), \(([\d ]+)\)\),\((\d+), \(([\d ]+)\)\)\)(" + BOX + r") (\d+)\n")
EPSILON = float(np.finfo(np.float64).eps)
PRINTED = 1e-5  # relative rounding of an extreme that a header prints, in writers of few digits
IEEE = {"64 11 52 0 1 12 0 1023": 8, "32 8 23 0 1 9 0 127": 4}  # bytes of a number by its description


@dataclass(frozen=True, eq=False)
class RefinementLevel:
    """A level of refinement.

    Attributes
    ----------
    low, counts : the first cell and the number of cells of its domain, (x, y, z).
    boxes : [boxes, 2, 3], the first and the last cell of each.
    places : the file of each box, and the byte at which its numbers begin: by component, in the order z, y, x.
    extremes : lines of the minima and of the maxima of each box, a number for each component; none where they are left out.
    """

    low: tuple[int, int, int]
    counts: tuple[int, int, int]
    boxes: NDArray[np.int64]  # [B, 2, 3]
    places: tuple[tuple[Path, int], ...]
    extremes: tuple[tuple[str, ...], tuple[str, ...]] | None

    def check_extremes(self, box: int, component: int, ends: tuple[np.floating, np.floating], has_nan: bool) -> None:
        """Raise ValueError where the least and the largest of a box's numbers but NaN are not those that its header prints."""
        kind, what = ends[0].dtype.type, f"{self.places[box][0].parent.name}/Cell_H: box {box}"
        if self.extremes is None:
            return
        try:
            least, most = (float(lines[box].split(",")[component]) for lines in self.extremes)
        except ValueError:
            raise ValueError(f"{what} must have numbers as its minima and maxima") from None
        limits = np.finfo(kind)
        with np.errstate(over="ignore", invalid="ignore"):
            said = np.array([least, most]).astype(kind)
            same = np.isclose(said, ends, PRINTED, float(limits.tiny))
        if has_nan:  # which a code's comparisons may pass over, or not
            same |= np.isnan(said) | (np.isnan(ends) & (np.abs(said) >= limits.max))
        if not same.all():
            raise ValueError(
                f"{what} lies from {least:g} to {most:g}, its numbers from {ends[0]:g} to {ends[1]:g}: they are damaged, or in "
                "another order of bytes"
            )


@dataclass(frozen=True, eq=False)
class Plotfile:
    """The contents of a plotfile's headers.

    Attributes
    ----------
    names : of the components, the fields.
    low, high : corners of the domain, (x, y, z), world units.
    kind : of all values, 4 or 8 bytes in either order.
    """

    path: Path
    names: tuple[str, ...]
    time: float
    low: tuple[float, ...]
    high: tuple[float, ...]
    levels: tuple[RefinementLevel, ...]
    kind: np.dtype[np.floating]

    def planes(self, level: RefinementLevel, box: int, component: int, start: int, stop: int) -> NDArray[np.floating]:
        """Cells [stop - start, ny, nx] of a component in a box's planes; raises ValueError where the file has become shorter."""
        (path, begin), (nx, ny, nz) = level.places[box], (level.boxes[box, 1] - level.boxes[box, 0] + 1).tolist()
        offset, count = begin + self.kind.itemsize * nx * ny * (component * nz + start), nx * ny * (stop - start)
        cells = np.fromfile(path, self.kind, count, offset=offset)
        if cells.size != count:
            raise ValueError(f"{path.parent.name}/{path.name}: box {box} ends too early: is it being written?")
        return cells.reshape(stop - start, ny, nx)


def is_plotfile(path: Path) -> bool:
    """True if a folder is an AMReX plotfile of cells, by the first line of its header."""
    try:
        if not (path / "Level_0" / "Cell_H").is_file() or not (path / "Header").is_file():
            return False
        with (path / "Header").open("rb") as file:
            return VERSION.fullmatch(file.readline(64).decode("latin-1").strip()) is not None
    except OSError:
        return False


@dataclass(frozen=True)
class Summary:
    """The beginning of a `Header`: all but the boxes; `rest` are the lines that follow."""

    names: tuple[str, ...]
    time: float
    finest: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    domains: tuple[tuple[tuple[int, int, int], tuple[int, int, int]], ...]
    rest: tuple[str, ...]


def read_summary(path: Path) -> Summary:
    """The beginning of a plotfile's header; raises ValueError naming what is wrong with it."""
    lines = _lines(path / "Header")
    if VERSION.fullmatch(next(lines, "").strip()) is None:
        raise ValueError("Header: its first line is not the version of a plotfile, such as HyperCLaw-V1.1")
    count = _whole(next(lines, ""), "Header: the number of fields", 1, 100_000)
    names = tuple(next(lines, "").strip() for _ in range(count))
    if not all(names) or len(set(names)) < count:
        raise ValueError(f"Header: {count} fields must have names, each another")
    if _whole(next(lines, ""), "Header: the number of dimensions", 1, 3) != 3:
        raise ValueError("Header: it has fewer than 3 dimensions, and so no volume")
    (time,) = _reals(next(lines, ""), "Header: the time", 1)
    finest = _whole(next(lines, ""), "Header: the finest level", 0, 30)
    low, high = (_reals(next(lines, ""), f"Header: the {end} corner of the domain", 3) for end in ("low", "high"))
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise ValueError(f"Header: the domain from {low} to {high} is empty")
    ratios = [_whole(word, "Header: a refinement ratio", 1, 64) for word in re.findall(r"[^\s(),]+", next(lines, ""))]
    domains = _domains(next(lines, ""), finest, ratios)
    next(lines, "")  # steps of each level
    for level in range(finest + 1):
        steps = _reals(next(lines, ""), f"Header: the cell size of level {level}", 3)
        stated = [(b - a) / n for a, b, n in zip(low, high, domains[level][1], strict=True)]
        rounding = 8 * EPSILON * max(map(abs, (*low, *high)))  # of the corners, far from zero more than a cell's
        if not np.allclose(steps, stated, rtol=1e-6, atol=rounding):
            raise ValueError(
                f"Header: cells of level {level} are {steps} wide, but the domain's extent and counts say {stated}"
            )
    if next(lines, "").strip() != "0":
        raise ValueError("Header: its coordinates are not Cartesian, which alone can be rendered")
    next(lines, "")
    return Summary(names, time, finest, low, high, domains, tuple(lines))


def read_plotfile(path: Path) -> Plotfile:
    """All headers of a plotfile; raises ValueError naming the file and what is wrong, OSError where one can't be read."""
    summary = read_summary(path)
    lines = iter(summary.rest)
    levels, kinds = [], set()
    for number in range(summary.finest + 1):
        words = next(lines, "").split()
        if len(words) != 3 or words[0] != str(number):
            raise ValueError(f"Header: level {number}, its boxes and time must follow, got {' '.join(words)[:40]!r}")
        count = _whole(words[1], f"Header: the number of boxes of level {number}", 1, len(summary.rest) // 3)
        next(lines, "")  # step
        for _ in range(3 * count):  # the boxes' corners in world units, which follow from their cells
            next(lines, "")
        name = next(lines, "").strip()
        if name != f"Level_{number}/Cell":
            raise ValueError(
                f"Header: 'Level_{number}/Cell' must follow the boxes of level {number}, got {name[:40]!r}"
            )
        low, counts = summary.domains[number]
        boxes, places, extremes = _boxes(path, number, count, len(summary.names))
        _check_inside(boxes, low, counts, number)
        types, begins = _numbers(path, number, boxes, places, len(summary.names))
        kinds |= types
        levels.append(RefinementLevel(low, counts, boxes, begins, extremes))
    _check_full(levels[0])
    if len(kinds) > 1:
        raise ValueError(f"its boxes hold numbers of several kinds, {joined_names(sorted(map(str, kinds)))}")
    return Plotfile(path, summary.names, summary.time, summary.low, summary.high, tuple(levels), kinds.pop())


def _domains(
    line: str, finest: int, ratios: Sequence[int]
) -> tuple[tuple[tuple[int, int, int], tuple[int, int, int]], ...]:
    """(first cell, counts) of the domain of each level, which must follow from the refinement ratios."""
    boxes = [tuple(map(int, groups)) for groups in re.findall(BOX, line)]
    if len(boxes) < finest + 1:
        raise ValueError(f"Header: the domains of {finest + 1} levels are needed, got {line[:60]!r}")
    domains: list[tuple[Any, Any]] = []
    for number, box in enumerate(boxes[: finest + 1]):
        low, counts = box[:3], tuple(b - a + 1 for a, b in zip(box[:3], box[3:6], strict=True))
        if box[6:] != (0, 0, 0) or not all(2 <= n <= MOST_CELLS for n in counts) or max(map(abs, low)) > MOST_CELLS:
            raise ValueError(
                f"Header: the domain of level {number} must hold cells, 2 to {MOST_CELLS} along an axis, got {box}"
            )
        if number:
            ratio = ratios[number - 1] if number <= len(ratios) else 2  # which Nyx may leave out
            before = domains[-1]
            if low != tuple(ratio * n for n in before[0]) or counts != tuple(ratio * n for n in before[1]):
                raise ValueError(
                    f"Header: the domain of level {number} is not {ratio} times that of level {number - 1}"
                )
        domains.append((low, counts))
    return tuple(domains)


def _boxes(
    path: Path, number: int, count: int, components: int
) -> tuple[NDArray[np.int64], list[tuple[str, int]], tuple[tuple[str, ...], tuple[str, ...]] | None]:
    """The boxes [B, 2, 3] of a level, the file and the byte at which each begins, and the lines of minima and maxima."""
    what = f"Level_{number}/Cell_H"
    lines = _lines(path / f"Level_{number}" / "Cell_H")
    _whole(next(lines, ""), f"{what}: its version", 1, 1)
    _whole(next(lines, ""), f"{what}: how it was written", 0, 10)
    stated = _whole(next(lines, ""), f"{what}: the number of components", 1, 100_000)
    ghosts = re.findall(r"\d+", next(lines, ""))
    begin = re.fullmatch(r"\((\d+) 0", next(lines, "").strip())
    if stated != components or any(int(n) for n in ghosts) or begin is None or int(begin[1]) != count:
        raise ValueError(
            f"{what}: it must have {components} components, no ghost cells and {count} boxes, as Header says"
        )
    boxes = np.empty((count, 2, 3), dtype=np.int64)
    for i in range(count):
        match = re.fullmatch(BOX, next(lines, "").strip())
        numbers = [int(word) for word in match.groups()] if match and len(match[0]) < 100 else []
        if not numbers or any(numbers[6:]) or max(map(abs, numbers)) > MOST_CELLS * 64:
            raise ValueError(f"{what}: box {i} must hold cells, ((x,y,z) (x,y,z) (0,0,0))")
        boxes[i] = np.reshape(numbers[:6], (2, 3))
    if next(lines, "").strip() != ")" or next(lines, "").strip() != str(count):
        raise ValueError(f"{what}: ) and {count} must follow its boxes")
    places = []
    for i in range(count):
        place = re.fullmatch(r"FabOnDisk: (Cell_D_\d+) (\d{1,18})", next(lines, "").strip())
        if place is None:
            raise ValueError(f"{what}: where box {i} lies must follow, as 'FabOnDisk: Cell_D_00000 0'")
        places.append((place[1], int(place[2])))
    return boxes, places, _extremes(lines, what, count, components)


def _extremes(
    lines: Iterator[str], what: str, count: int, components: int
) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """The lines of minima and of maxima, a box each, at the end of a header; None where it ends before them."""
    tables: list[tuple[str, ...]] = []
    for name in ("minima", "maxima"):
        blank, head = next(lines, "").strip(), next(lines, "").strip()
        if not tables and not blank and not head:
            return None
        rows = tuple(next(lines, "").strip() for _ in range(count))
        if blank or head != f"{count},{components}" or any(row.count(",") != components for row in rows):
            raise ValueError(f"{what}: the {name} of {count} boxes and {components} components must follow")
        tables.append(rows)
    return tables[0], tables[1]


def _check_inside(boxes: NDArray[np.int64], low: Sequence[int], counts: Sequence[int], number: int) -> None:
    high = np.add(low, counts) - 1
    wrong = (boxes[:, 0] < low).any(axis=1) | (boxes[:, 1] > high).any(axis=1) | (boxes[:, 0] > boxes[:, 1]).any(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise ValueError(f"Level_{number}/Cell_H: box {first}, {boxes[first].tolist()}, is empty or leaves the domain")


def _check_full(level: RefinementLevel) -> None:
    """Raise ValueError unless the boxes of the coarsest level fill its domain, each cell once."""
    edges = [np.unique(np.concatenate([level.boxes[:, 0, a], level.boxes[:, 1, a] + 1])) for a in range(3)]
    cells = int(np.prod(level.boxes[:, 1] - level.boxes[:, 0] + 1, axis=1).sum())
    is_full = cells == math.prod(level.counts)
    if is_full and math.prod(map(len, edges)) <= MOST_BLOCKS:
        covered = np.zeros([len(edge) - 1 for edge in edges], dtype=bool)
        first, last = (
            np.stack([np.searchsorted(edges[a], level.boxes[:, e, a] + e) for a in range(3)], 1) for e in (0, 1)
        )
        for low, high in zip(first.tolist(), last.tolist(), strict=True):
            covered[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
        is_full = bool(covered.all())
    if not is_full:
        raise ValueError(
            f"Level_0/Cell_H: its boxes of {cells} cells do not fill the domain of {math.prod(level.counts)} cells"
        )


def _numbers(
    path: Path, number: int, boxes: NDArray[np.int64], places: Sequence[tuple[str, int]], components: int
) -> tuple[set[np.dtype[np.floating]], tuple[tuple[Path, int], ...]]:
    """The kinds of numbers in the boxes, and where those of each begin; raises ValueError for a box that is not whole."""
    folder, kinds, begins = path / f"Level_{number}", set(), dict[int, tuple[Path, int]]()
    for name in sorted({name for name, _ in places}):
        what = f"Level_{number}/{name}"
        if not (folder / name).is_file() or not (folder / name).resolve().is_relative_to(path.resolve()):
            raise ValueError(f"{what}: there is no such file in the plotfile")
        size = (folder / name).stat().st_size
        with (folder / name).open("rb") as file:
            for i in (i for i, place in enumerate(places) if place[0] == name):
                file.seek(places[i][1])
                match = FAB.fullmatch(file.readline(LINE).decode("latin-1"))
                if match is None or list(map(int, match.groups()[5:11])) != boxes[i].ravel().tolist():
                    raise ValueError(f"{what}: box {i} does not begin at byte {places[i][1]}: is it being written?")
                kind = _kind(match)
                cells = int(np.prod(boxes[i, 1] - boxes[i, 0] + 1))
                if kind is None or int(match[15]) != components or any(map(int, match.groups()[11:14])):
                    raise ValueError(f"{what}: box {i} must hold {components} components of IEEE numbers on cells")
                if file.tell() + cells * components * kind.itemsize > size:
                    raise ValueError(f"{what}: box {i} ends behind the file's {size} bytes: is it being written?")
                kinds.add(kind)
                begins[i] = folder / name, file.tell()
    return kinds, tuple(begins[i] for i in range(len(places)))


def _kind(match: re.Match[str]) -> np.dtype[np.floating] | None:
    """The numbers that the description of a box means: IEEE in one of two orders; None for others."""
    size = IEEE.get(match[2])
    order = [int(word) for word in match[4].split()]
    if size is None or match[3] != str(size) or int(match[1]) != len(match[2].split()):
        return None
    if order == list(range(1, size + 1)):
        return np.dtype(f">f{size}")
    return np.dtype(f"<f{size}") if order == list(range(size, 0, -1)) else None


def _lines(path: Path) -> Iterator[str]:
    """The lines of a header; raises ValueError where it is too large for one."""
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path.name}: it has {path.stat().st_size} bytes, more than a header")
    with path.open("rb") as file:
        while line := file.readline(LARGEST):
            yield line.decode("latin-1")


def _whole(text: str, what: str, least: int, most: int) -> int:
    word = text.strip()
    if not re.fullmatch(r"\d{1,18}", word) or not least <= int(word) <= most:
        raise ValueError(f"{what} must be a whole number from {least} to {most}, got {word[:40]!r}")
    return int(word)


def _reals(text: str, what: str, count: int) -> tuple[float, ...]:
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise ValueError(f"{what} must be {count} finite numbers, got {text.strip()[:60]!r}")
    return values
