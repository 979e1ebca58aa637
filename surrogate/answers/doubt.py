"""Doubt of a surrogate: the PSNR to expect of any picture, as an interval that holds for nine in ten."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import TransferFunction, field_of
from catalogs.vocabulary.cameras import Camera
from surrogate.answers import unseen
from surrogate.answers.calibration import Calibration
from surrogate.answers.committee import Committee, Opinions
from surrogate.evaluation.metrics import MOST_DECIBELS, WHITE, composite, decibels, psnr
from surrogate.evaluation.novelty import SeenValues
from surrogate.evaluation.scoring import Report
from surrogate.model import Surrogate
from surrogate.model.field_model import FieldPoint
from surrogate.model.judged import judged, model_key
from surrogate.model.representation import FIELD, GAUSSIANS, VIEW, WORDS
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.records import Provenance, Record

FILE = Path("answers") / "doubt.json"
RECORD, VERSION = "doubt", 1
NEW = 0.05  # of what a function shows: more that training never showed is never shown; see docs/explorer.md
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
    words : `LIKE`, `BETWEEN`, `FAR` or `NEVER`.
    psnr, low, high : dB; None where nobody can say.
    share : of such pictures whose PSNR is to lie between `low` and `high`.
    source : the members that calibrated it, in words; "" without numbers.
    why : a sentence where there are no numbers.
    """

    words: str
    psnr: float | None = None
    low: float | None = None
    high: float | None = None
    share: float | None = None
    source: str = ""
    why: str = ""

    @property
    def sentence(self) -> str:
        """All of it for a reader."""
        if self.psnr is None or self.share is None:
            return f"{self.words}: {self.why}"
        within = f"{self.low:.1f} to {self.high:.1f} dB in {self.share:.0%} of such pictures"
        return f"{self.words}: PSNR {self.psnr:.1f} dB, {within} (calibrated by {self.source})"

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes and `sentence`."""
        return asdict(self) | {"sentence": self.sentence}


@dataclass(frozen=True, eq=False, repr=False)
class Doubt:
    """The knowledge of a surrogate with an emulated field about its own errors.

    Attributes
    ----------
    calibrations : by kind of question and representation, such as "view both".
    shares : of the variance that runs leave open, the largest at a run itself, and the 95th percentile at runs that were left out.
    """

    surrogate: Surrogate
    calibrations: Mapping[str, Calibration]
    shares: tuple[float, float]
    seen_values: SeenValues | None = None
    background: tuple[float, float, float] | None = None
    _committees: dict[str, Committee] = field(default_factory=dict)

    @classmethod
    def of(
        cls, surrogate: Surrogate, catalog: Catalog, folder: Path | None = None, progress: Report = lambda *_: None
    ) -> Doubt:
        """The doubt of a run, as kept in its `folder`; else measured now, which takes about a minute, and kept there.

        Raises ValueError for a surrogate without an emulated field, and where the catalog no longer keeps its members' fields.
        """
        if surrogate.field is None:
            raise ValueError(
                "this surrogate has no emulated field to doubt with: train it on a catalog with coarse fields"
            )
        key, started = key_of(surrogate, catalog), time.process_time()
        record = None if folder is None else Record.load(folder / FILE, RECORD, VERSION, key)
        read = None if record is None else _read(record.values)
        if read is None:
            values = _measured(surrogate, catalog, progress)
            if folder is not None:
                with suppress(OSError):  # a run that can only be read is measured anew each time
                    provenance = Provenance.now(time.process_time() - started)
                    Record(RECORD, VERSION, key, values, provenance).save(folder / FILE)
            read = _read(values)
            assert read is not None
        values_shown = SeenValues.of_training(catalog, surrogate)
        return cls(surrogate, *read, values_shown, catalog.plan.background)

    def interval(
        self, parameters: Mapping[str, Any], camera: Camera, function: TransferFunction | None = None
    ) -> Interval:
        """The PSNR to expect of the picture that `surrogate.at(parameters)`, or `under` a `function`, shows `camera`.

        Raises ValueError as `Surrogate.at` does.
        """
        words, why = self.place(parameters, function)
        if words == NEVER:
            return Interval(words, why=why)
        kind = self.surrogate.kind(parameters, under=function is not None)
        using = self.surrogate.representation(kind)
        calibration, used = self._calibration(kind, using)
        if calibration is None:
            return Interval(words, why="too few members calibrate it: nobody can say how far off the picture is")
        agreement, point = self._agreement(parameters, camera, function, used), self._point(parameters, function)
        expected = min(float(calibration.line.expected(agreement, point.simulation)), MOST_DECIBELS)
        source = f"{calibration.members} {'left-out' if used == FIELD else 'validation'} members"
        if used != using:
            source += f", of the {WORDS[FIELD]} alone"
        low, high = expected - calibration.half, min(expected + calibration.half, MOST_DECIBELS)
        return Interval(words, expected, max(low, 0.0), high, calibration.share, source)

    def place(self, parameters: Mapping[str, Any], function: TransferFunction | None = None) -> tuple[str, str]:
        """The words for the place of parameters among the runs, and why where training never showed it."""
        point = self._point(parameters, function)
        if point.warnings:
            return NEVER, "; ".join(point.warnings)
        if function is not None and self.seen_values is not None and self.seen_values.novelty(function) > NEW:
            return NEVER, "the transfer function shows values that no trained one showed"
        share, (own, most) = self._committee(point).open_share(point.simulation), self.shares
        return (LIKE if share <= own * SLACK else BETWEEN if share <= most else FAR), ""

    def opinions(self, parameters: Mapping[str, Any], function: TransferFunction | None = None) -> Opinions:
        """The fields that the committee of emulators expects."""
        point = self._point(parameters, function)
        return self._committee(point).at(point)

    def _agreement(
        self, parameters: Mapping[str, Any], camera: Camera, function: TransferFunction | None, using: str
    ) -> float:
        if using == FIELD:
            squares = self.opinions(parameters, function).squares(camera, self.background)
            return decibels(float(squares.mean()))
        return psnr(*self.pair(parameters, camera, function))

    def pair(
        self, parameters: Mapping[str, Any], camera: Camera, function: TransferFunction | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The pictures by the Gaussians and from the emulated field, (H, W, 3), as displayed."""
        pictures = []
        for name in (GAUSSIANS, FIELD):
            own = self.surrogate.using(name)
            member = (
                own.at(parameters, outside="allow")
                if function is None
                else own.under(function, parameters, outside="allow")
            )
            pictures.append(composite(member.render(camera), self.background or WHITE))
        return pictures[0], pictures[1]

    def _calibration(self, kind: str, using: str) -> tuple[Calibration | None, str]:
        """The one for a kind and what draws it, else that of the emulated field; kinds that nobody measured as views."""
        tries = [(k, u) for u in dict.fromkeys((using, FIELD)) for k in dict.fromkeys((kind, VIEW))]
        for k, u in tries:
            if (calibration := self.calibrations.get(f"{k} {u}")) is not None:
                return calibration, u
        return None, using

    def _point(self, parameters: Mapping[str, Any], function: TransferFunction | None) -> FieldPoint:
        assert self.surrogate.field is not None
        return self.surrogate.field.point(parameters, "allow", function)

    def _committee(self, point: FieldPoint) -> Committee:
        assert self.surrogate.field is not None
        name = field_of(point.appearance)
        if name not in self._committees:
            self._committees[name] = Committee.of(self.surrogate.field.emulators[name])
        return self._committees[name]


def key_of(surrogate: Surrogate, catalog: Catalog) -> dict[str, Any]:
    """The key of a record: the model, the members, and how many of their pictures are looked at."""
    return {**model_key(surrogate, catalog.members), "views": unseen.VIEWS}


def _read(values: Mapping[str, Any]) -> tuple[dict[str, Calibration], tuple[float, float]] | None:
    """Calibrations and shares of a record; None where it is damaged, so that they are measured anew."""
    try:
        calibrations = {name: Calibration.from_json(one) for name, one in values["calibrations"].items()}
        own, most = (numbers.finite(share, "shares") for share in values["shares"])
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    return calibrations, (own, most)


@one_torch_thread()
def _measured(surrogate: Surrogate, catalog: Catalog, progress: Report) -> dict[str, Any]:
    """JSON values of the calibrations and shares."""
    assert surrogate.field is not None
    pictures = [*unseen.of_emulator(surrogate.field, catalog, progress)]
    emulator = surrogate.field.emulators[field_of(surrogate.field.appearances[0])]
    own = max(map(Committee(emulator).open_share, emulator.processes.points))
    shares = [one.open_share for one in pictures if one.kind == VIEW] or [0.0]
    if len(surrogate.gaussians):
        pictures += unseen.of_gaussians(judged(surrogate, catalog), catalog)
    groups: dict[str, list[unseen.UnseenPicture]] = {}
    for one in pictures:
        groups.setdefault(f"{one.kind} {one.using}", []).append(one)
    calibrated = {name: Calibration.of(unseen.by_member(group)) for name, group in groups.items()}
    return {
        "calibrations": {name: one.to_json() for name, one in calibrated.items() if one is not None},
        "shares": [own, float(np.quantile(shares, 0.95))],
    }
