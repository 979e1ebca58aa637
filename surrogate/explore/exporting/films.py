"""Films: animated GIF, or MP4."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import to_bytes
from surrogate.explore.exporting.kinds import FRAMES_PER_SECOND

SLOWEST, FASTEST = 0.5, 50.0  # browsers show GIFs of more than 50 pictures a second at 10
CONSTANT_RATE_FACTOR = 18  # of x264: hardly distinguishable from the original
BT709, LIMITED = 1, 1  # ITU-T H.273: what players take a film's colours for, and what these are converted to


def film_bytes(
    kind: Literal["gif", "mp4"],
    pictures: Iterable[NDArray[Any]],
    *,
    frames_per_second: float = FRAMES_PER_SECOND,
    there_and_back: bool = False,
    go_on: Callable[[], Any] = lambda: None,
) -> bytes:
    """Images (H, W, 3) in [0, 1], or uint8, as a film.

    With `there_and_back` it runs backwards from the last image, each end once.  `go_on` is called before each image is written;
    an error that it raises ends the film.

    "gif" is endless.  Each image has a palette of its own: 256 colours by median cut (Heckbert 1982), without dithering, which
    costs 2 to 7 dB on volume renderings.  An image of 256² takes 0.1 s.  Times are rounded to 1/100 s.

    "mp4" is H.264 that browsers and QuickTime play.  Colours have half the resolution (4:2:0, Rec. 709): nothing else plays
    everywhere.  An image of odd width or height repeats its last column or row.  Written by PyAV itself: imageio (2.38) offers
    neither the colour matrix nor odd sizes, and its films are 8 dB worse.

    Raises ValueError for fewer than two images, images of different shapes, or a rate that is not in 0.5 to 50 a second.  For MP4
    it raises it where PyAV is not installed or has no H.264 encoder, too.
    """
    if not SLOWEST <= frames_per_second <= FASTEST:
        raise ValueError(f"a film has {SLOWEST:g} to {FASTEST:g} pictures a second, got {frames_per_second:g}")
    if kind == "mp4":
        _check_encoder()
    frames: Iterable[NDArray[np.uint8]] = _checked(pictures)
    if there_and_back:
        forwards = list(frames)
        frames = forwards + forwards[-2:0:-1]
    stream, write = io.BytesIO(), _write_gif if kind == "gif" else _write_mp4
    write(stream, _watched(frames, go_on), frames_per_second)
    return stream.getvalue()


def _write_gif(stream: io.BytesIO, frames: Iterator[NDArray[np.uint8]], frames_per_second: float) -> None:
    from PIL import Image

    images, milliseconds = map(Image.fromarray, frames), 10 * round(100.0 / frames_per_second)
    next(images).save(stream, "GIF", save_all=True, append_images=images, duration=milliseconds, loop=0)


def _check_encoder() -> None:
    try:
        import av
    except ModuleNotFoundError:
        raise ValueError("MP4 films need PyAV: pip install 'gs-surrogate[video]', or make a GIF") from None
    if "libx264" not in av.codecs_available:
        raise ValueError("this PyAV has no H.264 encoder: pip install 'gs-surrogate[video]' afresh, or make a GIF")


def _write_mp4(stream: io.BytesIO, frames: Iterator[NDArray[np.uint8]], frames_per_second: float) -> None:
    import av
    from av.video.reformatter import ColorRange, Colorspace

    rate = Fraction(frames_per_second).limit_denominator(1000)
    with av.open(stream, "w", format="mp4") as container:
        track: Any = container.add_stream("libx264", rate=rate, options={"crf": str(CONSTANT_RATE_FACTOR)})
        track.pix_fmt = "yuv420p"
        context = track.codec_context
        context.colorspace, context.color_primaries, context.color_trc = BT709, BT709, BT709
        context.color_range = LIMITED
        for frame in frames:
            height, width = frame.shape[:2]
            even = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            if not context.is_open:
                track.height, track.width = even.shape[:2]
            image = av.VideoFrame.from_ndarray(even, format="rgb24")
            converted = image.reformat(
                format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
            )
            container.mux(track.encode(converted))
        container.mux(track.encode())


def _watched(frames: Iterable[Any], go_on: Callable[[], Any]) -> Iterator[Any]:
    for frame in frames:
        go_on()
        yield frame


def _checked(pictures: Iterable[NDArray[Any]]) -> Iterator[NDArray[np.uint8]]:
    """The images as contiguous uint8; raises ValueError where they make no film."""
    shape: tuple[int, ...] = ()
    count = 0
    for picture in pictures:
        shape = shape or picture.shape
        if picture.shape != shape or picture.ndim != 3 or picture.shape[2] != 3 or 0 in picture.shape:
            raise ValueError(f"a film consists of pictures [H, W, 3] of one size, got {shape} and {picture.shape}")
        count += 1
        yield np.ascontiguousarray(to_bytes(picture))
    if count < 2:
        raise ValueError(f"a film consists of two pictures or more, got {count}")
