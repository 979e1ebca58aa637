"""The emulator of a catalog's coarse fields: fitted before the Gaussians, and compared with them on validation images."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering, field_of
from catalogs.vocabulary.words import joined_names
from surrogate.emulation import EmulatedFields
from surrogate.emulation.fitting import FEWEST
from surrogate.evaluation.cases import VALIDATION, Case, base_validation, variation_validation
from surrogate.evaluation.metrics import TrueImage
from surrogate.evaluation.predictor import SurrogatePredictor, pictures_of_all
from surrogate.evaluation.scoring import mean, score_cases, spread
from surrogate.model import Surrogate
from surrogate.model.field_model import FieldModel, scales_of
from surrogate.model.judged import ALL_LEARNT, LEARNT, judged
from surrogate.model.representation import DRAWN, FIELD, FUNCTION, GAUSSIANS, VIEW, RepresentationScores
from surrogate.provenance import code, commit
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.other_functions import number_of_pictures, scores_under_other_functions
from surrogate.training.source import Source

MOST_SCORED, FEWEST_SCORED = 48, 12  # validation images of each kind: 48 of 512 x 512 pixels, fewer of larger ones
MOST_LEFT_OUT = 4  # members
TIMED = 7  # pictures


class NoEmulator(ValueError):
    """No emulator of a catalog's coarse fields can be fitted; the message says why."""


def drawable(source: Source) -> tuple[Appearance, ...]:
    """The appearances that an emulated field can show: the base first, then those of its variations; () where the base is none."""
    if not isinstance(source.target, VolumeRendering | Isosurface):
        return ()
    names = {setting.appearance for variation in source.variations for setting in variation.settings}
    others = (a for a in source.catalog.plan.appearances if a.name in names)
    return (source.target, *(a for a in others if isinstance(a, VolumeRendering | Isosurface)))


def lacking(source: Source) -> str:
    """A sentence where no emulator can be fitted, and the remedy; "" where one can."""
    appearances = drawable(source)
    if not appearances:
        return f"{source.appearance} shows pictures of another program, of which no field is known"
    names = {setting.appearance for variation in source.variations for setting in variation.settings}
    if strange := sorted(names - {a.name for a in appearances}):
        return f"{joined_names(strange)} shows pictures of another program, of which no field is known"
    members = [m for m in source.catalog.members if m.split == "train"]
    if len(members) < FEWEST:
        return f"it takes {FEWEST} members or more to learn from"
    counts = Counter(name for member in members for name in member.coarse_names())
    for name in dict.fromkeys(map(field_of, appearances)):
        having = counts[name]
        if having < FEWEST:
            return (
                f"{having or 'none'} of {len(members)} members to learn from keep a coarse field{name and f' of {name}'}: "
                "`insitu dataset` or `insitu ensemble` with --add-coarse-fields adds them where the data still exist"
            )
    return ""


def fit(source: Source, fingerprint: str) -> FieldModel:
    """The emulator of each field, fitted to the members for training.

    Raises NoEmulator where too few members keep coarse fields, or they lie on different lattices.
    """
    if sentence := lacking(source):
        raise NoEmulator(f"{source.catalog.path}: {sentence}")
    started, processor = time.perf_counter(), time.process_time()
    appearances = drawable(source)
    try:
        emulators = EmulatedFields.fit(
            source.catalog, scales_of(appearances), LEARNT, required=set(map(field_of, appearances))
        )
    except ValueError as error:
        raise NoEmulator(f"{source.catalog.path}: {error}") from error
    for sentence in emulators.left_out:
        warnings.warn(f"a field that no appearance shows is left out: {sentence}", stacklevel=2)
    return FieldModel(
        emulators,
        appearances,
        source.variations,
        source.normalization,
        source.catalog.plan.background,
        _sample_distances(source.catalog),
        {
            "fingerprint": fingerprint,
            "appearance": source.appearance,
            "seconds": time.perf_counter() - started,
            "processor_seconds": time.process_time() - processor,
            "commit": commit(),
            "code_version": code(),
            "settings": source.settings.to_json(),
            "splits": list(LEARNT),
        },
    )


def _sample_distances(catalog: Catalog) -> dict[str, float]:
    """Those that the images were rendered with, by appearance; a variation's are those of its base."""
    distances = dict(catalog.plan.provenance.get("sample_distances") or {})
    names = {s.appearance: v.base for v in catalog.plan.variations if v.edits_base for s in v.settings}
    return distances | {name: distances[base] for name, base in names.items() if base in distances}


@one_torch_thread()
def compared(surrogate: Surrogate, catalog: Catalog) -> RepresentationScores:
    """Scores of what the surrogate holds on validation images, by kind of question, with its size and speed."""
    appearance, background = str(surrogate.training["appearance"]), catalog.plan.background
    base = base_validation(catalog, appearance)
    groups = {VIEW: _of_validation_members(base)}
    groups |= {v.kind: _of_validation_members(variation_validation(catalog, v)) for v in surrogate.variations}
    psnr: dict[str, dict[str, float]] = {}
    names = surrogate.representations
    predictor = SurrogatePredictor(_at(surrogate.using(names[-1])), background, names=names, pictures=pictures_of_all)
    for kind, cases in groups.items():
        scored = score_cases(predictor, catalog, cases, metrics=TrueImage.psnr_alone)
        for name, scores in zip(names, scored, strict=True):
            if (score := mean(scores.values(), "psnr")) is not None:
                psnr.setdefault(kind, {})[name] = score
    left_out = {} if groups[VIEW] else _better_without(surrogate, catalog, base)
    if left_out:
        psnr[VIEW] = left_out
    if FUNCTION not in psnr and (under := scores_under_other_functions(surrogate, catalog)):
        psnr[FUNCTION] = under
    return RepresentationScores(psnr, surrogate.sizes, speeds(surrogate, catalog.members), bool(left_out))


def _better_without(surrogate: Surrogate, catalog: Catalog, cases: Sequence[Case]) -> dict[str, float]:
    """The score of the field on members that its emulators were fitted without, for lack of members for validation.

    Only where it beats the Gaussians, who learnt from these members: then it is better at unseen ones, too.
    """
    model, names = surrogate.field, list(dict.fromkeys(case.member.name for case in cases))
    if model is None or len(names) <= FEWEST:
        return {}
    scales = scales_of(model.appearances)
    scores: dict[str, list[float]] = {FIELD: [], GAUSSIANS: []}
    for name in (names[i] for i in spread(len(names), MOST_LEFT_OUT)):
        fields = replace(model, emulators=EmulatedFields.fit(catalog, scales, without=name, required=model.emulators))
        of_member = [case for case in cases if case.member.name == name]
        some = [of_member[i] for i in spread(len(of_member), MOST_SCORED // MOST_LEFT_OUT)]
        for kind in set(scores) & set(surrogate.representations):
            predictor = SurrogatePredictor(_at(replace(surrogate, field=fields).using(kind)), model.background)
            [scored] = score_cases(predictor, catalog, some, metrics=TrueImage.psnr_alone)
            scores[kind] += [score for score in [mean(scored.values(), "psnr")] if score is not None]
    field, gaussians = (float(np.mean(of)) if of else float("-inf") for of in scores.values())
    return {FIELD: field} if field > gaussians else {}


def with_emulator(source: Source, directory: Path, fingerprint: str, *, required: bool = False) -> str:
    """Fit and keep the emulator of a run in `directory`, where it has none; a sentence where none can be fitted, else "".

    Raises NoEmulator where one is `required` and can't be, ValueError where `directory` holds that of another run.
    """
    if FieldModel.exists(directory):
        if FieldModel.fingerprint(directory) != fingerprint:
            raise ValueError(
                f"{directory} holds the emulator of another run: delete that folder, or train into another one"
            )
        return ""
    try:
        fit(source, fingerprint).save(directory)
    except NoEmulator as error:
        if required:
            raise
        return str(error)
    return ""


def with_scores(surrogate: Surrogate, catalog: Catalog, directory: Path) -> Surrogate:
    """The surrogate in `directory` with the scores of all that it holds: compared and kept there now, unless that was done."""
    if surrogate.field is None or set(surrogate.scores.milliseconds) == set(surrogate.representations):
        return surrogate
    scores = compared(judged(surrogate, catalog), catalog)
    scores.save(directory)
    return replace(surrogate, scores=scores)


def with_choices(surrogate: Surrogate, catalog: Catalog, directory: Path) -> Surrogate:
    """The same, whose emulator then learns from validation members, too, and is kept there."""
    surrogate = with_scores(surrogate, catalog, directory)
    if surrogate.field is None:
        return surrogate
    last = _with_validation_members(surrogate.field, catalog)
    if last is not surrogate.field:
        last.save(directory)
    return replace(surrogate, field=last)


def _with_validation_members(field: FieldModel, catalog: Catalog) -> FieldModel:
    """The emulator that learns from them too, if it can."""
    if not any(member.split == VALIDATION and member.coarse_names() for member in catalog.members):
        return field
    try:
        return field.learning(catalog, ALL_LEARNT)
    except ValueError:  # their fields lie on another grid
        return field


def _of_validation_members(cases: Sequence[Case]) -> list[Case]:
    """Some cases of members for validation: what was learnt from says nothing of unseen parameters."""
    unseen = [case for case in cases if case.member.split == VALIDATION]
    most = number_of_pictures(unseen[0].camera, MOST_SCORED, FEWEST_SCORED) if unseen else 0
    return [unseen[i] for i in spread(len(unseen), most)]


def _at(surrogate: Surrogate) -> Any:
    return partial(surrogate.at, outside="allow")


def speeds(surrogate: Surrogate, members: Sequence[Member]) -> dict[str, float]:
    """Milliseconds of a picture of the catalog's size by each representation, the median of a few views of one member."""
    milliseconds: dict[str, float] = {}
    for name in surrogate.representations:
        member = surrogate.using(name).at(members[0].parameters, outside="allow")
        views = [members[0].cameras[i] for i in spread(len(members[0].cameras), TIMED)]
        member.render(views[0])
        seconds = []
        for view in views:
            started = time.perf_counter()
            member.render(view)
            seconds.append(time.perf_counter() - started)
        milliseconds[name] = 1e3 * float(np.median(seconds))
    return milliseconds


def described(scores: RepresentationScores, kind: str = VIEW) -> Iterator[str]:
    """A sentence on what draws an ensemble best, with both representations' scores; nothing where nothing tells."""
    psnr = scores.psnr.get(kind, {})
    best, *others = sorted(psnr, key=lambda name: -psnr[name]) or [""]
    if best:
        yield f"drawn {'best ' if others else ''}{DRAWN[best]}: {_facts(scores, psnr, best)}"
    for name in others:
        yield f"  {DRAWN[name]}: {_facts(scores, psnr, name)}"


def _facts(scores: RepresentationScores, psnr: Mapping[str, float], name: str) -> str:
    size, milliseconds = scores.megabytes.get(name, 0.0), scores.milliseconds.get(name, 0.0)
    of = "left-out members" if scores.left_out else "validation images"
    return f"{psnr[name]:.1f} dB on {of}, {size:.2g} MB, {milliseconds:.2g} ms a picture"
