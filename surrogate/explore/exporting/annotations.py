"""Marks on a picture: title and settings, a legend of colour and opacity, the box with ticks, and the axes.

The same geometry as `surrogate/explore/page/annotations.js`, in pixels from the picture's left top corner.  A mark is one of

    ("line", (x1, y1, x2, y2), stroke), whose stroke is an opacity or a colour;
    ("path", [(x, y), ...]);
    ("rect", (x, y, width, height), colour);
    ("text", (x, y), anchor, size, text, weight), whose x is its start, middle or end.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from surrogate.appearance.scale import ValueScale

PARTS = ("title", "legend", "box", "axes")
FRONT, BACK = 0.5, 0.2  # opacity of lines
APART, SHORTEST, TICK, NUMBER, NAME, LETTER = 64, 40, 5, 9, 24, 6  # pixels at scale 1
PIN = 9  # pixels at scale 1
SMALL, SPACE = 11, 2  # height of numbers, and pixels between two
NEAR = 1e-3  # of the box's diagonal
NAMES, AXES, ARM, CORNER = "xyz", ("#e5605e", "#4fa35f", "#5b8def"), 28, 54
LEFT, TOP, LEGEND_TOP, BAR, CURVE, STEPS, TALLEST = 18, 20, 66, 12, 26, 64, 240
LINE, MOST_LINES, WIDTH_OF_LETTER = 15, 5, 0.58  # of words below the title; a letter's share of its height

Mark = tuple[Any, ...]
Array = NDArray[np.float64]
Point = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Legend:
    """A transfer function over values on a scale, with the `label` of its field."""

    function: TransferFunction
    scale: ValueScale
    label: str = ""


@dataclass(frozen=True, eq=False)
class Annotations:
    """Everything that the marks of a picture say, and which `parts` of them are there.

    `box` is the lowest and the highest corner, (2, 3) world units, and so is `cut` of what a cut leaves of it.  There is no
    `legend` where no transfer function is shown.  `pins` are places in the world and what is said beside their numbers.
    """

    title: str
    words: str
    box: Array
    legend: Legend | None
    parts: tuple[str, ...] = PARTS
    cut: Array | None = None
    pins: tuple[tuple[Point, str], ...] = ()

    def marks(self, camera: Camera) -> list[Mark]:
        """All marks of what `camera` sees."""
        scale, size = scale_of(camera), (camera.width, camera.height)
        legend = self.legend if "legend" in self.parts else None
        lines = _lines(self.words, size[0], scale) if "title" in self.parts else []
        return [
            *(_box_marks(camera, self.box, scale) if "box" in self.parts else ()),
            *(_edge_marks(_edges(camera, self.cut)) if "box" in self.parts and self.cut is not None else ()),
            *(() if legend is None else _legend_marks(legend, size, scale, len(lines))),
            *(_axis_marks(camera, scale) if "axes" in self.parts else ()),
            *(_title_marks(self.title, lines, size, scale) if "title" in self.parts else ()),
            *_pin_marks(camera, self.pins, scale),
        ]


def scale_of(camera: Camera) -> float:
    """The size of marks in a picture."""
    return max(0.75, min(4.0, min(camera.width, camera.height) / 600.0))


def projected(camera: Camera, point: Any) -> tuple[float, float, float]:
    """Pixels and depth of a point (3,) in world units."""
    x, y, depth = camera.world_to_camera[:3, :3] @ np.asarray(point) + camera.world_to_camera[:3, 3]
    apart = depth or np.inf  # of the camera's own place nothing can be said
    return float(camera.cx + camera.fx * x / apart), float(camera.cy + camera.fy * y / apart), float(depth)


# ---- the box


@dataclass(frozen=True, eq=False)
class _Edge:
    """An edge of the box; two faces meet in it, and it is seen where one of them is."""

    axis: int
    start: Array
    stop: Array
    front: bool
    outline: bool
    ends: tuple[tuple[float, ...], tuple[float, ...]] | None  # on the picture; None behind the camera


def _box_marks(camera: Camera, box: Array, scale: float) -> list[Mark]:
    edges = _edges(camera, box)
    lines = _edge_marks(edges)
    center = projected(camera, box.mean(axis=0))
    ticks = (_ticks([e for e in edges if e.axis == axis], axis, camera, center, scale) for axis in range(3))
    return lines + _readable([mark for marks in ticks for mark in marks], scale)


def _readable(marks: Sequence[Mark], scale: float) -> list[Mark]:
    """The marks without numbers that would lie over a text before them: axes end in the same corners."""
    places: list[Array] = []
    left: list[Mark] = []
    for mark in marks:
        if mark[0] == "text":
            place = _extent(mark, scale)
            if mark[3] == SMALL and any(_overlap(place, other) for other in places):
                continue
            places.append(place)
        left.append(mark)
    return left


def _extent(mark: Mark, scale: float) -> Array:
    """The lowest and the highest corner of a text, (2, 2) pixels."""
    _, (x, y), anchor, letter, text, _ = mark
    width, space = WIDTH_OF_LETTER * letter * scale * len(text), SPACE * scale
    left, half = x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor], letter * scale / 2
    return np.array([[left - space, y - half], [left + width + space, y + half]])


def _overlap(first: Array, second: Array) -> bool:
    return bool((first[0] < second[1]).all() and (second[0] < first[1]).all())


def _edge_marks(edges: Sequence[_Edge]) -> list[Mark]:
    return [("line", (*e.ends[0][:2], *e.ends[1][:2]), FRONT if e.front else BACK) for e in edges if e.ends is not None]


def _edges(camera: Camera, box: Array) -> list[_Edge]:
    eye, edges, near = camera.position, [], NEAR * float(np.linalg.norm(box[1] - box[0]))
    faces = [(bool(eye[axis] < box[0, axis]), bool(eye[axis] > box[1, axis])) for axis in range(3)]  # seen from outside
    for axis in range(3):
        a, b = (other for other in range(3) if other != axis)
        for corner in range(4):
            sides = corner & 1, corner >> 1
            start = box[0].copy()
            start[a], start[b] = box[sides[0], a], box[sides[1], b]
            stop = start.copy()
            stop[axis] = box[1, axis]
            first, second = faces[a][sides[0]], faces[b][sides[1]]
            ends = _clipped(camera, start, stop, near)
            edges.append(_Edge(axis, start, stop, first or second, first != second, ends))
    return edges


def _clipped(camera: Camera, start: Array, stop: Array, near: float) -> tuple[Any, Any] | None:
    """Both ends on the picture, cut where the edge passes the camera."""
    first, last = projected(camera, start)[2], projected(camera, stop)[2]
    if max(first, last) <= near:
        return None
    cut = start if min(first, last) > near else start + (near - first) / (last - first) * (stop - start)
    return projected(camera, start if first > near else cut), projected(camera, stop if last > near else cut)


def _ticks(edges: Sequence[_Edge], axis: int, camera: Camera, center: Sequence[float], scale: float) -> list[Mark]:
    """Ticks, numbers and the name of an axis along the outline's edge that lies lowest, or for z rightmost, on the picture."""
    best: _Edge | None = None
    for edge in edges:
        before = projected(camera, edge.start)[2] > 0 and projected(camera, edge.stop)[2] > 0
        if edge.outline and before and (best is None or _reach(edge, axis) > _reach(best, axis) + 1e-9):
            best = edge
    if best is None or best.ends is None:
        return []
    (ax, ay, _), (bx, by, _) = best.ends
    length = math.hypot(bx - ax, by - ay)
    if length < SHORTEST * scale:
        return []
    out = (ay - by) / length, (bx - ax) / length
    if out[0] * (ax - center[0]) + out[1] * (ay - center[1]) < 0:
        out = -out[0], -out[1]
    anchor = "middle" if abs(out[0]) < 0.5 else "start" if out[0] > 0 else "end"

    def beside(x: float, y: float, pixels: float) -> tuple[float, float]:
        return x + pixels * scale * out[0], y + pixels * scale * out[1]

    most = max(1, math.floor(length / (APART * scale)))
    values, texts = nice_numbers(float(best.start[axis]), float(best.stop[axis]), most)
    marks: list[Mark] = []
    for value, text in zip(values, texts, strict=True):
        point = best.start.copy()
        point[axis] = value
        x, y, _ = projected(camera, point)
        marks.append(("line", (x, y, *beside(x, y, TICK)), FRONT))
        marks.append(("text", beside(x, y, NUMBER + (4 if anchor == "middle" else 0)), anchor, SMALL, text, 400))
    far = NAME + 6 + (0 if anchor == "middle" else LETTER * max(map(len, texts), default=0))
    return [*marks, ("text", beside((ax + bx) / 2, (ay + by) / 2, far), "middle", 13, NAMES[axis], 600)]


def _reach(edge: _Edge, axis: int) -> float:
    assert edge.ends is not None
    order = 0 if axis == 2 else 1
    return edge.ends[0][order] + edge.ends[1][order]


def nice_numbers(low: float, high: float, most: int) -> tuple[list[float], list[str]]:
    """At most `most` + 1 round numbers from low to high, 1, 2 or 5 times a power of ten apart, and their texts."""
    least = (high - low) / most
    power = 10.0 ** math.floor(math.log10(least))
    step = next(times for times in (1, 2, 5, 10) if times * power >= least * (1 - 1e-9)) * power
    slack = 1e-9 * (high - low)
    first, last = math.ceil((low - slack) / step), math.floor((high + slack) / step)
    values = [k * step for k in range(first, last + 1)]
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    if decimals <= 4 and max(abs(low), abs(high)) < 1e5:
        texts = [f"{value + 0.0:.{decimals}f}" for value in values]
    else:
        largest = max(map(abs, values), default=0.0) or step
        digits = max(2, math.floor(math.log10(largest) + 1e-9) - math.floor(math.log10(step) + 1e-9))
        texts = [f"{value + 0.0:.{digits}e}".replace("e-0", "e-").replace("e+0", "e+") for value in values]
    return values, [text.replace("-", "\N{MINUS SIGN}") for text in texts]


# ---- legend, axes, title


def _legend_marks(legend: Legend, size: tuple[int, int], scale: float, lines: int) -> list[Mark]:
    top, tall, left = (
        (LEGEND_TOP + LINE * max(0, lines - 1)) * scale,
        min(TALLEST * scale, 0.45 * size[1]),
        LEFT * scale,
    )
    if tall < 3 * SHORTEST * scale:
        return []

    def y(place: float) -> float:
        return top + tall * (1 - place)

    def x(share: float) -> float:
        return left + (BAR + 4 + CURVE * share) * scale

    colors = legend.function.colors(legend.scale.values((np.arange(STEPS) + 0.5) / STEPS))  # [STEPS, 3]
    places = np.arange(STEPS + 1) / STEPS
    opacities = legend.function.opacities(legend.scale.values(places))  # [STEPS + 1]
    marks: list[Mark] = [
        ("rect", (left, y((i + 1) / STEPS), BAR * scale, tall / STEPS), _hexadecimal(color))
        for i, color in enumerate(colors)
    ]
    marks.append(("line", (x(0), y(0), x(0), y(1)), BACK))
    path = [(x(share), y(place)) for share, place in zip(opacities.tolist(), places.tolist(), strict=True)]
    marks.append(("path", path))
    free, knots = math.inf, legend.scale.knots.tolist()
    for i, knot in enumerate(knots):
        at, last = y(float(legend.scale.places(knot))), i == len(knots) - 1
        if at > free or (not last and at < y(1) + 15 * scale):
            continue
        free = at - 15 * scale
        text = f"{float(f'{knot:.3g}'):.12g}".replace("-", "\N{MINUS SIGN}")
        marks.append(("line", (left, at, left + BAR * scale, at), FRONT))
        marks.append(("text", (x(1) + 6 * scale, at), "start", 11, text, 400))
    label = f"{legend.label}, line: opacity" if legend.label else "line: opacity"
    return [*marks, ("text", (left, y(0) + 18 * scale), "start", 11, label, 400)]


def _pin_marks(camera: Camera, pins: Sequence[tuple[Point, str]], scale: float) -> list[Mark]:
    marks: list[Mark] = []
    angles = np.linspace(0.0, 2.0 * math.pi, 25).tolist()
    for number, (place, words) in enumerate(pins, start=1):
        x, y, depth = projected(camera, place)
        if not (depth > 0.0 and 0.0 <= x <= camera.width and 0.0 <= y <= camera.height):
            continue
        marks.append(("path", [(x + PIN * scale * math.cos(a), y + PIN * scale * math.sin(a)) for a in angles]))
        marks.append(("text", (x, y), "middle", 11, str(number), 700))
        marks.append(("text", (x + (PIN + 5) * scale, y), "start", 12, words, 400))
    return marks


def _axis_marks(camera: Camera, scale: float) -> list[Mark]:
    x, y = camera.width - CORNER * scale, camera.height - CORNER * scale
    tips = [(ARM * scale * right, ARM * scale * down, ahead) for right, down, ahead in camera.rotation.T.tolist()]
    marks: list[Mark] = []
    for k in sorted(range(3), key=lambda k: -tips[k][2]):
        right, down, _ = tips[k]
        marks.append(("line", (x, y, x + right, y + down), AXES[k]))
        marks.append(("text", (x + 1.35 * right, y + 1.35 * down), "middle", 12, NAMES[k], 700))
    return marks


def _lines(words: str, width: int, scale: float) -> list[str]:
    """Settings in lines that are no wider than a picture, broken between them."""
    most, lines = _letters_in(width, scale, 12), list[str]()
    for part in re.split(r" (?=·)|(?<=,) ", words):
        if lines and len(f"{lines[-1]} {part}") <= most:
            lines[-1] += f" {part}"
        else:
            lines.append(part.removeprefix("· "))
    if len(lines) > MOST_LINES:
        lines[MOST_LINES - 1] += " …"
    return [_short(line, most) for line in lines[:MOST_LINES]]


def _title_marks(title: str, lines: Sequence[str], size: tuple[int, int], scale: float) -> list[Mark]:
    texts = [(0, 16, _short(title, _letters_in(size[0], scale, 16)), 650)]
    texts += [(21 + LINE * i, 12, line, 400) for i, line in enumerate(lines)]
    return [
        ("text", (LEFT * scale, (TOP + below) * scale), "start", letter, text, weight)
        for below, letter, text, weight in texts
    ]


def _letters_in(width: int, scale: float, letter: int) -> int:
    return max(8, math.floor((width / scale - 2 * LEFT) / (WIDTH_OF_LETTER * letter)))


def _short(text: str, most: int) -> str:
    return f"{text[: most - 1]}…" if len(text) > most else text


def _hexadecimal(color: Sequence[float]) -> str:
    return "#" + "".join(f"{math.floor(255.0 * min(1.0, max(0.0, part)) + 0.5):02x}" for part in color)
