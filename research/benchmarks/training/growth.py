"""Value of going on with a finished run when members come later, beside runs from the start with all of them.

    python -m research.benchmarks.training.growth CATALOG [--later 0.25] [--steps 4000] [--seed 0] [--runs runs] [--write]

A share of the training members comes later: a run learns the others, and `surrogate train RUN --new-members` takes them
in. Runs from the start learn all members, in as many steps as the first run had, and in as many as growing took. Each is
scored on the catalog's test members. Runs are in RUNS/growth; what is finished is not trained again. Prints Markdown;
`--write` puts it into docs/results/training.md.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from catalogs.store.catalog import Catalog
from catalogs.store.splits import Splits
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from research.studies.repeats.run import score_model
from surrogate.evaluation.tables import number
from surrogate.model import Surrogate
from surrogate.model.representation import FIELD, GAUSSIANS
from surrogate.randomness import generator
from surrogate.storage.checkpoints import fingerprint
from surrogate.storage.runs import RunFolder, seen_by_run
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget

PAGE, PART, FOLDER = RESULTS / "training.md", "growth", "growth"
HEADER = ("run", "members", "steps", "processor seconds", "Gaussians, dB", "emulated field, dB")


@dataclass(frozen=True)
class Growth:
    """One comparison: a share of a catalog's training members comes later; runs have a number of `steps`."""

    catalog: Catalog
    folder: Path
    share: float
    steps: int
    seed: int

    def __post_init__(self) -> None:
        if not 0.0 < self.share < 1.0:
            raise ValueError(f"--later must lie between 0 and 1, got {self.share:g}")

    @property
    def later(self) -> frozenset[str]:
        """The names of the members that come later, drawn by the seed."""
        names = [m.name for m in self.catalog.members if m.split == "train"]
        order = generator(self.seed, "order").permutation(len(names))
        return frozenset(names[place] for place in order[: max(1, round(self.share * len(names)))])

    def first(self) -> RunFolder:
        """A run that knows nothing of the later members."""
        return without(self.begun("first", self.steps), self.later)

    def begun(self, name: str, steps: int) -> RunFolder:
        """A run of all members."""
        options = TrainingOptions(Budget(steps=steps), None, {"seed": self.seed})
        return begin(self.catalog.path, self.folder / name, options)


def without(run: RunFolder, later: frozenset[str]) -> RunFolder:
    """A run that was just begun, as it would be if the members `later` had not been there; one that has begun to learn stays."""
    record = run.record
    assert record is not None
    assert record.splits is not None
    if run.model.exists() or later.isdisjoint(record.splits.members):
        return run
    members = {name: split for name, split in record.splits.members.items() if name not in later}
    splits = Splits(members, record.splits.validation_views)
    mark = fingerprint(run.settings, seen_by_run(Catalog.open(run.catalog_path), splits))
    replace(record, splits=splits, fingerprint=mark).save(run.folder)
    return RunFolder.open(run.folder)


def trained(run: RunFolder, *options: str) -> RunFolder:
    """The run after `surrogate train RUN`; raises subprocess.CalledProcessError where that fails."""
    subprocess.run([sys.executable, "-m", "surrogate", "train", str(run.folder), *options], check=True)
    return RunFolder.open(run.folder)


def row(name: str, run: RunFolder, catalog: Catalog, before: Surrogate | None = None) -> list[str]:
    """Of the table; steps and seconds are those since the model `before`, where there is one."""
    surrogate, record = Surrogate.load(run.model), run.record
    assert record is not None
    assert record.splits is not None
    spent = [
        surrogate.training[key] - (before.training[key] if before else 0) for key in ("steps", "processor_seconds")
    ]
    scores = []
    for only in (GAUSSIANS, FIELD):
        cells = score_model(surrogate.using(only), catalog)["cells"] if only in surrogate.representations else None
        scores.append("–" if cells is None else number(cells["psnr"]["unseen_views"]["unseen_parameters"]))
    members = sum(split == "train" for split in record.splits.members.values())
    return [name, str(members), f"{spent[0]:,.0f}", f"{spent[1]:,.0f}", *scores]


def grown(run: RunFolder) -> RunFolder:
    """A copy of a finished run beside it, which has taken in all members."""
    folder = run.folder.with_name("grown")
    if not folder.exists():
        shutil.copytree(run.folder, folder.with_name(".grown"), dirs_exist_ok=True)
        folder.with_name(".grown").rename(folder)
    return trained(RunFolder.open(folder), "--new-members")


def measured(growth: Growth, say: Callable[[str], None]) -> Iterator[list[str]]:
    """Train the four runs, and yield the rows of the table."""
    say("the first members")
    run, catalog = trained(growth.first()), growth.catalog
    yield row("the first members", run, catalog)
    say("the later ones")
    more, before = grown(run), Surrogate.load(run.model)
    yield row("... and then `--new-members`", more, catalog, before)
    taken = Surrogate.load(more.model).training["steps"] - before.training["steps"]
    for name, steps in (("whole", growth.steps), ("short", taken)):
        say(f"all of them, {steps:,} steps")
        yield row("all members from the start", trained(growth.begun(name, steps)), catalog)


def main() -> None:
    """Train, score, print."""
    parser, say = command_line("training.growth", __doc__), stopwatch()
    parser.add_argument("catalog", type=Path, metavar="CATALOG")
    parser.add_argument("--later", type=float, default=0.25, help="Share of the training members that come later.")
    parser.add_argument("--steps", type=int, default=4_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--write", action="store_true", help="into docs/results/training.md")
    given, rows = parser.parse_args(), list[list[str]]()
    try:
        catalog = Catalog.open(given.catalog)
        for cells in measured(Growth(catalog, given.runs / FOLDER, given.later, given.steps, given.seed), say):
            print(" | ".join(cells), flush=True)
            rows.append(cells)
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        parser.error(str(error))
    words = f"{given.catalog} --later {given.later:g} --steps {given.steps} --seed {given.seed}"
    publish(f"{table(HEADER, rows)}\n<sub>{made_by(f'training.growth {words}')}</sub>", PAGE, PART, write=given.write)


if __name__ == "__main__":
    main()
