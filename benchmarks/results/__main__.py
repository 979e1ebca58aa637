"""Collect the results of all scenes from runs/ into one page; nothing is trained or measured.

    python -m benchmarks.results [--runs DIRECTORY] [--output DIRECTORY]

Seconds.  What is missing is listed on the page with the command that makes it, which `make results` runs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.page import DOCS, PROJECT
from benchmarks.results.page import write
from benchmarks.results.scenes import read_scenes


def main() -> None:
    """Write docs/results.md and its pictures."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.results", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=Path, default=PROJECT / "runs", help="folder of the scenes' results")
    parser.add_argument("--scenes", type=Path, default=PROJECT / "scenes", help="folder of the scenes' TOML files")
    parser.add_argument("--output", type=Path, default=DOCS, help="folder that the page is written to")
    given = parser.parse_args()
    if not given.runs.is_dir():
        parser.error(f"there is no folder {given.runs}: make a data set first, with `make dataset`")
    try:
        scenes = read_scenes(given.scenes, given.runs)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    if all(scene.report is None for scene in scenes):
        parser.error(
            f"no scene has a report in {given.runs}, so no page is written: make one with `make results SCENES=...`"
        )
    print(write(given.output, scenes))
    missing = sum(len(scene.gaps) for scene in scenes)
    if missing:
        print(f"{missing} things are missing; the page says how each is made")


if __name__ == "__main__":
    main()
