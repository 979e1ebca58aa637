"""The gallery: each example runs, stays short, and draws its stored picture.

`python -m tests.test_gallery NAME ...` stores the pictures of these examples anew, of all without names; look at them.
"""

from __future__ import annotations

import io
import runpy
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from numpy.typing import NDArray

from surrogate.evaluation.metrics import psnr

GALLERY = Path(__file__).resolve().parent.parent / "examples" / "gallery"
EXPECTED = GALLERY / "expected"
EXAMPLES = sorted(GALLERY.glob("plot_*.py"))
LEAST = 40.0  # dB, of whole figures
TRAINED = {"plot_gaussians": 25.0}  # what a short training draws may differ between processors
MOST_LINES, MOST_BYTES, DOTS_PER_INCH = 40, 20_000, 40


def figure_of(example: Path) -> bytes:
    """The one figure that an example makes, as PNG."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.close("all")
    sys.path.insert(0, str(GALLERY))  # as the site's build does
    try:
        runpy.run_path(str(example))
    finally:
        sys.path.remove(str(GALLERY))
    (number,) = pyplot.get_fignums()
    stream = io.BytesIO()
    pyplot.figure(number).savefig(
        stream, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None}, pil_kwargs={"optimize": True}
    )
    pyplot.close("all")
    return stream.getvalue()


def pixels(png: bytes) -> NDArray[np.float32]:
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=np.float32) / 255.0


def store(names: list[str]) -> None:
    """Writes the expected pictures."""
    EXPECTED.mkdir(exist_ok=True)
    for example in EXAMPLES:
        if not names or example.stem.removeprefix("plot_") in names:
            (EXPECTED / f"{example.stem}.png").write_bytes(figure_of(example))


def test_there_are_twenty_short_examples_each_with_its_small_picture() -> None:
    assert len(EXAMPLES) >= 20
    for example in EXAMPLES:
        lines = example.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= MOST_LINES, f"{example.name} has {len(lines)} lines"
    pictures = sorted(EXPECTED.glob("*.png"))
    assert [picture.stem for picture in pictures] == [example.stem for example in EXAMPLES]
    for picture in pictures:
        assert picture.stat().st_size <= MOST_BYTES, picture.name


def test_three_examples_embed_a_page() -> None:
    assert sum("iframe" in example.read_text(encoding="utf-8") for example in EXAMPLES) >= 3


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=[example.stem for example in EXAMPLES])
def test_an_example_draws_its_stored_picture(example: Path) -> None:
    stored = pixels((EXPECTED / f"{example.stem}.png").read_bytes())
    drawn = pixels(figure_of(example))
    assert drawn.shape == stored.shape
    assert psnr(stored, drawn) >= TRAINED.get(example.stem, LEAST)


if __name__ == "__main__":
    store(sys.argv[1:])
