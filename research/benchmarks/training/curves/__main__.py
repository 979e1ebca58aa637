"""Accuracy over training time: scenes trained for some minutes each, as `surrogate train CATALOG --minutes` does, and scored.

    taskset -c 0 python -m research.benchmarks.training.curves SCENE... [--minutes 0.5 2 4 15] [--runs runs]
    [--records research/records]

The scenes' data sets must exist. A minute is one of the machine: with `taskset` to one core, one of processor time. A
record of each training is stored at once, and stored ones are not measured again. `python -m
research.benchmarks.results` draws them.
"""

from __future__ import annotations

from pathlib import Path

from catalogs.vocabulary.scene import Scene
from research.benchmarks.page import PROJECT, command_line, stopwatch
from research.benchmarks.training.curves.measured import FOLDER, load, measure, save


def main() -> None:
    """Measure, keep and print."""
    parser, say = command_line("training.curves", __doc__), stopwatch()
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("--minutes", type=float, nargs="+", default=[0.5, 2.0, 4.0, 15.0])
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of the data sets (default: runs)")
    parser.add_argument(
        "--records", type=Path, default=PROJECT / "research" / "records", help="folder of the scenes' records"
    )
    given = parser.parse_args()
    try:
        for path in given.scenes:
            scene = Scene.load(path)
            run, records = scene.run_directory(given.runs), given.records / scene.name
            for minutes in sorted(set(given.minutes) - {point.minutes for point in load(records)}):
                say(f"{scene.name}, {minutes:g} minutes")
                point = measure(run / "catalog.cdb", run / FOLDER / f"{minutes:g}", minutes)
                save(records, point)
                print(
                    f"{scene.name}: {point.processor_seconds:.0f} processor seconds, {point.gaussians:,} Gaussians, "
                    f"{point.steps:,} steps: {', '.join(f'{what} {psnr:.2f} dB' for what, psnr in point.unseen.items())}",
                    flush=True,
                )
    except (ValueError, OSError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
