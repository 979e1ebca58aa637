"""Annotations drawn over pictures, with smooth lines and text in DejaVu Sans."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import to_float
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import POINT_PARAMETERS
from native.ray_casting.cuts import opaque
from surrogate.explore.exporting.annotations import FRONT, Annotations, Legend, Mark, Point, scale_of
from surrogate.explore.exporting.lettering import LIGHT
from surrogate.explore.facts import box_of, label_of, value_scale
from surrogate.explore.probing import field_member, value_words, values_at
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting, base_function

DPI = 72.0  # a point is a pixel
DARK, PALE = "#101216", "#f1f3f6"  # of ink


def annotations_of(run: Run, setting: Setting, parts: Sequence[str], pins: Sequence[Point] = ()) -> Annotations:
    """All that the marks of a picture of a setting say, with the field's values at `pins`, world places."""
    function = base_function(run.surrogate)
    legend = None
    if function is not None and set(setting.visualization) <= set(POINT_PARAMETERS):
        label = label_of(run, run.surrogate.base_appearance)
        transfer = setting.transfer_function(run.surrogate)
        if setting.cut is not None and setting.cut.plane is not None:
            transfer = opaque(transfer)
        legend = Legend(transfer, value_scale(run.surrogate, function), label)
    words = f"{setting.described(run.origins)} · predicted, not simulated"
    box = np.array(box_of(run))
    cut = None if setting.cut is None else setting.cut.left_of(box)
    return Annotations(run.title, words, box, legend, tuple(parts), cut, _pinned(run, setting, pins))


def _pinned(run: Run, setting: Setting, pins: Sequence[Point]) -> tuple[tuple[Point, str], ...]:
    if run.surrogate.field is None or not pins:
        return tuple((pin, "") for pin in pins)
    member = field_member(run.surrogate, setting)
    values = values_at(member.field(), pins)
    return tuple((pin, value_words(value, member.quantity.unit)) for pin, value in zip(pins, values, strict=True))


def annotated(
    picture: NDArray[Any], annotations: Annotations, camera: Camera, background: Sequence[float] | None
) -> NDArray[np.float32]:
    """The picture (H, W, 3), or (H, W, 4) of premultiplied alpha, under the marks of what `camera` sees; float32 in [0, 1].

    Ink is dark on a light `background` (straight RGB in [0, 1]) and on none.
    """
    luminance = 1.0 if background is None else float(np.dot(background, (0.2126, 0.7152, 0.0722)))  # of Rec. 709
    inks = (DARK, "#ffffff") if luminance > LIGHT else (PALE, DARK)
    layer = _layer(annotations.marks(camera), camera, scale_of(camera), inks)  # [H, W, 4]
    alpha = layer[..., 3:]
    colors = layer[..., :3] * alpha
    over = colors if picture.shape[2] == 3 else np.concatenate([colors, alpha], axis=2)
    return np.asarray(over + (1.0 - alpha) * to_float(picture), dtype=np.float32)


def all_annotated(
    images: Iterable[NDArray[Any]],
    run: Run,
    settings: Sequence[Setting],
    parts: Sequence[str],
    camera: Camera,
    background: Sequence[float],
) -> Iterator[NDArray[Any]]:
    """Pictures of settings, each under its own marks; as they are without `parts`."""
    for image, setting in zip(images, settings, strict=True):
        yield annotated(image, annotations_of(run, setting, parts), camera, background) if parts else image


def _layer(marks: Sequence[Mark], camera: Camera, scale: float, inks: tuple[str, str]) -> NDArray[np.float32]:
    """Marks alone, (H, W, 4) of straight alpha."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Rectangle
    from matplotlib.patheffects import withStroke
    from matplotlib.text import Text
    from matplotlib.transforms import Affine2D

    width, height = camera.width, camera.height
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="none")
    ink, around = inks
    downwards: Any = {"transform": Affine2D().scale(1.0, -1.0).translate(0.0, height), "figure": figure}
    artists: list[Any] = []
    for kind, place, *rest in marks:
        if kind == "rect":
            left, top, wide, tall = place
            artists.append(Rectangle((left, top), wide, tall + 0.5, facecolor=rest[0], linewidth=0, **downwards))
        elif kind == "text":
            anchor, size, text, weight = rest
            said = Text(place[0], place[1], text, **downwards)
            said.set(color=ink, size=size * scale, weight="bold" if weight > 500 else "normal", family="DejaVu Sans")
            said.set(ha={"start": "left", "middle": "center", "end": "right"}[anchor], va="center", parse_math=False)
            said.set_path_effects([withStroke(linewidth=3.0 * scale, foreground=around, alpha=0.6)])
            artists.append(said)
        else:
            xs, ys = (place[::2], place[1::2]) if kind == "line" else zip(*place, strict=True)
            line, stroke = Line2D(xs, ys, **downwards), rest[0] if rest else 1.0
            colored = isinstance(stroke, str)
            line.set(color=stroke if colored else ink, alpha=1.0 if colored else stroke, solid_capstyle="round")
            line.set(linewidth=(2.5 if colored else 1.1 if stroke >= FRONT else 1.0) * scale)
            artists.append(line)
    for artist in artists:
        artist.set_clip_on(False)
        figure.add_artist(artist)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), dtype=np.float32)[:height, :width] / 255.0
