"""Doubt of a surrogate: the PSNR to expect of any picture, as an interval that holds for nine in ten."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering, field_of
from catalogs.vocabulary.cameras import Camera
from surrogate.answers import unseen
from surrogate.answers.calibration import Calibration
from surrogate.answers.embeddings import Embeddings
from surrogate.answers.opinions import Opinions, ProcessOpinions
from surrogate.answers.small_fields import SmallFields
from surrogate.answers.views import Views
from surrogate.evaluation.metrics import MOST_DECIBELS
from surrogate.evaluation.novelty import SeenValues
from surrogate.evaluation.scoring import Report
from surrogate.model import Surrogate
from surrogate.model.field_model import FieldPoint
from surrogate.model.judged import LEARNT, judged, model_key
from surrogate.model.points import AnyPoint, BothPoints
from surrogate.model.representation import FIELD, VIEW, WORDS
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.records import Record

Array = NDArray[np.float64]

FILE = Path("answers") / "doubt.json"
RECORD, VERSION = "doubt", 2  # 1 knew no other embeddings
NEW = 0.05  # of what a function shows: more that training never showed is never shown
SLACK = 1.05  # of a share: emulators are stored in few bits
LIKE, BETWEEN, FAR, NEVER = (
    "like a run that was simulated",
    "between runs",
    "far from all runs",
    "never shown in training",
)


@dataclass(frozen=True)
class Interval:
    """The PSNR to expect of a picture.

    Attributes
    ----------
    words : `LIKE`, `BETWEEN`, `FAR` or `NEVER`; "" where nobody can say.
    psnr, low, high : dB; None where nobody can say.
    share : of such pictures whose PSNR is to lie between `low` and `high`.
    source : the members that calibrated it, in words; "" without numbers.
    why : a sentence where there are no numbers.
    """

    words: str = ""
    psnr: float | None = None
    low: float | None = None
    high: float | None = None
    share: float | None = None
    source: str = ""
    why: str = ""

    @property
    def short(self) -> str:
        """In a few words."""
        if self.psnr is None:
            return ": ".join(filter(None, [self.words, self.why]))
        within = "" if self.low == MOST_DECIBELS else f" ({self._range})"
        return f"{self.words}: PSNR {self._expected}{within}"

    @property
    def sentence(self) -> str:
        """All of it for a reader."""
        if self.psnr is None or self.share is None:
            return self.short
        within = "" if self.low == MOST_DECIBELS else f", {self._range}"
        share = f"in {self.share:.0%} of such pictures (calibrated by {self.source})"
        return f"{self.words}: PSNR {self._expected}{within} {share}"

    @property
    def _expected(self) -> str:
        return f"{MOST_DECIBELS:.0f} dB or more" if self.psnr == MOST_DECIBELS else f"{self.psnr:.1f} dB"

    @property
    def _range(self) -> str:
        return f"{self.low:.1f} dB or more" if self.high == MOST_DECIBELS else f"{self.low:.1f} to {self.high:.1f} dB"

    @property
    def warning(self) -> bool:
        """True where a page should say more than a number."""
        return self.psnr is None or self.words == FAR

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes, `short`, `sentence` and `warning`."""
        return asdict(self) | {"short": self.short, "sentence": self.sentence, "warning": self.warning}


@dataclass(frozen=True, eq=False, repr=False)
class MemberDoubt:
    """The doubt at parameters: `interval` says it of what a camera sees.

    Attributes
    ----------
    words, why : as in `Interval`.
    point : (P,) normalized parameters of the simulation.
    using : the representation whose calibration this is.
    """

    doubt: Doubt
    parameters: Mapping[str, Any]
    function: TransferFunction | None
    words: str
    why: str
    point: Array
    using: str
    calibration: Calibration | None
    source: str = ""

    def interval(self, camera: Camera) -> Interval:
        """The PSNR to expect of the picture that `camera` sees."""
        views = self.doubt.views
        if self.words == NEVER or (views is not None and not views.cover(camera)):
            return Interval(NEVER, why=self.why or "no stored image looks from there")
        if self.calibration is None:
            return Interval(self.words, why="too few members calibrate it: nobody can say how far off the picture is")
        agreement = unseen.agreement_of(self.opinions, camera, self.doubt.background)
        expected = min(float(self.calibration.line.expected(agreement, self.point)), MOST_DECIBELS)
        low, high = expected - self.calibration.half, min(expected + self.calibration.half, MOST_DECIBELS)
        return Interval(self.words, expected, max(low, 0.0), high, self.calibration.share, self.source)

    @cached_property
    def opinions(self) -> list[Opinions]:
        """Those whose agreement was calibrated."""
        if self.using != FIELD:
            return self.by_gaussians
        assert self.by_committee is not None
        return [self.by_committee]

    @cached_property
    def by_gaussians(self) -> list[Opinions]:
        """Of a picture by Gaussians; see `unseen.opinions_of_gaussians`."""
        doubt = self.doubt
        if not len(doubt.surrogate.gaussians):
            return []
        return unseen.opinions_of_gaussians(doubt.surrogate, doubt.embeddings, self.parameters, self.function)

    @cached_property
    def by_committee(self) -> Opinions | None:
        """Of a picture of the emulated field; None without one."""
        if self.doubt.surrogate.field is None:
            return None
        fields = self.doubt.fields
        point = fields.model.point(self.parameters, "allow", self.function)
        return fields.committee(point).at(point)


@dataclass(frozen=True, eq=False, repr=False)
class Doubt:
    """The knowledge of a surrogate about its own errors.

    Attributes
    ----------
    calibrations : by kind of question and representation, such as "view both".
    processes : between the runs: those of the emulated field, else of the Gaussians' embedding.
    embeddings : others than that of the Gaussians, where there are some.
    seen_values : what training showed of the field; None where that is unknown.
    views : the stored cameras.
    """

    surrogate: Surrogate
    calibrations: Mapping[str, Calibration]
    processes: ProcessOpinions
    embeddings: Embeddings | None = None
    seen_values: SeenValues | None = None
    views: Views | None = None
    background: tuple[float, float, float] | None = None

    @classmethod
    def of(
        cls, surrogate: Surrogate, catalog: Catalog, folder: Path | None = None, progress: Report = lambda *_: None
    ) -> Doubt:
        """The doubt of a run, as kept in its `folder`; else measured now, which takes about a minute, and kept there.

        Raises ValueError where too few runs are there to doubt with, and where the catalog no longer keeps its members' fields.
        """
        return cls.stored(surrogate, catalog, folder) or cls._measured(surrogate, catalog, folder, progress)

    @classmethod
    def stored(cls, surrogate: Surrogate, catalog: Catalog, folder: Path | None) -> Doubt | None:
        """The doubt that was measured before; None where that would have to be done.  Raises ValueError as `of` does."""
        record = None if folder is None else Record.load(folder / FILE, RECORD, VERSION, key_of(surrogate, catalog))
        if record is not None:
            with suppress(KeyError, TypeError, ValueError, AttributeError):  # it is damaged, and measured anew
                read = {name: Calibration.from_json(one) for name, one in record.values["calibrations"].items()}
                return cls._with(surrogate, catalog, embeddings_of(surrogate, catalog), read)
        return None

    @classmethod
    def _measured(cls, surrogate: Surrogate, catalog: Catalog, folder: Path | None, progress: Report) -> Doubt:
        began, embeddings = time.process_time(), embeddings_of(surrogate, catalog)
        own = cls._with(surrogate, catalog, embeddings, calibrations_of(surrogate, embeddings, catalog, progress))
        values = {"calibrations": {name: one.to_json() for name, one in own.calibrations.items()}}
        Record.keep(folder and folder / FILE, RECORD, VERSION, key_of(surrogate, catalog), values, began)
        return own

    @classmethod
    def _with(
        cls,
        surrogate: Surrogate,
        catalog: Catalog,
        embeddings: Embeddings | None,
        calibrations: Mapping[str, Calibration],
    ) -> Doubt:
        if surrogate.field is not None:
            name = field_of(surrogate.field.appearances[0])
            processes = ProcessOpinions(surrogate.field.emulators[name].processes)
        elif embeddings is not None:
            processes = embeddings.opinions
        else:
            raise ValueError("nobody can say how sure this surrogate is: it learnt from fewer than four members")
        cameras = catalog.plan.cameras or [camera for member in catalog.members for camera in member.cameras]
        views = Views.of(cameras, np.mean(catalog.plan.bounds, axis=0))
        values = SeenValues.of_training(catalog, surrogate)
        return cls(surrogate, calibrations, processes, embeddings, values, views, catalog.plan.background)

    def __repr__(self) -> str:
        each = [f"{name} within {one.half:.1f} dB ({one.share:.0%})" for name, one in self.calibrations.items()]
        return f"<Doubt: {', '.join(each) or 'nothing calibrated'}>"

    def at(
        self, parameters: Mapping[str, Any], function: TransferFunction | None = None, using: str = ""
    ) -> MemberDoubt:
        """The doubt of what `surrogate.at(parameters)`, or `under` a `function`, shows, by a representation other than its own.

        Raises ValueError as `Surrogate.at` does.
        """
        words, why, point = self._place(parameters, function)
        kind = self.surrogate.kind(parameters, under=function is not None)
        calibration, used = self._calibration(kind, using or self.surrogate.representation(kind))
        if calibration is None:
            return MemberDoubt(self, parameters, function, words, why, point, used, None)
        source = f"{calibration.members} {'left-out' if used == FIELD else 'validation'} members"
        if used != (using or self.surrogate.representation(kind)):
            source += f", of the {WORDS[FIELD]} alone"
        return MemberDoubt(self, parameters, function, words, why, point, used, calibration, source)

    def interval(
        self, parameters: Mapping[str, Any], camera: Camera, function: TransferFunction | None = None
    ) -> Interval:
        """The PSNR to expect of the picture that `surrogate.at(parameters)`, or `under` a `function`, shows `camera`.

        Raises ValueError as `Surrogate.at` does.
        """
        return self.at(parameters, function).interval(camera)

    @cached_property
    def fields(self) -> SmallFields:
        """The emulated fields on a coarse lattice, with other opinions."""
        assert self.surrogate.field is not None
        return SmallFields(self.surrogate.field)

    def _place(self, parameters: Mapping[str, Any], function: TransferFunction | None) -> tuple[str, str, Array]:
        """The words for parameters among the runs, why where training never showed it, and the point (P,)."""
        place = self.surrogate.place(parameters, "allow", function)
        point = place.simulation
        if place.warnings:
            return NEVER, "; ".join(place.warnings), point
        drawn_with = function or _function_of(place)
        trained = self.seen_values
        if drawn_with is not None and trained is not None and (new := trained.novelty(drawn_with)) > NEW:
            return NEVER, f"no trained transfer function showed {new:.0%} of what this one shows", point
        share, (own, most) = self.processes.open_share(point), self.processes.usual_shares
        return (LIKE if share <= own * SLACK else BETWEEN if share <= most else FAR), "", point

    def _calibration(self, kind: str, using: str) -> tuple[Calibration | None, str]:
        """The one for a kind and what draws it, else that of the emulated field; kinds that nobody measured as views."""
        tries = [(k, u) for u in dict.fromkeys((using, FIELD)) for k in dict.fromkeys((kind, VIEW))]
        for k, u in tries:
            if (calibration := self.calibrations.get(f"{k} {u}")) is not None:
                return calibration, u
        return None, using


def _function_of(place: AnyPoint) -> TransferFunction | None:
    """The transfer function of the base field that an emulated field is drawn with there, where that can be said."""
    point = place.field if isinstance(place, BothPoints) else place
    appearance = point.appearance if isinstance(point, FieldPoint) else None
    return appearance.transfer_function if isinstance(appearance, VolumeRendering) else None


def key_of(surrogate: Surrogate, catalog: Catalog) -> dict[str, Any]:
    """The key of a record: the model, the members, and how many of their pictures are looked at."""
    return {**model_key(surrogate, catalog.members), "views": unseen.VIEWS}


def embeddings_of(surrogate: Surrogate, catalog: Catalog) -> Embeddings | None:
    """Other embeddings through the members of a catalog that Gaussians learn from."""
    space = surrogate.space
    rows = [[m.parameters[name] for name in space.names] for m in catalog.members if m.split in LEARNT]
    return Embeddings.of(surrogate, space.normalize(np.array(rows, dtype=np.float64).reshape(len(rows), len(space))))


@one_torch_thread()
def calibrations_of(
    surrogate: Surrogate, embeddings: Embeddings | None, catalog: Catalog, progress: Report
) -> dict[str, Calibration]:
    """Measured at members that were left out, by kind of question and representation."""
    pictures = [] if surrogate.field is None else [*unseen.of_emulator(surrogate.field, catalog, progress)]
    if len(surrogate.gaussians):
        pictures += unseen.of_gaussians(judged(surrogate, catalog), embeddings, catalog)
    groups: dict[str, list[unseen.UnseenPicture]] = {}
    for one in pictures:
        groups.setdefault(f"{one.kind} {one.using}", []).append(one)
    calibrated = {name: Calibration.of(unseen.by_member(group)) for name, group in groups.items()}
    return {name: one for name, one in calibrated.items() if one is not None}
