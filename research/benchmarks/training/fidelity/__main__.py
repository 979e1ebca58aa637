"""Fit one member in many ways, and render one fit by other rules: limits of images of volumes made of Gaussians.

    python -m research.benchmarks.training.fidelity [--quick] [--scenes tgv-dvr cloverleaf] [--no-ensembles]
    [--page-only] [--runs DIRECTORY]

Takes about an hour on two cores. Each fit's result is stored in runs/fidelity/ and not fitted again, so the command may
be interrupted. The page docs/results/volume_fidelity.md is written at the end, or at once with `--page-only`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from research.benchmarks.page import PROJECT, RESULTS, command_line, stopwatch
from research.benchmarks.training.fidelity import ensembles, page
from research.benchmarks.training.fidelity.fitting import (
    MemberImages,
    catalog_of,
    fit,
    is_fitted,
    provenance,
    settings_of,
)
from research.benchmarks.training.fidelity.rules import study
from research.benchmarks.training.fidelity.variants import VARIANTS, FidelityVariant
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.records import write_json

SCENES = ("tgv-dvr", "cloverleaf")
QUICK = 0.02  # of the steps


def main() -> None:
    parser = command_line("training.fidelity", __doc__)
    parser.add_argument("--quick", action="store_true", help="a fiftieth of the steps, written beside the real results")
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), metavar="SCENE")
    parser.add_argument("--no-ensembles", dest="ensembles", action="store_false", help="fit single members only")
    parser.add_argument("--page-only", action="store_true", help="write the page from the results that are there")
    parser.add_argument("--runs", type=Path, default=PROJECT / "runs", help="folder of the scenes' results")
    arguments = parser.parse_args()
    folder = arguments.runs / ("fidelity-quick" if arguments.quick else "fidelity")
    say = stopwatch()
    if not arguments.page_only:
        with one_torch_thread():
            for scene in arguments.scenes:
                measure(scene, arguments.runs, folder, QUICK if arguments.quick else 1.0, say)
            if arguments.ensembles:
                ensembles.measure(arguments.runs, folder, QUICK if arguments.quick else 1.0, say)
    results = {scene: stored(folder / scene) for scene in arguments.scenes}
    page.write(RESULTS if not arguments.quick else folder, results, ensembles.stored(folder), say)


def measure(scene: str, runs: Path, folder: Path, scale: float, say: Any) -> None:
    """Fit every variant of a scene that has no result yet."""
    catalog = catalog_of(runs, scene)
    if catalog is None:
        say(f"{scene}: not there; make it with `make dataset SCENE={scene}`")
        return
    subject, made = MemberImages.of(scene, catalog), provenance()
    for variant in VARIANTS:
        path = folder / scene / f"{variant.key}.json"
        if is_fitted(path, settings_of(variant, scale)):
            continue
        outcome = fit(subject, variant, scale, say)
        record = outcome.record | {"group": variant.group, "name": variant.name, **made}
        if variant == VARIANTS[0]:
            record |= {"rules": study(subject, outcome.gaussians, settings_of(variant, scale))}
        write_json(path, record)


def stored(folder: Path) -> dict[FidelityVariant, dict[str, Any]]:
    """The stored results."""
    results = {}
    for variant in VARIANTS:
        path = folder / f"{variant.key}.json"
        if path.exists():
            results[variant] = json.loads(path.read_text())
    return results


if __name__ == "__main__":
    main()
