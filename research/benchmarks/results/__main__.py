"""Collect the records of all scenes into one page; nothing is trained or measured.

    python -m research.benchmarks.results [--records DIRECTORY] [--runs DIRECTORY] [--output DIRECTORY]

Takes seconds. Missing results are listed on the page with the commands that make them, which `make results` runs.
"""

from __future__ import annotations

from pathlib import Path

from research.benchmarks.page import PROJECT, RESULTS, command_line
from research.benchmarks.results.gaps import gaps_of
from research.benchmarks.results.page import write
from research.benchmarks.results.scenes import read_scenes


def main() -> None:
    """Write docs/results/results.md and its pictures."""
    parser = command_line("results", __doc__)
    parser.add_argument(
        "--records", type=Path, default=PROJECT / "research" / "records", help="folder of the scenes' records"
    )
    parser.add_argument(
        "--runs", type=Path, default=PROJECT / "runs", help="folder of the pictures of the scenes' reports"
    )
    parser.add_argument("--scenes", type=Path, default=PROJECT / "scenes", help="folder of the scenes' TOML files")
    parser.add_argument("--output", type=Path, default=RESULTS, help="folder that the page is written to")
    given = parser.parse_args()
    try:
        scenes = read_scenes(given.scenes, given.records, given.runs)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    if all(scene.report is None for scene in scenes):
        parser.error(
            f"no scene has a report in {given.records}, so no page is written: make one with `make results SCENES=...`"
        )
    print(write(given.output, scenes))
    missing = sum(len(gaps_of(scene)) for scene in scenes)
    if missing:
        print(f"{missing} things are missing; the page says how each is made")


if __name__ == "__main__":
    main()
