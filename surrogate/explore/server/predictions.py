"""Numbers of the emulated field all over the parameters, beside those of the runs: computed once, while pages wait."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Member
from catalogs.vocabulary.appearance import field_of
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.words import one_line
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import FieldEmulator
from surrogate.evaluation.scoring import spread
from surrogate.explore.probing import NO_FIELD
from surrogate.explore.request import FrameRequest
from surrogate.explore.run import Run
from surrogate.model import FieldModel
from surrogate.model.field_model import scales_of
from surrogate.randomness import sobol_points

PREDICTIONS, MOST_RUNS = 500, 500
LEVELS = 129  # above which shares of the samples are counted, even on the scale of values
ABANDONED = 5.0  # seconds without a question after which the work stops

log = logging.getLogger(__name__)

Rows = NDArray[np.float32]


@dataclass(eq=False)
class _Work:
    """The predictions of a field in the making: how far they are, and their answer."""

    wanted: float  # when somebody asked for it last
    done: float = 0.0
    answer: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    running: bool = False


@dataclass(eq=False)
class Predictions:
    """Predictions of each field of a run, made by the threads of `pool` while somebody asks, until the program is `closed`."""

    run: Run
    pool: Executor
    closed: threading.Event
    _works: dict[str, _Work] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    __repr__ = one_line

    def answer(self, request: FrameRequest) -> dict[str, Any]:
        """Those of the field that the request's first setting shows, or `done`, the share of the work that is done.

        `parameters` are values by row, of `runs` runs and then of predictions; `levels` (L,) are in the field's unit.  The rows of
        the only one of `pictures` are float32: mean, minimum, maximum and the shares (L,) of samples above each level.  Raises
        ValueError for a run without an emulated field, and where members can't be read.
        """
        model = self.run.surrogate.field
        if model is None:
            raise ValueError(NO_FIELD)
        setting = request.settings[0]
        name = field_of(model.point({} if setting.is_free else setting.values, "allow").appearance)
        with self._lock:
            work = self._works.setdefault(name, _Work(0.0))
            work.wanted = time.monotonic()
            if not work.answer and not work.error and not work.running:
                work.running = True
                self.pool.submit(self._make, work, model, name)
        if work.error:
            raise ValueError(work.error)
        return work.answer or {"done": work.done}

    def _make(self, work: _Work, model: FieldModel, name: str) -> None:
        try:
            table, rows = Table.of(self.run, model, name), list[tuple[list[float], Rows]]()
            for row in table.rows():
                rows.append(row)
                work.done = min(len(rows) / table.count, 0.99)
                if self.closed.is_set() or time.monotonic() - work.wanted > ABANDONED:
                    return
            quantity = model.emulators.quantity(name)
            parameters, numbers = zip(*rows, strict=True)
            work.answer = {
                "parameters": parameters,
                "runs": len(rows) - PREDICTIONS,
                "levels": table.scale.values(np.linspace(0.0, 1.0, LEVELS)).tolist(),
                "name": quantity.name,
                "unit": quantity.unit,
                "pictures": [np.array(numbers).tobytes()],
            }
        except Exception as error:
            log.warning("the predictions of %s can't be made: %s", name or "the field", error)
            work.error = "the runs' fields can't be read: the explorer's terminal says why"
        finally:
            work.running = False


@dataclass(frozen=True, eq=False)
class Table:
    """The runs and the predictions of a field, each of which is measured.

    Attributes
    ----------
    members : those whose field may be kept.
    space : the parameters.
    scale : on which levels are even.
    """

    name: str
    emulator: FieldEmulator
    members: tuple[Member, ...]
    space: ParameterSpace
    scale: ValueScale

    __repr__ = one_line

    @classmethod
    def of(cls, run: Run, model: FieldModel, name: str) -> Table:
        """Of a field of a run."""
        emulator, members = model.emulators[name], run.members
        middle = emulator.at(np.zeros(len(model.space))).values
        scale = scales_of(model.appearances).get(name) or ValueScale(np.array([middle.min(), middle.max()]))
        return cls(name, emulator, tuple(members[i] for i in spread(len(members), MOST_RUNS)), model.space, scale)

    @property
    def count(self) -> int:
        """Rows at most."""
        return len(self.members) + PREDICTIONS

    def rows(self) -> Iterator[tuple[list[float], Rows]]:
        """The parameters (P,) and what is `measured` (3 + L,): of the members, then of predictions evenly all over the box."""
        for member in self.members:
            coarse = member.coarse_field(self.name)
            if coarse is not None:
                values = coarse.values.ravel()
                own = [float(member.parameters[name]) for name in self.space.names]
                yield own, self.measured(values[~np.isnan(values)])
        points = sobol_points(1 << (PREDICTIONS - 1).bit_length(), len(self.space))[:PREDICTIONS]
        for point, own in zip(points, self.space.denormalize(points).tolist(), strict=True):
            values, holes = self.emulator.posterior(point).values(), self.emulator.holes(point)
            yield own, self.measured(values if holes is None else values[~holes.ravel()])

    def measured(self, values: NDArray[np.floating]) -> Rows:
        """Mean, minimum, maximum, and the shares of samples (V,) above each of the levels (L,)."""
        knots = self.scale.knots
        steps = np.interp(values, knots, np.linspace(0.0, LEVELS - 1.0, len(knots)))
        below = np.bincount(np.ceil(steps).astype(np.int64), minlength=LEVELS)  # samples by how many levels lie below
        above = np.append(np.cumsum(below[:0:-1])[::-1], np.count_nonzero(values > knots[-1]))
        extremes = values.mean(dtype=np.float64), values.min(), values.max()
        return np.array([*extremes, *(above / values.size)], dtype=np.float32)
