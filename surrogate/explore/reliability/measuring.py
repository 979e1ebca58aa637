"""The error of a surrogate where it did not learn: measured once per run, and kept beside it.

Validation members are measured, and training members at views that training did not see.  Test members, views and settings are
never looked at.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from catalogs.files.images import ImageError
from catalogs.store.catalog import Catalog, Member
from surrogate.evaluation.metrics import WHITE, composite, psnr
from surrogate.evaluation.scoring import Report, spread
from surrogate.explore.reliability.points import appearances_of, base_name
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.model import MemberModel, Surrogate
from surrogate.model.judged import judged, model_key
from surrogate.storage.records import Provenance, Record

FILE = Path("explore") / "expectation.json"
KIND, VERSION = "expectation", 3  # 1 was no `Record`, 2 did not say what drew the pictures
VIEWS = 5  # of a member: its views differ by 0.3 to 1 dB, so their mean is known to 0.1 to 0.5 dB
MOST_VALIDATION, MOST_TRAINING, MOST_VARIED = 60, 80, 80  # cases: some 1,000 pictures of 10 ms at most


@dataclass(frozen=True)
class Measurement:
    """The error of one member in one appearance."""

    member: str
    split: str
    parameters: Mapping[str, float]
    appearance: str
    varied: Mapping[str, float | str]  # the visualization parameters as a `Setting` has them
    psnr: tuple[float, ...]  # dB, of each view
    seen_views: bool  # whether training learnt from these views, for lack of others
    using: str = ""  # the representation that drew it

    def __post_init__(self) -> None:
        object.__setattr__(self, "psnr", tuple(map(float, self.psnr)))
        if not self.psnr or not all(map(math.isfinite, self.psnr)):
            raise ValueError(f"{self.member} needs finite decibels, got {self.psnr}")

    @property
    def setting(self) -> Setting:
        return Setting(self.parameters, self.varied, using=self.using)


@dataclass(frozen=True, eq=False, repr=False)
class PlannedMeasurement:
    """A member in one appearance at some views, to be measured."""

    member: Member
    appearance: str
    varied: Mapping[str, float | str]
    views: tuple[int, ...]
    seen_views: bool


def measurements(run: Run, progress: Report = lambda *_: None) -> tuple[Measurement, ...]:
    """The errors of the run's surrogate on its catalog, as kept in the run's folder; else measured now, and kept there.

    Empty without a catalog.  Where `progress` raises, nothing is kept.  Raises as `Run.members` does.
    """
    previous = kept_measurements(run)
    if previous is not None or run.catalog is None:
        return previous or ()
    key, started = key_of(run), time.process_time()
    measured = tuple(_measured(run.surrogate, run.catalog, cases_of(run.surrogate, run.members), progress))
    if run.folder is not None:
        values = {"measured": [asdict(one) for one in measured]}
        with suppress(OSError):  # of a run that can only be read it is measured anew each time
            Record(KIND, VERSION, key, values, Provenance.now(time.process_time() - started)).save(run.folder / FILE)
    return measured


def kept_measurements(run: Run) -> tuple[Measurement, ...] | None:
    """Those that were measured before; empty without a catalog, None where they must be measured.  Raises as `Run.members` does."""
    if run.catalog is None:
        return ()
    record = None if run.folder is None else Record.load(run.folder / FILE, KIND, VERSION, key_of(run))
    if record is not None:
        with suppress(KeyError, TypeError, ValueError):  # it is measured anew
            return tuple(Measurement(**values) for values in record.values["measured"])
    return None


def key_of(run: Run) -> dict[str, Any]:
    """The key of measurements: the model, the members, and which of their images are looked at."""
    return {
        **model_key(run.surrogate, run.members),
        "views": VIEWS,
        "cases": [MOST_VALIDATION, MOST_TRAINING, MOST_VARIED],
    }


def cases_of(surrogate: Surrogate, members: Sequence[Member]) -> list[PlannedMeasurement]:
    """Plan measurements: validation members, training members in the base appearance, and training members in varied appearances.

    Of training members only validation views are taken.  Of many cases some are chosen evenly.
    """
    settings = appearances_of(surrogate, ("train", "validation"))
    base = base_name(surrogate)
    validation = [case for m in members if m.split == "validation" for case in _cases(m, settings)]
    learnt = [m for m in members if m.split == "train" and "validation" in m.view_splits]
    training = [case for m in learnt for case in _cases(m, settings)]
    at_base = [case for case in training if case.appearance == base]
    return [
        *(validation[i] for i in spread(len(validation), MOST_VALIDATION)),
        *(at_base[i] for i in spread(len(at_base), MOST_TRAINING)),
        *_in_turn([case for case in training if case.appearance != base])[:MOST_VARIED],
    ]


def _cases(member: Member, settings: Mapping[str, Mapping[str, float | str]]) -> list[PlannedMeasurement]:
    """The member in each of the appearances that it was rendered in, at validation views; at training views without any."""
    by_training = "validation" not in member.view_splits
    numbers = [i for i, split in enumerate(member.view_splits) if split == ("train" if by_training else "validation")]
    views = tuple(numbers[i] for i in spread(len(numbers), VIEWS))
    return [
        PlannedMeasurement(member, a, varied, views, by_training)
        for a, varied in settings.items()
        if a in member.appearances and views
    ]


def _in_turn(cases: Sequence[PlannedMeasurement]) -> list[PlannedMeasurement]:
    """The cases in rounds: each round has every appearance once, at another member than the round before."""
    of_appearance: dict[str, list[PlannedMeasurement]] = {}
    for case in cases:
        of_appearance.setdefault(case.appearance, []).append(case)
    turned = [group[i % len(group) :] + group[: i % len(group)] for i, group in enumerate(of_appearance.values())]
    return [case for turn in itertools.zip_longest(*turned) for case in turn if case is not None]


def _measured(
    surrogate: Surrogate, catalog: Catalog, planned: Sequence[PlannedMeasurement], progress: Report
) -> Iterator[Measurement]:
    """Measure each case by each representation; those whose pictures can't be read are left out."""
    by_split = {"train": surrogate}
    with suppress(ValueError):  # the catalog has lost coarse fields
        by_split["validation"] = judged(surrogate, catalog)
    pairs = [
        (case, using, by_split[case.member.split])
        for case in planned
        if case.member.split in by_split
        for using in surrogate.representations
    ]
    total, counted = sum(len(case.views) for case, _, _ in pairs), itertools.count(1)
    for case, using, own in pairs:
        member, setting = case.member, Setting(case.member.parameters, case.varied, using=using)
        prediction = setting.member(own)
        scores: list[float] = []
        for view in case.views:
            with suppress(ImageError):
                scores.append(psnr_of(prediction, catalog, member, case.appearance, view))
            progress("what to expect", next(counted), total)
        if scores:
            place = dict(member.parameters), case.appearance, dict(case.varied)
            yield Measurement(member.name, member.split, *place, tuple(scores), case.seen_views, using)


def psnr_of(prediction: MemberModel, catalog: Catalog, member: Member, appearance: str, view: int) -> float:
    """The PSNR, dB, of what the surrogate shows against a stored picture; raises ImageError where that can't be read."""
    background = catalog.plan.background
    truth, camera = catalog.image(member, appearance, view), member.cameras[view]
    image = prediction.render(camera, background=background)
    return psnr(composite(truth, background or WHITE), composite(image, background or WHITE))
