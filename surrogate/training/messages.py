"""Messages of `surrogate train` on a terminal: what is about to be learnt, and how well it was."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import count
from pathlib import Path

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.splits import ordered_names, runs_of, shared_runs
from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering, field_of
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.words import FEWEST_LEARNT, joined_names, plural, shortened
from surrogate.evaluation.cases import VALIDATION, Case, base_cells
from surrogate.evaluation.metrics import TrueImage
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import mean, score_cases, spread
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.runs import RunFolder, RunRecord
from surrogate.training.content import empty_images
from surrogate.training.emulator import described
from surrogate.training.other_functions import number_of_pictures
from surrogate.training.source import Source

MOST_SCORED, FEWEST_SCORED = 40, 10  # test images: 40 of 512 x 512 pixels, fewer of larger ones
EMPTY_SHARE = 0.2  # of the images looked at, from which on there is one
UNKNOWN = "no member tests it, so nothing is known of unseen parameters"
HOLD_OUT, FEWEST = "--hold-out 0.2 keeps some aside", 3  # members, of which one may lie between others


def opening(run: RunFolder) -> Iterator[str]:
    """A new run's subject, members and duration."""
    source, catalog, record = Source(run.settings, run.catalog), run.catalog, run.record
    learnt = learnt_line(catalog.plan, source.appearance, source.variations)
    yield f"{run.catalog_path}: {learnt}{' (--appearance learns another)' if '; not ' in learnt else ''}"
    yield f"  {members_line(catalog)}"
    if record is not None and record.chosen:
        yield f"  {_budget(run)}"


def closing(surrogate: Surrogate, catalog: Catalog, folder: Path) -> Iterator[str]:
    """A surrogate's score on a few test images, and what comes next."""
    yield f"  {_score(surrogate, catalog)}"
    yield from (f"  {sentence}" for sentence in described(surrogate.scores))
    yield f"next: surrogate explore {folder}     (in a browser)"
    yield f"      surrogate evaluate {folder}    (tables and pictures)"


def about(run: RunFolder, surrogate: Surrogate) -> Iterator[str]:
    """A run's surrogate, its catalog and its training."""
    yield repr(surrogate)
    if run.missing:
        yield f"  {run.missing}"
    else:
        variations = surrogate.variations
        yield f"  {run.catalog_path}: {learnt_line(run.catalog.plan, str(surrogate.training['appearance']), variations)}"
        yield f"  {members_line(run.catalog)}"
        if text := tests_line(run.catalog):
            yield f"  {text}"
    for parameter in (p for v in surrogate.visualizations for p in v.variation.space.parameters):
        yield f"  {parameter}"
    for name, value in surrogate.training.get("settings", {}).items():
        yield f"  {name:<22} {value}"
    for choice in surrogate.training.get("choices", ()):
        yield f"  needed: {choice['name']:<22} {choice['kept']}"
    yield from (f"  {sentence}" for sentence in described(surrogate.scores))
    if surrogate.field is not None and VALIDATION in surrogate.field.splits:
        yield "  its emulated field learnt from validation members, too, once they had chosen"
    if {"seconds", "steps"} <= set(surrogate.training):
        yield f"  trained in {surrogate.training['seconds']:.0f} s, {surrogate.training['steps']} steps"


def learnt_line(plan: CatalogPlan, appearance: str, variations: Sequence[Variation]) -> str:
    """Which of a catalog's appearances are learnt, over which parameters, and which are not."""
    target = next(a for a in plan.appearances if a.name == appearance)
    learnt = {appearance, *(s.appearance for v in variations for s in v.settings)}
    others = [name for name in plan.appearance_names if name not in learnt]
    label = plan.field_label(field_of(target))
    text = f"learns {_kind(target)} {appearance}{f' of {label}' if label else ''} over {plan.space}"
    if variations:
        text += f", and {' and '.join(f'{len(v.settings)} {v.plural}' for v in variations)}"
    return text + (f"; not {shortened(others, 4)}" if others else "")


def members_line(catalog: Catalog) -> str:
    """Numbers of members for training, validation and testing; without the last, what remains unknown."""
    members = catalog.members
    counts = Counter(member.split for member in members)
    views = any("validation" in member.view_splits for member in members)
    choosing = counts["validation"] or ("some of their views" if views else 0)
    text = (
        f"{len(members)} member{'s' * (len(members) != 1)}: {counts['train']} for training, {choosing} for validation"
    )
    if counts["test"]:
        return f"{text}, {counts['test']} for testing"
    return f"{text}; {UNKNOWN}" + (f" ({HOLD_OUT})" if len(members) >= FEWEST else "")


def absent_line(catalog: Catalog, appearance: str) -> str:
    """Numbers of members that failed, are unfinished, or do not show the learnt appearance, and the remedy; "" without any."""
    lacking = sum(appearance not in member.appearances for member in catalog.members)
    counts = {
        "missing": len(catalog.missing),
        "unfinished": len(catalog.unfinished()),
        f"without images of {appearance}": lacking,
    }
    said = joined_names(f"{count} {what}" for what, count in counts.items() if count)
    if not any(counts.values()):
        return ""
    return (
        f"not all members of {catalog.path} are there to learn from ({said}): to finish them, run the command that rendered "
        f"them again; `catalogs show {catalog.path}` lists them"
    )


def grown_line(catalog: Catalog, appearance: str, folder: Path) -> str:
    """A sentence on members that were rendered after the run in `folder` began, and how to learn from them; "" without any."""
    names = sorted(
        {path.name for path in catalog.member_paths()} - set(catalog.splits.members if catalog.splits else ())
    )
    more = sum(appearance in catalog.member(name).appearances for name in names) if catalog.splits else 0
    if not more:
        return ""
    said, record = f"{plural(more, 'member')} of {catalog.path} came after this run began", RunRecord.load(folder)
    if record is not None and record.asked:
        return f"{said}: once it is finished, `surrogate train {folder} --new-members` goes on with them from its model"
    free = next(place for n in count(2) if not (place := folder.with_name(f"{folder.name}-{n}")).exists())
    return f"{said}: `surrogate train {catalog.path} -o {free}` begins a run with them"


def growing_line(run: RunFolder) -> str:
    """A sentence on a training that goes on from a finished model."""
    settings, grown = run.settings, (run.record.chosen if run.record else {}).get("grown", {})
    steps = settings.deformation_steps if "deformation_steps" in grown.get("settings", {}) else 0
    steps += settings.visualization_steps * len(Source(settings, run.catalog).variations) if steps else 0
    later = plural(grown.get("members", 0), "later member")
    return f"goes on from its model with {later}, {steps:,} steps" if steps else f"takes {later} in"


def starting(source: Source) -> Iterator[str]:
    """Sentences on what a training can't learn from its catalog, or that tests it less than it seems to."""
    catalog, space = source.catalog, source.catalog.plan.space
    members = [m for m in catalog.members if m.split == "train" and source.appearance in m.appearances]
    yield from filter(None, (tests_line(catalog), absent_line(catalog, source.appearance)))
    if len(members) < FEWEST_LEARNT and len(space):
        yield (
            f"{len(members)} member{'s' * (len(members) != 1)} for training: a surrogate of so few can at best blend between them; "
            "render more members, or hold out fewer"
        )
    for name in space.names if len(members) > 1 else ():
        values = {member.parameters[name] for member in members}
        if len(values) == 1:
            yield (
                f"{name} is {values.pop()!r} in all members for training, so nothing is learnt of it: render members with other "
                "values, or leave it out of the parameters"
            )
    yield from filter(None, [p.note_on([m.parameters[p.name] for m in members]) for p in space.parameters])
    empty, looked_at = empty_images(source)
    if empty > EMPTY_SHARE * looked_at:
        yield (
            f"{empty} of {looked_at} training images looked at are empty: if that is wrong, render with another transfer function, "
            "isovalue or bounds"
        )


def tests_line(catalog: Catalog) -> str:
    """A sentence on test members whose runs were learnt from, or were not; "" without test members, and where runs are members."""
    members, space = catalog.members, catalog.plan.space
    tests, shared = [m for m in members if m.split == "test"], shared_runs(members, space)
    names, runs = " and ".join(ordered_names(space)) or "nothing", len(runs_of(members, space))
    if not tests or runs == len(members):
        return ""
    if not shared:
        return f"no test member shares a run with a training member: {len(runs_of(tests, space))} of {runs} whole runs test"
    if runs == 1:
        return f"all members are dumps of one run (only {names} differs), so dumps of it test: nothing is known of other runs"
    if runs < FEWEST:
        return f"the members are dumps of {runs} runs, too few to keep one aside, so dumps of both test: scores flatter"
    return (
        f"{len(shared)} of {len(tests)} test members share a run with a training member (only {names} differs), so their "
        "scores flatter: --hold-out in a new run (-o) keeps whole runs aside, where one lies between others"
    )


def _kind(appearance: Appearance) -> str:
    if isinstance(appearance, VolumeRendering):
        return "the volume rendering"
    return "the isosurface" if isinstance(appearance, Isosurface) else "the pictures"


def _budget(run: RunFolder) -> str:
    settings, chosen = run.settings, dict(run.record.chosen if run.record else {})
    stages = settings.canonical_steps + settings.deformation_steps
    text = f"{settings.gaussians:,} Gaussians, {chosen.get('steps', stages):,} steps"
    pace, minutes = chosen.get("milliseconds_per_step"), (run.record.asked if run.record else {}).get("minutes")
    if not pace or not minutes:
        return text
    return f"{text} of {pace:.3g} ms, which should take {minutes:g} {'minute' if minutes == 1 else 'minutes'} in all"


@one_torch_thread()
def _score(surrogate: Surrogate, catalog: Catalog) -> str:
    cells = base_cells(catalog, str(surrogate.training["appearance"]))
    at = partial(surrogate.at, outside="allow")
    for views, parameters, words in (
        ("unseen_views", "unseen_parameters", "unseen views and parameters"),
        ("seen_views", "unseen_parameters", "unseen parameters"),
        ("unseen_views", "seen_parameters", f"unseen views of members that it learnt from; {UNKNOWN}"),
    ):
        group: list[Case] = list(cells[views][parameters])
        if group:
            most = number_of_pictures(group[0].camera, MOST_SCORED, FEWEST_SCORED)
            some = [group[i] for i in spread(len(group), most)]
            predictor = SurrogatePredictor(at, catalog.plan.background)
            [scores] = score_cases(predictor, catalog, some, metrics=TrueImage.psnr_alone)
            return f"PSNR {mean(scores.values(), 'psnr'):.2f} dB over {len(some)} test images: {words}"
    return "no image tests it: the catalog has no view and no member that was not learnt from"
