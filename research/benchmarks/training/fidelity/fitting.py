"""Fit Gaussians to one member of a catalog without a deformation, and score them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from research.benchmarks.page import commit
from research.benchmarks.training.fidelity.variants import (
    ACTIVATIONS,
    GAUSSIANS,
    STEPS,
    FidelityVariant,
    with_activation,
)
from surrogate.evaluation.metrics import WHITE, psnr
from surrogate.gaussians import Gaussians, Normalization
from surrogate.initialization.pictures import StartPoints
from surrogate.initialization.start import FIRST_OPACITY, initial_gaussians, initial_points
from surrogate.provenance import machine
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.data import Example, ImageRow, TrainingData, foreground_color, load_examples
from surrogate.training.loop import StageRun
from surrogate.training.stages import Stage, canonical_stage

POINTS = 6  # of a curve


@dataclass(frozen=True, eq=False)
class MemberImages:
    """One training member of a scene: its images by split, and the initial Gaussians' positions."""

    scene: str
    member: str
    examples: dict[str, Sequence[Example]]
    box: NDArray[np.float64]  # [2, 3]
    points: StartPoints | None
    background: tuple[float, float, float] | None

    @classmethod
    def of(cls, scene: str, catalog: Catalog) -> MemberImages:
        """The training member in the middle of the list."""
        members = [member for member in catalog.members if member.split == "train"]
        member, plan = members[len(members) // 2], catalog.plan
        normalization = Normalization.of_box(plan.bounds)
        appearance = plan.appearances[0].name
        examples = {
            split: load_examples(
                catalog,
                [
                    ImageRow(member, view, appearance)
                    for view, assigned in enumerate(member.view_splits)
                    if assigned == split
                ],
                normalization,
            )
            for split in ("train", "validation", "test")
        }
        points = initial_points(TrainingSettings(), catalog, appearance, normalization)
        return cls(scene, member.name, examples, normalization.points(plan.bounds), points, plan.background)


class MemberFit(NamedTuple):
    """The result of a fit: JSON values, and the Gaussians."""

    record: dict[str, Any]
    gaussians: Gaussians


def fit(subject: MemberImages, variant: FidelityVariant, scale: float, say: Callable[[str], None]) -> MemberFit:
    """Fit one variant with `scale` times its steps."""
    settings = settings_of(variant, scale)
    gaussians = _start(subject, settings, variant.activation)
    stage = canonical_stage(gaussians, settings)
    stage = replace(stage, carried_at=lambda _: with_activation(gaussians, variant.activation))
    run = StageRun(stage, settings, TrainingData(subject.examples["train"], (), subject.background))
    curve, started, watching = [], time.perf_counter(), 0.0
    while run.step < stage.steps:
        run.advance()
        if run.step % max(1, stage.steps // POINTS) == 0:
            begun = time.perf_counter()
            curve.append([run.step, judge(subject, stage, settings, "validation")])
            watching += time.perf_counter() - begun
            say(f"{subject.scene}, {variant.group} {variant.name}: step {run.step:,}, {curve[-1][1]:.2f} dB")
    seconds = time.perf_counter() - started - watching
    final = Gaussians(**{name: t.detach() for name, t in stage.gaussians_at(torch.empty(0)).tensors().items()})
    record = {
        "scene": subject.scene,
        "member": subject.member,
        "settings": settings.to_json(),
        "activation": variant.activation,
        "curve": curve,
        "milliseconds": 1e3 * seconds / stage.steps,
        **{split: judge(subject, stage, settings, split) for split in ("train", "validation", "test")},
        "half_size": judge(subject, stage, settings, "validation", halved=True),
    }
    return MemberFit(record, final)


def settings_of(variant: FidelityVariant, scale: float) -> TrainingSettings:
    """The settings of a variant; no deformation."""
    base = TrainingSettings(gaussians=GAUSSIANS, canonical_steps=STEPS, deformation_steps=0)
    chosen = base.changed(**variant.settings)
    return chosen.changed(canonical_steps=max(POINTS, round(scale * chosen.canonical_steps)))


def is_fitted(path: Path, settings: TrainingSettings) -> bool:
    """True if `path` holds a result with these settings, apart from where it was computed."""
    if not path.exists():
        return False
    elsewhere = {"device", "backend", "checkpoint_seconds"}
    stored, wanted = json.loads(path.read_text())["settings"], settings.to_json()
    return all(stored.get(name) == value for name, value in wanted.items() if name not in elsewhere)


def judge(
    subject: MemberImages, stage: Stage, settings: TrainingSettings, split: str, *, halved: bool = False
) -> float | None:
    """Mean PSNR over the images of a split, in dB; `halved` in width and height, where each pixel is the mean of four."""
    rasterizer, behind = Rasterizer.of(settings), subject.background or WHITE
    scores = []
    with torch.no_grad():
        gaussians = stage.gaussians_at(torch.empty(0))
        for example in subject.examples[split]:
            truth = np.divide(example.compared()[..., :3], 255.0, dtype=np.float32)  # [H, W, 3]
            camera = example.camera
            if halved:
                truth, camera = _mean_of_four(truth), camera.resized(camera.width // 2, camera.height // 2)
            picture = rasterizer.draw_over(gaussians, camera, behind)[..., :3].clamp(0.0, 1.0)
            scores.append(psnr(truth, picture.numpy()))
    return float(np.mean(scores)) if scores else None


def _start(subject: MemberImages, settings: TrainingSettings, activation: str) -> Gaussians:
    some = subject.examples["train"][::8]
    gaussians = initial_gaussians(settings, subject.box, subject.points, foreground_color(some, subject.background))
    gaussians.opacity_logits.fill_(ACTIVATIONS[activation].number(FIRST_OPACITY))
    return gaussians


def _mean_of_four(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    height, width, channels = picture.shape
    return picture.reshape(height // 2, 2, width // 2, 2, channels).mean(axis=(1, 3))


def provenance() -> dict[str, Any]:
    """The provenance of a result: the machine and the commit."""
    return {"machine": machine(), "commit": commit("surrogate", "catalogs", "research/benchmarks/training/fidelity")}


def catalog_of(runs: Path, scene: str) -> Catalog | None:
    """The scene's catalog; None where it has not been made."""
    folder = runs / scene / "catalog.cdb"
    return Catalog.open(folder) if folder.is_dir() else None
