"""How well a surrogate follows the visualization parameters: at trained settings and at others, beside trivial predictors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from catalogs.catalog import Catalog, Member
from catalogs.variations import Variation
from surrogate.deformation.visualization import Visualization
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.evaluation.scoring import PARAMETERS, Case, Report, Scored, Scorer, cases_of, compare
from surrogate.evaluation.timing import Milliseconds, measure
from surrogate.evaluation.trivial.interpolation import Predictor
from surrogate.evaluation.trivial.settings import Trained, mixtures, setting_predictors
from surrogate.model import Surrogate

SETTINGS = {"seen_settings": ("train",), "unseen_settings": ("test",)}
MOST_VARIED = 300  # images per cell
TIMED = 30
VALIDATION = "validation"
AT_NEAREST = "the surrogate at the nearest trained setting"

DEFINITIONS = {"covered": "share of an image's pixels that are foreground in the truth, as above; mean over images"}


@dataclass(frozen=True, eq=False)
class SettingBaseline:
    """What something else made of unseen settings.

    Attributes
    ----------
    scores : by column of `PARAMETERS`, and "validation"; only of images that could be predicted.
    shown : per column, the fewest and the most trained settings that a predicted member shows; empty for what needs none.
    """

    name: str
    scores: Mapping[str, Sequence[Scored]]
    shown: Mapping[str, tuple[int, int]]


@dataclass(frozen=True, eq=False)
class VariedEvaluation:
    """One variation.

    Attributes
    ----------
    deformation : the kind of F_vis.
    cells : scored images, of unseen views, by row of `SETTINGS` and column of `PARAMETERS`.
    validation : of validation members under validation settings, at any view but those that test.
    milliseconds : of a "visualization_change" and of a "view_change" after it.
    """

    variation: Variation
    deformation: str
    cells: Mapping[str, Mapping[str, Sequence[Scored]]]
    validation: Sequence[Scored]
    baselines: Sequence[SettingBaseline]
    milliseconds: Mapping[str, Milliseconds]

    @property
    def scored(self) -> list[Scored]:
        """All images of all cells."""
        return [s for row in self.cells.values() for group in row.values() for s in group]


def evaluate_variation(
    surrogate: Surrogate,
    visualization: Visualization,
    catalog: Catalog,
    perceptual: PerceptualMetrics,
    *,
    most_perceptual: int,
    progress: Report,
) -> VariedEvaluation:
    """Score one of the surrogate's visualizations."""
    variation, members = visualization.variation, catalog.members
    chosen = images_of_varied_cells(members, variation)
    judging = VALIDATION if variation.continuous else "train"  # of fields all are learnt
    watched = drawn_evenly(_cases(members, variation, (judging,), (VALIDATION,), ("train", VALIDATION)))
    unseen = {**chosen["unseen_settings"], VALIDATION: watched}
    total = sum(len(group) for row in chosen.values() for group in row.values()) + len(watched)
    total += len(unseen["unseen_parameters"])  # once more, at the nearest trained setting
    stage = f"surrogate, {variation.name}"
    scorer = Scorer(surrogate, catalog, lambda done: progress(stage, done, total))
    cells = {
        row: {
            column: scorer.score(group, perceptual, most_perceptual=most_perceptual) for column, group in groups.items()
        }
        for row, groups in chosen.items()
    }
    validation = scorer.score(watched)
    baselines = _baselines(scorer, catalog, variation, unseen, progress) if variation.continuous else []
    milliseconds = _measure_times(surrogate, variation, members)
    return VariedEvaluation(variation, visualization.deformation.kind, cells, validation, baselines, milliseconds)


def _baselines(
    scorer: Scorer, catalog: Catalog, variation: Variation, unseen: Mapping[str, Sequence[Case]], progress: Report
) -> list[SettingBaseline]:
    """What stored pictures and the surrogate's own make of unseen settings."""
    return [
        *_mixture_baselines(catalog, variation, unseen, progress),
        _at_nearest(scorer, variation, unseen["unseen_parameters"]),
    ]


def images_of_varied_cells(members: Sequence[Member], variation: Variation) -> dict[str, dict[str, list[Case]]]:
    """The images that a visualization is judged by, at unseen views, by row of `SETTINGS` and column of `PARAMETERS`."""
    return {
        row: {
            column: drawn_evenly(_cases(members, variation, splits, PARAMETERS[column], ("test",)))
            for column in PARAMETERS
        }
        for row, splits in SETTINGS.items()
    }


def drawn_evenly(cases: Sequence[Case], most: int = MOST_VARIED) -> list[Case]:
    """At most `most` cases, in order: drawn by a fixed seed, equally many of each member and setting, give or take one."""
    order = np.random.default_rng(0).permutation(len(cases)).tolist()
    taken: Counter[tuple[str, str]] = Counter()
    turns = []
    for i in order:
        group = cases[i].member.name, cases[i].appearance
        turns.append((taken[group], i))
        taken[group] += 1
    kept = [i for _, i in sorted(turns, key=lambda turn: turn[0])[:most]]
    return [cases[i] for i in sorted(kept)]


def _cases(
    members: Sequence[Member],
    variation: Variation,
    setting_splits: Sequence[str],
    member_splits: Sequence[str],
    view_splits: Sequence[str],
) -> list[Case]:
    named = {s.appearance: variation.asked(s) for s in variation.settings if s.split in setting_splits}
    return cases_of(members, named, member_splits, view_splits)


def _mixture_baselines(
    catalog: Catalog, variation: Variation, columns: Mapping[str, Sequence[Case]], progress: Report
) -> list[SettingBaseline]:
    """Predictors from stored images; members that show no trained setting are left out."""
    predictors = setting_predictors(variation)
    members = {case.member.name: case.member for cases in columns.values() for case in cases}
    shown = {name: Trained.of(variation, member.appearances) for name, member in members.items()}
    able = {c: [case for case in cases if len(shown[case.member.name])] for c, cases in columns.items()}
    found: list[dict[str, list[Scored]]] = [{} for _ in predictors]
    done, total = 0, sum(map(len, able.values()))
    with ThreadPoolExecutor(2) as pool:
        for column, cases in able.items():
            for scores in found:
                scores[column] = []
            for row in pool.map(lambda case: _score_mixtures(catalog, variation, shown, case, predictors), cases):
                for scores, scored in zip(found, row, strict=True):
                    scores[column].append(scored)
                done += 1
                progress("trivial predictors of settings", done, total)
    counts = {c: [len(shown[case.member.name]) for case in cases] for c, cases in able.items()}
    span = {c: (min(values), max(values)) for c, values in counts.items() if values}
    return [SettingBaseline(p.name, scores, span) for p, scores in zip(predictors, found, strict=True)]


def _score_mixtures(
    catalog: Catalog,
    variation: Variation,
    shown: Mapping[str, Trained],
    case: Case,
    predictors: Sequence[Predictor],
) -> list[Scored]:
    truth = catalog.image(case.member, case.appearance, case.view)
    wanted = variation.normalize(variation.values_of(case.varied))  # [V]
    pictures = mixtures(catalog, shown[case.member.name], case.member, case.view, wanted, predictors)
    return [compare(case, truth, picture, catalog.plan.background) for picture in pictures]


def _at_nearest(scorer: Scorer, variation: Variation, cases: Sequence[Case]) -> SettingBaseline:
    """What one would get if F_vis said nothing between the settings that it learnt."""
    trained = Trained.of(variation)

    def shown_at(case: Case) -> dict[str, float | str]:
        nearest = variation.setting(trained.nearest(variation.normalize(variation.values_of(case.varied))))
        return {**case.member.parameters, **({} if nearest is None else variation.asked(nearest))}

    return SettingBaseline(AT_NEAREST, {"unseen_parameters": scorer.score(cases, shown_at=shown_at)}, {})


def _measure_times(surrogate: Surrogate, variation: Variation, members: Sequence[Member]) -> dict[str, Milliseconds]:
    settings = [variation.settings[i % len(variation.settings)] for i in range(TIMED)]
    shown = [members[i % len(members)] for i in range(TIMED)]
    rows = [{**m.parameters, **variation.asked(s)} for m, s in zip(shown, settings, strict=True)]
    cameras = [m.cameras[i * len(m.cameras) // TIMED] for i, m in enumerate(shown)]
    change, draw = measure(surrogate, rows, cameras)
    return {"visualization_change": change, "view_change": draw}
