"""Gaussians that start from the emulated field: PSNR and processor seconds for shares of it that they follow.

    python -m research.benchmarks.emulation.starts CATALOG [--steps 4000] [--shares 0.5 1 ...] [--seed 0] [--write]
        [--isovalues] [KEY=VALUE ...]

Trains stage 2 on one core for each share, and once without the field (the start on in-situ points), on the same images in
the same order. Scores, on test images that nothing was chosen by: Gaussians at members that were learnt and at others, the
emulated field, and the mean image. KEY=VALUE are those of a scene's [training] table. Prints Markdown; `--write` puts
it into docs/results/emulation.md.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import ISOVALUE
from research.benchmarks.page import RESULTS, command_line, made_by, publish, stopwatch, table
from surrogate.deformation import BilinearDeformation
from surrogate.evaluation.cases import Case, base_cells, variation_cells, variation_validation
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import mean, score_cases, spread
from surrogate.model import FieldModel, Surrogate
from surrogate.model.form import without_gaussians
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings, values_of_words
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.data import TrainingData
from surrogate.training.emulator import fit
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.stages import new_deformation, simulation_stage
from surrogate.training.visualizations import in_common, new_visualization, visualization_stage

PAGE, PART, SURFACES, MOST = RESULTS / "emulation.md", "starts", "surfaces", 200
HEADER = ("share of the field", "steps", "processor s", "Gaussians, seen", "Gaussians, unseen", "mean image, unseen")


SURFACE_HEADER = (
    "start",
    "steps",
    "processor s",
    "validation",
    *(f"{name} isovalues and members" for name in ("seen", "unseen")),
)


@dataclass(frozen=True, eq=False)
class Subject:
    """An ensemble, its images, the emulator of its fields, and the test images of its seen and unseen members."""

    source: Source
    data: TrainingData
    model: FieldModel
    seen: Sequence[Case]
    unseen: Sequence[Case]

    @classmethod
    def of(cls, catalog: Path, settings: TrainingSettings) -> Subject:
        source = Source(settings, Catalog.open(catalog))
        cells = base_cells(source.catalog, source.appearance)["unseen_views"]
        some = {name: [group[i] for i in spread(len(group), MOST)] for name, group in cells.items()}
        return cls(source, source.data(), fit(source, ""), some["seen_parameters"], some["unseen_parameters"])

    def score(self, surrogate: Surrogate, drawn_by: str, cases: Sequence[Case]) -> float | None:
        """The mean PSNR of one representation."""
        at = partial(surrogate.using(drawn_by).at, outside="allow")
        [scores] = score_cases(SurrogatePredictor(at, self.source.catalog.plan.background), self.source.catalog, cases)
        return mean(scores.values(), "psnr")


def trained(subject: Subject, share: float | None, steps: int) -> tuple[Surrogate, float]:
    """The surrogate after stage 2 that follows a share of the field, none of it for None; and processor seconds."""
    source, settings = subject.source, subject.source.settings.changed(deformation_steps=steps)
    begun = time.process_time()
    start = None if share is None else source.start_from_field(subject.model)
    gaussians = source.initial_gaussians(subject.data) if start is None else start.gaussians
    deformation: BilinearDeformation = new_deformation(gaussians, len(source.space), settings)
    if start is not None and share is not None:
        deformation = replace(deformation, emulated=replace(start.emulated, share=share))
    run = StageRun(simulation_stage(gaussians, deformation, settings), settings, subject.data)
    run.finish()
    surrogate = Surrogate(
        gaussians.copy(),
        deformation.copy(),
        source.space,
        source.normalization,
        Rasterizer.of(settings).for_any_device(),
        source.catalog.plan.background,
        field=subject.model,
    )
    return surrogate, time.process_time() - begun


def measured(
    subject: Subject, shares: Sequence[float], steps: int, say: Callable[[str], None]
) -> tuple[str, float | None]:
    """The table in Markdown, and the score of the emulated field."""
    rows, field = [], None
    for share in (None, *shares):
        say(f"share {share}")
        surrogate, seconds = trained(subject, share, steps)
        scores = [subject.score(surrogate, GAUSSIANS, group) for group in (subject.seen, subject.unseen)]
        scores.append(subject.score(surrogate, BOTH, subject.unseen))
        field = subject.score(surrogate, FIELD, subject.unseen) if field is None else field
        name = "another start" if share is None else f"{share:g}"
        rows.append((name, f"{steps:,}", f"{seconds:.0f}", *("–" if s is None else f"{s:.2f}" for s in scores)))
    return table(HEADER, rows), field


def on_surfaces(subject: Subject, steps: int, say: Callable[[str], None]) -> tuple[str, float | None]:
    """The table of both starts on isosurfaces in Markdown, and the score of the emulated field at unseen isovalues."""
    source, settings = subject.source, subject.source.settings.changed(visualization_steps=steps)
    [variation, *_] = (v for v in source.variations if v.kind == ISOVALUE)
    data, base = source.data(variation), without_gaussians(subject.model)
    fitted = base["gaussians"], base["deformation"]
    cells = variation_cells(source.catalog, variation)
    groups = [
        variation_validation(source.catalog, variation),
        cells["seen_settings"]["seen_parameters"],
        cells["unseen_settings"]["unseen_parameters"],
    ]
    groups = [[group[i] for i in spread(len(group), MOST)] for group in groups]
    rows = []
    for emulated in (False, True):
        say("emulated surfaces" if emulated else "another start")
        begun = time.process_time()
        surfaces = source.emulated_surfaces(subject.model, variation) if emulated else None
        visual = new_visualization(*fitted, variation, source, 0, surfaces)
        visual = visual if emulated else in_common(visual, settings, data)
        StageRun(visualization_stage(*fitted, visual, settings, begun=emulated), settings, data).finish()
        seconds = time.process_time() - begun
        surrogate = Surrogate(**{**base, "visualizations": (visual.copy(),)})
        scores = [subject.score(surrogate, GAUSSIANS, group) for group in groups]
        cells_of = ("–" if s is None else f"{s:.2f}" for s in scores)
        rows.append(("emulated surfaces" if emulated else "another start", f"{steps:,}", f"{seconds:.0f}", *cells_of))
    field = subject.score(Surrogate(**base, field=subject.model), FIELD, groups[-1])
    return table(SURFACE_HEADER, rows), field


@one_torch_thread()
def main() -> None:
    """Measure and print."""
    parser, say = command_line("emulation.starts", __doc__), stopwatch()
    parser.add_argument("catalog", type=Path)
    parser.add_argument("words", nargs="*", metavar="KEY=VALUE")
    parser.add_argument("--steps", type=int, default=4_000)
    parser.add_argument("--shares", type=float, nargs="+", default=[0.5, 1.0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--isovalues", action="store_true", help="compare starts on isosurfaces")
    parser.add_argument("--write", action="store_true", help="into docs/results/emulation.md")
    options = parser.parse_args()
    torch.manual_seed(options.seed)
    settings = TrainingSettings.from_table(
        {"canonical_steps": 0, "seed": options.seed, **values_of_words(options.words)}
    )
    subject = Subject.of(options.catalog, settings)
    words = " ".join([options.catalog.name, *options.words, f"--steps {options.steps}", f"--seed {options.seed}"])
    if options.isovalues:
        text, field = on_surfaces(subject, options.steps, say)
        words, part, shown = f"{words} --isovalues", SURFACES, "Images of isosurfaces; the emulated field alone has"
    else:
        text, field = measured(subject, options.shares, options.steps, say)
        part, shown = PART, f"{len(subject.unseen)} images of unseen members; the emulated field alone has"
    about = f"{shown} {field or 0.0:.2f} dB {'at unseen isovalues and members' if options.isovalues else 'there'}."
    made = f"<sub>{made_by(f'emulation.starts {words}')}, one core</sub>"
    publish(f"{about}\n\n{text}\n{made}", PAGE, part, write=options.write)


if __name__ == "__main__":
    main()
