"""The per-member upper bound: the same number of Gaussians fitted to one unseen member alone, without a deformation.

A surrogate falls short of it because it predicts the member instead of learning from it. The bound itself is limited by
the Gaussians, their number and the training views. It is not strict: as many steps on the fewer views of one member may
overfit. It learns from a test member, so no choice may depend on it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.variations import Variation
from research.studies.progress import StudyProgress, StudyWatch
from research.studies.upper_bound_records import FOLDER, KIND, VERSION, entry_of
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.evaluation.cases import Case
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import mean, score_cases
from surrogate.initialization.pictures import central_member
from surrogate.lighting import Lighting
from surrogate.model import DeformedGaussians, MemberModel, Surrogate
from surrogate.model.representation import GAUSSIANS
from surrogate.provenance import code
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.splatting.cuda import chosen_device
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.checkpoints import fingerprint
from surrogate.storage.records import Provenance, Record
from surrogate.training.data import ImageRow, TrainingData, load_examples
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.stages import canonical_stage
from surrogate.training.visualizations import lighting_of

REPORT_STEPS = 50  # between progress reports


@dataclass(frozen=True, eq=False)
class UpperBoundSubject:
    """One member under one appearance that is fitted alone; `variation` is None for the base."""

    member: Member
    appearance: str
    variation: Variation | None = None

    @property
    def varied(self) -> dict[str, float | str]:
        """Visualization parameters by name; empty for the base."""
        setting = None if self.variation is None else self.variation.setting(self.appearance)
        return {} if self.variation is None or setting is None else self.variation.arguments(setting)

    def cases(self, split: str = "test") -> list[Case]:
        """The member's images at the views of a split."""
        return [Case(self.member, view, self.appearance, self.varied) for view in self.views(split)]

    def views(self, split: str) -> list[int]:
        """Numbers of the views of a split."""
        return [view for view, assigned in enumerate(self.member.view_splits) if assigned == split]


@one_torch_thread()
def measure_upper_bound(
    settings: TrainingSettings,
    catalog: Catalog,
    records: Path,
    surrogate: Surrogate | None = None,
    *,
    progress: Callable[[StudyProgress], None] = lambda _: None,
) -> list[dict[str, Any]]:
    """Measure the bound for the base appearance and for the middle unseen setting of every variation.

    An entry has the `member` and `appearance` that was fitted, the `psnr` (dB) and `ssim` at its test views, and those
    of the `surrogate` on the same images. Without a surrogate, the latter come from an earlier record, or are None.
    Finished entries are stored in the scene's `records`, and skipped while settings, catalog and code stay the same.

    Raises ValueError where no member has both training and test views.
    """
    source, mark = Source(settings, catalog), fingerprint(settings, catalog)
    forms = {subject: _settings(source, subject, surrogate) for subject in subjects(source)}
    keys = {subject: _key(mark, subject, form) for subject, form in forms.items()}
    stored = {subject: _finished(records, key, surrogate) for subject, key in keys.items()}
    watch, left = StudyWatch(progress), sum(record is None for record in stored.values())
    for subject, record in stored.items():
        if record is None:
            watch.begin(subject.appearance, left := left - 1)
            begun = time.process_time()
            values = _fitted_alone(forms[subject], source, subject, watch)
            key = {**keys[subject], "settings": settings.to_json()}
            record = Record(KIND, VERSION, key, values, Provenance.now(time.process_time() - begun, __name__))
        if surrogate is not None or "surrogate" not in record.values:
            record = replace(record, values={**record.values, "surrogate": _reached(surrogate, source, subject)})
            record.save(_path(records, subject.appearance))
        stored[subject] = record
    return [entry_of(record) for record in stored.values() if record is not None]


def _path(records: Path, appearance: str) -> Path:
    return records / FOLDER / f"{appearance}.json"


def _finished(records: Path, key: Mapping[str, Any], surrogate: Surrogate | None) -> Record | None:
    """The record with the same settings, catalog and code; without a surrogate, of any colour degree."""
    needed = {name: value for name, value in key.items() if surrogate is not None or name != "color_degree"}
    record = Record.load(_path(records, key["appearance"]), KIND, VERSION, needed)
    return None if record is None or record.provenance.code != code(__name__) else record


def subjects(source: Source) -> list[UpperBoundSubject]:
    """The middle test member under the base appearance, and one under the middle unseen setting of each variation.

    Where no test member has training views, the training member with the most test views is taken. It shows the limits
    of views and Gaussians, but not of unseen parameters.
    """
    members = [m for m in source.catalog.members if {"train", "test"} <= set(m.view_splits)]
    shown = [m for m in members if m.split == "test" and source.appearance in m.appearances]
    if not shown:
        seen = [m for m in members if m.split == "train" and source.appearance in m.appearances]
        most = max((m.view_splits.count("test") for m in seen), default=0)
        shown = [m for m in seen if m.view_splits.count("test") == most]
    if not shown:
        raise ValueError(
            f"catalog {source.catalog.path} has no member with both training and test views: none can be fitted alone"
        )
    chosen = [UpperBoundSubject(central_member(shown, source.catalog.plan.space), source.appearance)]
    for variation in source.variations:
        appearance = _middle_setting(variation)
        shown = [m for m in members if m.split == "test" and appearance in m.appearances]
        if shown:
            chosen.append(UpperBoundSubject(central_member(shown, source.catalog.plan.space), appearance, variation))
    return chosen


def line(entry: Mapping[str, Any]) -> str:
    """An entry as one line for the terminal."""
    reached = entry["surrogate"]
    beside = "" if reached is None else f"   the surrogate {reached['psnr']:.2f} dB   SSIM {reached['ssim']:.4f}"
    own = f"{entry['psnr']:6.2f} dB   SSIM {entry['ssim']:.4f}"
    return f"{entry['appearance']} of {entry['member']}, fitted alone: {own}{beside}"


def _middle_setting(variation: Variation) -> str:
    """The name of the middle test appearance, by isovalue where that is what varies."""
    names = variation.named("test")
    settings = [s for s in variation.settings if s.appearance in names]
    ordered = sorted(settings, key=lambda s: s.values) if len(variation.space) == 1 else settings
    return ordered[len(ordered) // 2].appearance if ordered else ""


def _settings(source: Source, subject: UpperBoundSubject, surrogate: Surrogate | None) -> TrainingSettings:
    """Settings of stage 1 alone, with the surrogate's Gaussians, steps and colour degree."""
    settings, lit = source.settings, _lighting(source, subject) is not None
    steps = settings.visualization_steps if subject.variation is not None else 0
    if not lit:  # which is built on the base's Gaussians
        steps += settings.canonical_steps + settings.deformation_steps
    return settings.changed(
        gaussians=settings.count_on_surfaces if lit else settings.gaussians,
        canonical_steps=steps,
        deformation_steps=0,
        visualization_steps=0,
        color_degree=0 if lit else _color_degree(settings, subject, surrogate),
    )


def _lighting(source: Source, subject: UpperBoundSubject) -> Lighting | None:
    """The light on the subject's surfaces; None without any."""
    return None if subject.variation is None else lighting_of(subject.variation, source)


def _color_degree(settings: TrainingSettings, subject: UpperBoundSubject, surrogate: Surrogate | None) -> int:
    """The surrogate's colour degree; without a surrogate that of the settings, and 1 where it is "auto", the most that
    it may become."""
    if surrogate is not None:
        mine = [v for v in surrogate.visualizations if subject.variation and v.variation.kind == subject.variation.kind]
        return max([surrogate.gaussians.color_degree, *(v.color_degree for v in mine)])
    degrees = [settings.color_degree, *([settings.visualization_color_degree] if subject.variation else [])]
    return max(1 if degree == "auto" else degree for degree in degrees)


def _key(mark: str, subject: UpperBoundSubject, form: TrainingSettings) -> dict[str, Any]:
    """The key of a finished entry."""
    return {
        "mark": mark,
        "member": subject.member.name,
        "split": subject.member.split,
        "appearance": subject.appearance,
        "parameters": {**subject.member.parameters, **subject.varied},
        "gaussians": form.gaussians,
        "color_degree": form.color_degree,
        "steps": form.canonical_steps,
        "seed": form.seed,
    }


def _fitted_alone(
    settings: TrainingSettings, source: Source, subject: UpperBoundSubject, watch: StudyWatch
) -> dict[str, Any]:
    """Fit the subject, and score it at its test views."""
    started, count = time.perf_counter(), watch.counter("steps")
    still = fitted_alone(settings, source, subject, lambda done, steps: count("fitting", done, steps))
    return {
        "train_views": len(subject.views("train")),
        "test_views": len(subject.cases()),
        "seconds": time.perf_counter() - started,
        **means_of(lambda _: still, source.catalog, subject.cases()),
    }


def fitted_alone(
    settings: TrainingSettings,
    source: Source,
    subject: UpperBoundSubject,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> DeformedGaussians:
    """Fit the subject by stage 1 alone; `progress` receives the finished and the total steps."""
    catalog = source.catalog
    rows = [ImageRow(subject.member, view, subject.appearance) for view in subject.views("train")]
    data = TrainingData(load_examples(catalog, rows, source.normalization), (), catalog.plan.background)
    lighting = _lighting(source, subject)
    if subject.variation is not None and lighting is not None:
        first: AnyGaussians = replace(source.gaussians_on_surfaces(subject.variation), lighting=lighting)
    else:
        first = source.initial_gaussians(data, settings, own_colors=subject.variation is None)
    gaussians = first.to(chosen_device(settings.device))
    run = StageRun(canonical_stage(gaussians, settings), settings, data)
    while run.step < run.stage.steps:
        run.advance()
        if run.step % REPORT_STEPS == 0 or run.step == run.stage.steps:
            progress(run.step, run.stage.steps)
    return DeformedGaussians(gaussians.drawn().copy(), {}, source.normalization, Rasterizer.of(settings))


def _reached(surrogate: Surrogate | None, source: Source, subject: UpperBoundSubject) -> dict[str, Any] | None:
    """Scores of the surrogate on the same images; None where it does not follow this appearance."""
    if surrogate is None or surrogate.training["appearance"] != source.appearance:
        return None
    if not set(subject.varied) <= set(surrogate.visualization_names):
        return None
    return {
        "fingerprint": surrogate.training["fingerprint"],
        "gaussians": len(surrogate.gaussians),
        **means_of(surrogate.using(GAUSSIANS).at, source.catalog, subject.cases()),
    }


def means_of(at: Callable[..., MemberModel], catalog: Catalog, cases: Sequence[Case]) -> dict[str, float | None]:
    """Mean "psnr" (dB) and "ssim" of images; None where there are none."""
    [scores] = score_cases(SurrogatePredictor(at, catalog.plan.background), catalog, cases)
    return {metric: mean(scores.values(), metric) for metric in ("psnr", "ssim")}
