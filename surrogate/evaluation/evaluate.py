"""Accuracy and speed of a surrogate on images that it never learnt from, beside the trivial predictors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import Variation
from surrogate.evaluation.cases import (
    VALIDATION,
    Case,
    CaseCells,
    all_cases,
    base_cells,
    base_validation,
    sample_of,
    variation_cells,
    variation_validation,
)
from surrogate.evaluation.numbers import FieldNumbers, numbers_of
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.evaluation.pictures import DecodedImages, Images
from surrogate.evaluation.predictor import Predictor, SurrogatePredictor
from surrogate.evaluation.scoring import Cells, Report, Scored, by_cell, score_cases, spread
from surrogate.evaluation.timing import Milliseconds, measure
from surrogate.evaluation.trivial.interpolation import joint_rules, setting_rules
from surrogate.evaluation.trivial.members import member_mixtures
from surrogate.evaluation.trivial.mixtures import Mixtures
from surrogate.evaluation.trivial.settings import SettingPictures, TrainedPictures
from surrogate.model import Surrogate
from surrogate.model.judged import judged
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS, VIEW
from surrogate.splatting.threads import one_torch_thread

VERSION = 3
MOST_PERCEPTUAL = 40  # images of a cell: six cells at 110 ms an image (256 x 256) take 26 s
APPLIED, EMULATED = "applied", "emulated"
REPRESENTED = {
    FIELD: "the emulated field, drawn",
    GAUSSIANS: "the Gaussians",
    BOTH: "the mean image of Gaussians and field",
}
MEAN_IMAGE = "mean image"  # of the training members, at the same view
AT_NEAREST = "the surrogate at the nearest trained setting"
AT_CENTER = "the surrogate at the centre of the parameters"

DEFINITIONS = {"covered": "share of an image's pixels that are foreground in the truth, as above; mean over images"}

CaseGroups = Mapping[str, Sequence[Case]]
Pictures = Iterator[tuple[Case, NDArray[Any]]]


@dataclass(frozen=True, eq=False)
class Baseline:
    """A predictor that the surrogate is compared with.

    Attributes
    ----------
    scores : scores of the images that it can predict: at unseen parameters by row of `VIEWS`, or under unseen settings
        by column of `PARAMETERS`; and "validation".
    degrees : largest angle between a view and the stored view that stands in for it.
    settings : per column, the fewest and the most trained settings of a predicted member.
    representation : of the surrogate, that it draws; "" for other predictors.
    pictures : predicts the cases that it can, in any order: premultiplied RGBA (H, W, 4), uint8 or float32.
    """

    name: str
    scores: Mapping[str, Sequence[Scored]] = field(repr=False)
    degrees: float = 0.0
    settings: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    representation: str = ""
    pictures: Callable[[Sequence[Case]], Pictures] = field(default=lambda _: iter(()), repr=False)


@dataclass(frozen=True, eq=False)
class VariedEvaluation:
    """Scores of a surrogate under one variation.

    Attributes
    ----------
    deformation : the kind of visualization deformation; "applied" where transfer functions are applied to carried values,
        "emulated" where the emulated field is drawn.
    cells : scored images, of unseen views, by row of `SETTINGS` and column of `PARAMETERS`.
    validation : of validation members under validation settings, from all but test views.
    milliseconds : of a "visualization_change" and of a "view_change" after it.
    at_center : the same cells for the surrogate frozen at the centre of the simulation's parameters, under the images'
        own settings; empty without such parameters.
    """

    variation: Variation
    deformation: str
    cells: Cells = field(repr=False)
    validation: Sequence[Scored] = field(repr=False)
    baselines: Sequence[Baseline] = field(repr=False)
    milliseconds: Mapping[str, Milliseconds]
    at_center: Cells = field(default_factory=dict, repr=False)

    @property
    def scored(self) -> list[Scored]:
        """All images, of all cells and for validation."""
        return [*(s for row in self.cells.values() for group in row.values() for s in group), *self.validation]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All results of an evaluation, as a report shows them.

    Attributes
    ----------
    cells : scored images of the base appearance, by row of `VIEWS` and column of `PARAMETERS`.
    validation : scores of validation members, otherwise validation views, on which choices are made.
    baselines : trivial predictors at unseen parameters.
    milliseconds : of a "parameter_change" and a "view_change".
    variations : of the visualization parameters that the surrogate follows.
    unavailable : the reason why a perceptual metric is missing on this machine, by its name.
    at_center : the same cells for the surrogate frozen at the centre of its parameters, which shows the value of
        parameter dependence; empty without parameters.
    numbers : errors of emulated fields at test members; empty without an emulator.
    """

    cells: Cells = field(repr=False)
    validation: Sequence[Scored] = field(repr=False)
    baselines: Sequence[Baseline] = field(repr=False)
    milliseconds: Mapping[str, Milliseconds]
    variations: Sequence[VariedEvaluation] = ()
    unavailable: Mapping[str, str] = field(default_factory=dict)
    at_center: Cells = field(default_factory=dict, repr=False)
    numbers: Sequence[FieldNumbers] = ()


@one_torch_thread()
def evaluate(surrogate: Surrogate, catalog: Catalog, *, progress: Report = lambda *_: None) -> Evaluation:
    """Score `surrogate` on the test and validation images of `catalog`."""
    as_judged = judged(surrogate, catalog)
    engine = _Engine(surrogate, as_judged, catalog, progress, PerceptualMetrics.load(), DecodedImages(catalog))
    appearance = str(surrogate.training["appearance"])
    cells, watched = base_cells(catalog, appearance), base_validation(catalog, appearance)
    validated, unseen = sample_of(watched), {row: columns["unseen_parameters"] for row, columns in cells.items()}
    scored = engine.cells("surrogate", cells, validated, list(unseen.values()))
    groups = {**unseen, VALIDATION: [case for case in validated if case.member.split == VALIDATION]}
    change, view = measure(surrogate, catalog.members)
    return Evaluation(
        *scored,
        [*engine.other_representations(VIEW, groups), *engine.member_baselines(appearance, groups, watched)],
        {"parameter_change": change, "view_change": view},
        [engine.variation(variation) for variation in surrogate.variations],
        engine.perceptual.unavailable,
        engine.at_center(AT_CENTER, cells),
        engine.numbers(),
    )


def measured_row(variation: Variation) -> str:
    """The row of `SETTINGS` by which predictors are compared: all settings of a field are trained, so none is unseen."""
    return "unseen_settings" if variation.continuous else "seen_settings"


def _pictures(predictor: Predictor, number: int, cases: Sequence[Case]) -> Pictures:
    """The pictures of cases by one of a predictor's names."""
    for batch, draw in predictor.batches(cases):
        for case in batch:
            yield case, list(draw(case))[number]


@dataclass(frozen=True, eq=False)
class _Engine:
    """Scores the surrogate and its baselines on groups of images of one catalog."""

    surrogate: Surrogate
    as_judged: Surrogate  # the same before it learnt from validation members
    catalog: Catalog
    progress: Report
    perceptual: PerceptualMetrics
    images: Images

    def predictor(self, using: str = "", **more: Any) -> SurrogatePredictor:
        """The surrogate at members' parameters, which may lie outside the bounds, drawn by a representation or the best."""
        ats = [
            partial((one.using(using) if using else one).at, outside="allow")
            for one in (self.surrogate, self.as_judged)
        ]
        return SurrogatePredictor(ats[0], self.catalog.plan.background, at_validation=ats[1], **more)

    def cells(
        self, stage: str, cells: CaseCells, validation: Sequence[Case], looked_into: Sequence[Sequence[Case]]
    ) -> tuple[Cells, list[Scored]]:
        """Scores of the surrogate's test images by cell, and of validation images; some of `looked_into` by perceptual
        metrics too."""
        few = {group[i] for group in looked_into for i in spread(len(group), MOST_PERCEPTUAL)}
        cases, progress = [*all_cases(cells), *validation], partial(self.progress, stage)
        [scores] = score_cases(
            self.predictor(), self.images, cases, perceptual=self.perceptual, looked_at=few, progress=progress
        )
        return by_cell(cells, scores), [scores[case] for case in validation]

    def at_center(self, stage: str, cells: CaseCells) -> Cells:
        """Scores of the same test images, with the simulation's parameters at their centre."""
        middle, progress = self.surrogate.space.middle, partial(self.progress, stage)
        if not middle:
            return {}

        def at_middle(case: Case) -> dict[str, float | str]:
            return {**middle, **case.varied}

        frozen = self.predictor(parameters_of=at_middle, names=(AT_CENTER,))
        [scores] = score_cases(frozen, self.images, all_cases(cells), progress=progress)
        return by_cell(cells, scores)

    def baselines(self, stage: str, predictor: Predictor, groups: CaseGroups, **facts: Any) -> list[Baseline]:
        """Scores of a predictor on named groups of images, where it can predict them; `facts` are stated for all its names."""
        cases, progress = [case for group in groups.values() for case in group], partial(self.progress, stage)
        scores = score_cases(predictor, self.images, cases, progress=progress)
        return [
            Baseline(
                name,
                {g: [scores_of[c] for c in group if c in scores_of] for g, group in groups.items()},
                pictures=partial(_pictures, predictor, number),
                **facts,
            )
            for number, (name, scores_of) in enumerate(zip(predictor.names, scores, strict=True))
        ]

    def other_representations(self, kind: str, groups: CaseGroups) -> list[Baseline]:
        """Scores of the representations that the surrogate holds besides the one that draws it."""
        baselines: list[Baseline] = []
        for name, megabytes in self.surrogate.sizes.items():
            if name != self.surrogate.representation(kind):
                title = f"{REPRESENTED[name]} ({megabytes:.2g} MB)"
                predictor = self.predictor(name, names=(title,))
                baselines += self.baselines(f"{title}, {kind}", predictor, groups, representation=name)
        return baselines

    def numbers(self) -> list[FieldNumbers]:
        """Errors of what the emulator says of test members' fields."""
        field, progress = self.surrogate.field, partial(self.progress, "numbers of emulated fields")
        return [] if field is None else numbers_of(field.emulators, self.catalog.members, progress)

    def variation(self, variation: Variation) -> VariedEvaluation:
        """Scores of the surrogate under one variation."""
        members = self.catalog.members
        cells, validated = variation_cells(self.catalog, variation), variation_validation(self.catalog, variation)
        few = [group for row in cells.values() for group in row.values()]
        scored = self.cells(f"surrogate, {variation.name}", cells, validated, few)
        baselines = self.setting_baselines(variation, {**cells["unseen_settings"], VALIDATION: validated})
        change, view = measure(
            self.surrogate, members, [variation.arguments(setting) for setting in variation.settings]
        )
        milliseconds = {"visualization_change": change, "view_change": view}
        frozen = self.at_center(f"{AT_CENTER}, {variation.name}", cells)
        others = self.other_representations(variation.kind, {**cells[measured_row(variation)], VALIDATION: validated})
        return VariedEvaluation(
            variation, self._follows(variation), *scored, [*others, *baselines], milliseconds, frozen
        )

    def _follows(self, variation: Variation) -> str:
        """The kind of visualization deformation that follows a variation, `APPLIED` or `EMULATED`."""
        if self.surrogate.representation(variation.kind) == FIELD:
            return EMULATED
        deformations = [v.deformation for v in self.surrogate.visualizations if v.variation == variation]
        return APPLIED if not deformations or deformations[0] is None else deformations[0].kind

    def member_baselines(self, appearance: str, groups: CaseGroups, watched: Sequence[Case]) -> list[Baseline]:
        """Mixtures of training members; their constants are chosen on `watched` validation images."""
        cases = [case for group in groups.values() for case in group]
        if not cases or not any(m.split == "train" and appearance in m.appearances for m in self.catalog.members):
            return []
        pictures, mixtures = member_mixtures(
            self.images, self.catalog.members, self.surrogate.space, appearance, watched
        )
        degrees = pictures.borrowed_degrees(cases)
        return self.baselines("trivial predictors", mixtures, groups, degrees=degrees)

    def setting_baselines(self, variation: Variation, groups: CaseGroups) -> list[Baseline]:
        """Baselines at unseen settings from stored images of trained settings, and from the surrogate at the nearest
        one; empty for fields."""
        if not variation.continuous:
            return []
        stage, pictures = "trivial predictors of settings", SettingPictures(variation)
        counts = {name: [len(pictures.trained_in(case.member)) for case in group] for name, group in groups.items()}
        span = {
            name: (min(present), max(present)) for name, of in counts.items() if (present := list(filter(None, of)))
        }
        mixtures = Mixtures(self.images, pictures, setting_rules(len(variation.space), variation.plural))

        def at_nearest(case: Case) -> dict[str, float | str]:
            nearest = variation.setting(pictures.trained.nearest(pictures.place(case)))
            return {**case.member.parameters, **({} if nearest is None else variation.arguments(nearest))}

        unmoved = self.predictor(parameters_of=at_nearest, names=(AT_NEAREST,))
        unseen = {"unseen_parameters": groups["unseen_parameters"]}
        of_member = self.baselines(stage, mixtures, groups, settings=span)
        joint = self.joint_baselines(variation, {**unseen, VALIDATION: groups[VALIDATION]})
        return [*of_member, *self.baselines(stage, unmoved, unseen), *joint]

    def joint_baselines(self, variation: Variation, groups: CaseGroups) -> list[Baseline]:
        """Baselines at unseen members under unseen settings, from training members under trained settings."""
        space, members = self.surrogate.space, self.catalog.members
        pictures, cases = TrainedPictures.of(variation, space, members), [case for of in groups.values() for case in of]
        if pictures is None or not cases or not len(space):
            return []
        mixtures = Mixtures(self.images, pictures, joint_rules(len(space), len(variation.space)))
        degrees = pictures.pictures.borrowed_degrees(cases)
        return self.baselines("trivial predictors from training members alone", mixtures, groups, degrees=degrees)
