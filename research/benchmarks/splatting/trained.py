"""Models trained for a given time, and the quality of their images on validation members and views.

Each time budget gets a whole schedule of its own, not a longer run cut short.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.progress import ProgressLine
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.scene import Scene
from research.benchmarks.page import PROJECT, table
from research.benchmarks.splatting.figures import COLORS, MARKERS, panels, plain_ticks
from research.benchmarks.splatting.setup import Setup
from research.benchmarks.splatting.workloads import View
from research.studies.ablation.timing import StepTimes, measure_step_times, scheduled
from surrogate.evaluation.metrics import WHITE, composite, psnr
from surrogate.model import DeformedGaussians, Surrogate
from surrogate.rasterizer import primitives
from surrogate.settings import TrainingSettings
from surrogate.training.data import ImageRow, validation_rows
from surrogate.training.run import train

PREFERRED, FALLBACK = "tgv-dvr", "tiny"
BUDGETS, QUICK_BUDGETS = (15.0, 30.0, 60.0, 120.0), (2.0, 4.0)  # seconds by `research.studies.ablation.timing.clock`
PROBE = 0.1  # fraction of the largest budget for measuring step times
POINTS = 12  # of a training curve, about
FIGURE = "splatting_training.png"
JUDGED = 96  # validation images for the final number; those of the curve are in the settings


@dataclass(frozen=True, eq=False)
class BudgetedFit:
    """A model trained for about `budget` seconds of `research.studies.ablation.timing.clock`: on a CPU, of all cores together."""

    budget: float
    surrogate: Surrogate

    @property
    def curve(self) -> list[tuple[float, float]]:
        """(seconds, validation PSNR in dB) as recorded by the run, both stages."""
        points: Sequence[Mapping[str, Any]] = self.surrogate.training["curve"]
        return [(p["seconds"], p["psnr"]) for p in points if p["psnr"] is not None]


@dataclass(frozen=True, eq=False)
class TrainedModels:
    """One scene and its models; each is trained on first use."""

    setup: Setup
    fits: dict[float, BudgetedFit] = field(default_factory=dict)

    @property
    def budgets(self) -> tuple[float, ...]:
        return QUICK_BUDGETS if self.setup.quick else BUDGETS

    @property
    def name(self) -> str:
        """The available scene: the standard one, or the smallest, which is quick to make."""
        stored = (self.setup.runs / PREFERRED / "catalog.cdb").is_dir()
        return PREFERRED if stored and not self.setup.quick else FALLBACK

    @cached_property
    def scene_file(self) -> Scene:
        return Scene.load(PROJECT / "scenes" / f"{self.name}.toml")

    @cached_property
    def catalog(self) -> Catalog:
        folder = self.setup.runs / self.name / "catalog.cdb"
        if not folder.is_dir():
            self.setup.say(f"rendering the data set {self.name}")
            program = "from insitu.cli import main; main()"  # in a process of its own, since it loads VTK
            arguments = ["dataset", str(self.scene_file.path), "--runs", str(self.setup.runs)]
            subprocess.run([sys.executable, "-c", program, *arguments], check=True)
        return Catalog.open(folder)

    @cached_property
    def settings(self) -> TrainingSettings:
        """The scene's settings for its base appearance, without the choices that these tables are about."""
        settings = TrainingSettings.from_table(self.scene_file.training)
        degree = 0 if settings.color_degree == "auto" else settings.color_degree
        return settings.changed(fit_to_need=False, color_degree=degree, visualization_steps=0)

    @cached_property
    def step_times(self) -> StepTimes:
        """Step times on this machine, from a short run."""
        self.setup.say(f"{self.name}: how fast a step is")
        return measure_step_times(self.settings, self.catalog, PROBE * max(self.budgets))

    def fit(self, budget: float) -> BudgetedFit:
        """The model of one budget, in seconds."""
        if budget not in self.fits:
            settings = planned(self.settings, budget, self.step_times)
            self.setup.say(f"{self.name}: training for {budget:.0f} s")
            with tempfile.TemporaryDirectory() as folder, ProgressLine() as line:
                surrogate = train(settings, self.catalog, Path(folder) / "surrogate", progress=line)
            self.fits[budget] = BudgetedFit(budget, surrogate)
        return self.fits[budget]

    @property
    def model(self) -> Surrogate:
        """The model that was trained longest."""
        return self.fit(max(self.budgets)).surrogate

    def validation(self, count: int) -> list[ImageRow]:
        """`count` validation images, evenly spread."""
        return validation_rows(self.catalog, self.catalog.appearance_names[:1], count)

    def view(self) -> View:
        """The view of the model at one validation image, in normalized coordinates."""
        row = self.validation(3)[-1]
        deformed = self.model.at(**row.member.parameters)
        camera, rasterizer = deformed.normalization.camera(row.member.cameras[row.view]), deformed.rasterizer
        return View(primitives(deformed.gaussians, camera), camera, rasterizer.constants)

    def truth(self, row: ImageRow) -> NDArray[np.float32]:
        """A stored image over its background, (H, W, 3)."""
        stored = self.catalog.image(row.member, str(self.model.training["appearance"]), row.view)
        return composite(stored, self.background)

    @property
    def background(self) -> tuple[float, float, float]:
        return self.catalog.plan.background or WHITE


def pictures(surrogate: Surrogate, rows: Sequence[ImageRow]) -> Iterator[tuple[ImageRow, DeformedGaussians, Camera]]:
    """The deformed Gaussians and camera of each row, deformed once per member."""
    deformed: dict[str, DeformedGaussians] = {}
    for row in rows:
        if row.member.name not in deformed:
            deformed[row.member.name] = surrogate.at(**row.member.parameters)
        yield row, deformed[row.member.name], row.member.cameras[row.view]


def mean_decibels(surrogate: Surrogate, trained: TrainedModels, rows: Sequence[ImageRow]) -> float:
    """Mean PSNR of `surrogate` on stored images."""
    values = [
        psnr(trained.truth(row), composite(deformed.render(camera), trained.background))
        for row, deformed, camera in pictures(surrogate, rows)
    ]
    return float(np.mean(values))


def planned(settings: TrainingSettings, seconds: float, times: StepTimes) -> TrainingSettings:
    """`settings` with as many steps as fit into `seconds`, and about `POINTS` points in the curve of their training."""
    plan = scheduled(settings, seconds, times)
    interval = max(1, (plan.canonical_steps + plan.deformation_steps) // POINTS)
    return plan.changed(validation_interval=interval)


def training_time(setup: Setup, trained: TrainedModels) -> str:
    """A row per budget, and the plot of all curves."""
    rows, judged, fits = [], trained.validation(JUDGED), [trained.fit(budget) for budget in trained.budgets]
    for fit in fits:
        surrogate, settings = fit.surrogate, fit.surrogate.training["settings"]
        rows.append(
            [
                f"{fit.budget:.0f}",
                f"{surrogate.training['seconds']:.1f}",
                f"{settings['canonical_steps']} + {settings['deformation_steps']}",
                f"{len(surrogate.gaussians):,}",
                f"{surrogate.megabytes:.2f}",
                f"{fit.curve[-1][1]:.2f}",
                f"{mean_decibels(surrogate, trained, judged):.2f}",
            ]
        )
    with panels(setup.output / FIGURE, height=3.6) as axes:
        for fit, color, marker in zip(fits, COLORS, MARKERS, strict=False):
            seconds, decibels = zip(*fit.curve, strict=True)
            axes.plot(seconds, decibels, "-", color=color, linewidth=1.2, label=f"schedule of {fit.budget:.0f} s")
            axes.plot(seconds[-1], decibels[-1], marker, color=color, markersize=6)
        axes.set(xscale="log", xlabel="seconds of training, data loading included", ylabel="validation PSNR, dB")
        plain_ticks(axes.xaxis)
        axes.set_title(f"{trained.name}, seed {trained.settings.seed}")
        axes.legend(loc="lower right")
    header = ["budget, s", "taken, s", "steps", "Gaussians", "MB", "validation PSNR at the end of its curve, dB"]
    described = (
        f"Scene {trained.name}, seed {trained.settings.seed}, other settings as in scenes/{trained.name}.toml. A budget counts the "
        "time of all cores together (on a GPU that on the wall), what was taken the time on the wall.\n\n"
    )
    return described + table([*header, f"of {len(judged)} validation images, dB"], rows)
