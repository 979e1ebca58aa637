"""Draw an image of each case of the README's gallery and write its figures beneath, from catalogs and records.

    python -m research.benchmarks.results.gallery [--runs runs] [--records research/records]

A picture is a stored one of a test member, at 256 x 256 pixels on white; where a scene's catalog is not in `--runs` its earlier
picture stays.  Writes docs/pictures/gallery_<scene>.png and the table in README.md; seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from catalogs.files import durable
from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from research.benchmarks.page import PICTURES, PROJECT, command_line, fill, table
from research.benchmarks.results.parts import parts_of
from research.benchmarks.results.scenes import SceneResults, read_scene

MEANING = (
    "PSNR at unseen views and parameters; *mixed*: of the best mix of stored images, from the very same view "
    "([details](docs/results/results.md))."
)
PIXELS = 256
UNSEEN = "unseen_views", "unseen_parameters"


class GalleryCase(NamedTuple):
    """A scene of the gallery: its description in Markdown, and the view that is shown."""

    scene: str
    what: str
    view: int


CASES = (
    GalleryCase("tgv", "Taylor-Green vortex: Reynolds number, time", 25),
    GalleryCase("cloverleaf", "CloverLeaf3D's files: six parameters", 23),
    GalleryCase("nyx", "Nyx images: three parameters", 1),
    GalleryCase("euler", "PyClaw, [hooked](docs/results/examples.md): six parameters", 23),
    GalleryCase("ocean", "Veros, [hooked](docs/results/examples.md): four parameters", 11),
)


def shown_member(members: Iterable[Member]) -> Member:
    """The test member in the middle of the test members' order, or of all members' where none tests.

    Raises ValueError where there is none at all.
    """
    every = list(members)
    tested = [member for member in every if member.split == "test"] or every
    if not tested:
        raise ValueError("the catalog has no members: there is nothing to show")
    return tested[len(tested) // 2]


def on_white(premultiplied: np.ndarray) -> Image.Image:
    """A picture (height, width, 4), float with premultiplied colours, on white at the gallery's size."""
    straight = premultiplied[..., :3] + (1.0 - premultiplied[..., 3:])
    picture = Image.fromarray(np.round(255.0 * np.clip(straight, 0.0, 1.0)).astype(np.uint8), "RGB")
    return picture.resize((PIXELS, PIXELS), Image.Resampling.LANCZOS)


def draw(catalog: Catalog, view: int, path: Path) -> None:
    """Write the picture of one view, the first appearance, as PNG."""
    member = shown_member(catalog.members)
    content = BytesIO()
    on_white(catalog.image(member, catalog.appearance_names[0], view, dtype="float32")).save(content, format="png")
    durable.replace(path, content.getvalue())


def figures(scene: SceneResults) -> str:
    """One line about the measurements of a scene's base appearance."""
    part = next(iter(parts_of([scene])), None)
    if part is None or scene.report is None:
        return "not measured yet"
    ours, trivial = (float(text.split()[0]) for text in (part.figure("psnr", *UNSEEN), part.best_trivial(*UNSEEN)))
    return (
        f"**{ours:.1f} dB**, mixed {trivial:.1f}; {scene.report['model_megabytes']:.2g} MB, "
        f"{scene.report['milliseconds']['view_change']:.0f} ms"
    )


def gallery(results: Iterable[SceneResults]) -> str:
    """The README's table: a column for each case."""
    by_name = {scene.name: scene for scene in results}
    rows = [
        [f"![{case.scene}](docs/pictures/gallery_{case.scene}.png)" for case in CASES],
        [case.what for case in CASES],
        [figures(by_name[case.scene]) for case in CASES],
    ]
    return table([f"`{case.scene}`" for case in CASES], rows)


def main() -> None:
    parser = command_line("results.gallery", __doc__)
    parser.add_argument("--runs", type=Path, default=PROJECT / "runs")
    parser.add_argument("--records", type=Path, default=PROJECT / "research" / "records")
    arguments = parser.parse_args()
    for case in CASES:
        path, picture = arguments.runs / case.scene / "catalog.cdb", PICTURES / f"gallery_{case.scene}.png"
        if (path / "catalog.json").is_file():
            draw(Catalog.open(path), case.view, picture)
            print(picture)
        elif not picture.is_file():
            parser.error(f"{path} is missing, and so is an earlier {picture.name}: make dataset SCENE={case.scene}")
    scenes = [PROJECT / f"scenes/{case.scene}.toml" for case in CASES]
    results = [read_scene(path, arguments.records, arguments.runs) for path in scenes]
    made = f"""{MEANING} Written by `python -m research.benchmarks.results.gallery`."""
    fill(PROJECT / "README.md", "gallery", f"{gallery(results)}\n<sub>{made}</sub>")


if __name__ == "__main__":
    main()
