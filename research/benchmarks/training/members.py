"""Draw the training members of a catalog at their positions over its two parameters, each as one of its images.

    python -m research.benchmarks.training.members [runs/tgv/catalog.cdb] [--view 30] [-o docs/results/tgv.png]

Shows the variation of an ensemble and the distribution of its members. Takes seconds; only reads the catalog.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from catalogs.store.catalog import Catalog
from research.benchmarks.page import PROJECT, RESULTS, command_line
from research.benchmarks.splatting.figures import panels

INCHES = 1.05  # of a picture


def draw(catalog: Catalog, view: int, output: Path) -> None:
    """Write the figure: the last parameter along, the first one up, the first appearance.

    Raises ValueError unless the catalog has two parameters, two training members and this view.
    """
    space, members = catalog.plan.space, [member for member in catalog.members if member.split == "train"]
    if len(space) != 2 or len(members) < 2:
        raise ValueError(f"{catalog.path} has {len(members)} training members over {space}: two parameters are drawn")
    if not 0 <= view < len(catalog.plan.cameras):
        raise ValueError(f"{catalog.path} has the views 0 to {len(catalog.plan.cameras) - 1}, got {view}")
    up, along = space.parameters
    rows = sorted({member.parameters[up.name] for member in members})
    height = min((after - before for before, after in pairwise(rows)), default=up.high - up.low)
    width = min(
        after - before
        for row in rows
        for before, after in pairwise(sorted(m.parameters[along.name] for m in members if m.parameters[up.name] == row))
    )
    across, stacked = (along.high - along.low) / width + 1, (up.high - up.low) / height + 1
    with panels(output, width=INCHES * across + 0.8, height=INCHES * stacked + 0.6) as axes:
        axes.grid(visible=False)
        for member in members:
            picture = catalog.image(member, catalog.appearance_names[0], view, dtype="float32")
            x, y = member.parameters[along.name], member.parameters[up.name]
            extent = (x - width / 2, x + width / 2, y - height / 2, y + height / 2)
            axes.imshow(
                picture[..., :3] + (1.0 - picture[..., 3:]), extent=extent, aspect="auto", interpolation="lanczos"
            )
        axes.set(xlim=(along.low - width / 2, along.high + width / 2), ylim=(up.low - height / 2, up.high + height / 2))
        axes.set(xlabel=along.name, ylabel=up.name, yticks=rows)


def main() -> None:
    parser = command_line("training.members", __doc__)
    parser.add_argument("catalog", nargs="?", type=Path, default=PROJECT / "runs" / "tgv" / "catalog.cdb")
    parser.add_argument("--view", type=int, default=30, help="which camera's pictures (default: 30)")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS / "tgv.png")
    arguments = parser.parse_args()
    draw(Catalog.open(arguments.catalog), arguments.view, arguments.output)


if __name__ == "__main__":
    main()
