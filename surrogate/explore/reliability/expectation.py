"""What error to expect at a setting, from pictures that the surrogate did not learn from.

Measured once per run: the PSNR of the surrogate at members that training saw least of, never at those that test it.  These are the
validation members; and training members, at views that they did not learn from.  The latter are predicted better because their
parameters were seen: the gap between the two, measured where both show the same appearance, is taken off.  What is expected at a
setting is the median over the nearest of all.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs import durable
from catalogs.catalog import Catalog, Member
from catalogs.images import ImageError
from surrogate.evaluation.metrics import WHITE, composite, psnr
from surrogate.evaluation.scoring import Report, spread
from surrogate.explore.reliability.places import Place, base_name, fractions_of, place_of
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

VERSION = 1
FILE = Path("explore") / "expectation.json"
NEAREST = (
    4  # whose median is expected: the best of 1 to 15 over rows left out of all runs, see benchmarks/expectation.py
)
VIEWS = 5  # of a member: its views differ by 0.3 to 1 dB, so their mean is known to 0.1 to 0.5 dB
MOST_VALIDATION, MOST_TRAINING, MOST_VARIED = (
    60,
    80,
    80,
)  # (member, appearance) pairs: some 1,000 pictures of 10 ms at most
FAR = 1.25  # typical spacings between training members beyond which one is far from all of them


@dataclass(frozen=True)
class Measured:
    """The error of one member in one appearance.

    Attributes
    ----------
    varied : the visualization parameters as a `Setting` has them.
    psnr : dB, of each view.
    seen_views : whether training learnt from these views, for lack of others.
    """

    member: str
    split: str
    parameters: Mapping[str, float]
    appearance: str
    varied: Mapping[str, float | str]
    psnr: tuple[float, ...]
    seen_views: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "psnr", tuple(map(float, self.psnr)))
        if not self.psnr or not all(map(math.isfinite, self.psnr)):
            raise ValueError(f"{self.member} needs finite decibels, got {self.psnr}")

    @property
    def setting(self) -> Setting:
        return Setting(self.parameters, self.varied)


@dataclass(frozen=True)
class Expected:
    """What is expected at a setting.  Distances are Euclidean, of parameters as fractions of their ranges.

    Attributes
    ----------
    psnr : dB; None where nothing alike was measured, or for colours that no picture shows.
    error : dB, mean absolute difference between such expectations and single pictures, of what was left out for that, one
        after another; None where there is too little.
    neighbours : how many measurements it is the median of.
    seen_views : whether these are of views that training learnt from, so that others may be worse.
    training_distance : to the nearest training member, in simulation parameters; None without a catalog.
    training_spacing : the median over training members of that to their nearest neighbour; None for fewer than two.
    outside : names of the parameters that lie out of bounds.
    recolored : whether colours are shown that no picture was trained in.
    """

    psnr: float | None
    error: float | None
    neighbours: int
    seen_views: bool
    training_distance: float | None
    training_spacing: float | None
    outside: tuple[str, ...] = ()
    recolored: bool = False

    @property
    def far(self) -> bool:
        """Whether the nearest training member is farther away than training members usually are from each other."""
        distance, spacing = self.training_distance, self.training_spacing
        return distance is not None and spacing is not None and distance > FAR * spacing

    @property
    def warning(self) -> bool:
        """Whether the page should say more than a number: it extrapolates, or guesses."""
        return self.far or bool(self.outside) or self.recolored

    @property
    def sentence(self) -> str:
        """All of it for a reader."""
        said = [self._decibels(), *self._training()]
        if self.outside:
            said.append(f"{', '.join(self.outside)} out of bounds: a guess")
        return "; ".join(said)

    def to_json(self) -> dict[str, Any]:
        """JSON values: the attributes, `far`, `warning` and `sentence`."""
        return {**asdict(self), "far": self.far, "warning": self.warning, "sentence": self.sentence}

    def _decibels(self) -> str:
        if self.recolored:
            return "these colours were never trained: how good they are was not measured"
        if self.psnr is None:
            return "nothing like it was measured"
        about = "" if self.error is None else f" ± {self.error:.1f}"
        where = " at views like the stored ones" if self.seen_views else ""
        nearest = f"{self.neighbours} nearest measurements" if self.neighbours != 1 else "only measurement"
        return f"expected {self.psnr:.1f}{about} dB{where}, from the {nearest}"

    def _training(self) -> list[str]:
        if self.training_distance is None:
            return []
        far = ", farther than usual: likely worse" if self.far else ""
        return [f"nearest training member {self.training_distance:.2f} of the range away{far}"]


@dataclass(frozen=True, eq=False)
class Table:
    """The measurements of one family, R rows.

    Attributes
    ----------
    places : (R, P + V), as in `Place`.
    pictures : (R, K) dB, as measured at up to K views; NaN for views that a row does not have.
    members, appearances : names, (R,) each.
    unseen : (R,) whether the row is of a validation member.
    base : the name of the base appearance.
    """

    places: NDArray[np.float64]
    pictures: NDArray[np.float64]
    members: NDArray[np.str_]
    appearances: NDArray[np.str_]
    unseen: NDArray[np.bool_]
    base: str

    @cached_property
    def psnr(self) -> NDArray[np.float64]:
        """Means over views, (R,)."""
        return np.nanmean(self.pictures, axis=1)

    def of(self, rows: NDArray[np.bool_]) -> Table:
        """Some of the rows, (R,) of them marked."""
        return replace(
            self,
            places=self.places[rows],
            pictures=self.pictures[rows],
            members=self.members[rows],
            appearances=self.appearances[rows],
            unseen=self.unseen[rows],
        )


@dataclass(frozen=True, eq=False)
class Family:
    """What a lookup needs: places (R, P + V) and the PSNR (R,) to be expected there of a member that training never saw."""

    places: NDArray[np.float64]
    psnr: NDArray[np.float64]
    error: float | None
    seen_views: bool


@dataclass(frozen=True, eq=False)
class Expectation:
    """Measurements, ready to be asked what is expected anywhere.

    Attributes
    ----------
    measured : of all families; empty where nothing could be measured.
    families : by `Place.family`.
    training : (N, P) training members' simulation parameters as fractions of their ranges.
    """

    measured: tuple[Measured, ...]
    families: Mapping[str, Family]
    training: NDArray[np.float64]

    @classmethod
    def of(cls, measured: Sequence[Measured], surrogate: Surrogate, members: Sequence[Member]) -> Expectation:
        """The expectation of these measurements; `members` are the catalog's."""
        tables = tables_of(measured, surrogate)
        gap = gap_of(tables[base_name(surrogate)]) if base_name(surrogate) in tables else None
        seen = {place_of(m.setting, surrogate).family for m in measured if m.seen_views}
        families = {
            name: Family(table.places, levelled(table, gap), left_out_error(table, gap), name in seen)
            for name, table in tables.items()
        }
        learnt = [m.parameters for m in members if m.split == "train"]
        return cls(tuple(measured), families, fractions_of(surrogate.space, learnt))

    @cached_property
    def training_spacing(self) -> float | None:
        """The median distance between a training member and its nearest neighbour; None for fewer than two."""
        if len(self.training) < 2:
            return None
        rows = self.training[spread(len(self.training), 1000)]
        nearest = [np.partition(np.linalg.norm(self.training - row, axis=1), 1)[1] for row in rows]
        return float(np.median(nearest))

    def at(self, setting: Setting, surrogate: Surrogate) -> Expected:
        """What is expected of `surrogate`, the one that was measured, at `setting`: a lookup.

        Raises ValueError for parameters that are missing, unknown or not finite.
        """
        place = place_of(setting, surrogate)
        family = None if setting.color_map else self.families.get(place.family)
        found = None if family is None else predicted(family.places, family.psnr, place.values)
        return Expected(
            psnr=found,
            error=None if family is None else family.error,
            neighbours=0 if family is None else min(NEAREST, len(family.psnr)),
            seen_views=family is not None and family.seen_views,
            training_distance=self._training_distance(place, len(surrogate.space)),
            training_spacing=self.training_spacing,
            outside=place.outside,
            recolored=bool(setting.color_map),
        )

    def _training_distance(self, place: Place, count: int) -> float | None:
        if not len(self.training):
            return None
        steps = self.training - place.values[:count]  # [N, P]
        return math.sqrt(float(np.einsum("np,np->n", steps, steps).min()))


# ---- from measurements to expectations


def predicted(
    places: NDArray[np.float64], values: NDArray[np.float64], place: NDArray[np.float64], nearest: int = NEAREST
) -> float:
    """The median of the `values` (R,) whose `places` (R, D) lie nearest to `place` (D,)."""
    steps = places - place  # [R, D]
    order = np.einsum("rd,rd->r", steps, steps).argsort(kind="stable")[:nearest]
    return float(np.median(values[order]))


def tables_of(measured: Sequence[Measured], surrogate: Surrogate) -> dict[str, Table]:
    """The measurements by family."""
    rows: dict[str, list[tuple[Measured, NDArray[np.float64]]]] = {}
    for one in measured:
        place = place_of(one.setting, surrogate)
        rows.setdefault(place.family, []).append((one, place.values))
    return {family: _table(group, base_name(surrogate)) for family, group in rows.items()}


def _table(rows: Sequence[tuple[Measured, NDArray[np.float64]]], base: str) -> Table:
    measured = [m for m, _ in rows]
    most = max(len(m.psnr) for m in measured)
    return Table(
        np.array([values for _, values in rows]),
        np.array([m.psnr + (math.nan,) * (most - len(m.psnr)) for m in measured]),
        np.array([m.member for m in measured]),
        np.array([m.appearance for m in measured]),
        np.array([m.split == "validation" for m in measured]),
        base,
    )


def gap_of(table: Table, nearest: int = NEAREST) -> float | None:
    """By how many dB training members are better than validation members where both show the same appearance; None without such.

    The median over validation members of the median of their nearest training members, less what was measured.
    """
    gaps = []
    for row in np.flatnonzero(table.unseen):
        alike = ~table.unseen & (table.appearances == table.appearances[row])
        if alike.any():
            around = predicted(table.places[alike], table.psnr[alike], table.places[row], nearest)
            gaps.append(around - table.psnr[row])
    return float(np.median(gaps)) if gaps else None


def levelled(table: Table, otherwise: float | None, nearest: int = NEAREST) -> NDArray[np.float64]:
    """PSNR (R,) as if every member were one that training never saw; `otherwise` is the gap where the table has none itself."""
    own = gap_of(table, nearest)
    gap = otherwise if own is None else own
    return np.where(table.unseen, table.psnr, table.psnr - (gap or 0.0))


def left_out(table: Table, gap: float | None, nearest: int = NEAREST) -> NDArray[np.float64]:
    """What is expected (R,) at each row without its member and, if that is no base appearance, the setting that it shows.

    The gap is measured anew each time; `gap` is for tables that have none themselves.  NaN where nothing is left.
    """
    expected = np.full(len(table.psnr), np.nan)
    for row in range(len(expected)):
        kept = table.members != table.members[row]
        if table.appearances[row] != table.base:
            kept &= table.appearances != table.appearances[row]
        if kept.any():
            rest = table.of(kept)
            expected[row] = predicted(rest.places, levelled(rest, gap, nearest), table.places[row], nearest)
    return expected


def left_out_errors(table: Table, gap: float | None, nearest: int = NEAREST) -> NDArray[np.float64]:
    """Mean absolute differences (R,), dB, between `left_out` and the pictures of a row; NaN where nothing is left."""
    expected = left_out(table, gap, nearest)  # [R]
    taken_off = table.psnr - levelled(table, gap, nearest)  # [R]
    differences = np.abs(table.pictures - (taken_off + expected)[:, None])  # [R, K]
    errors, known = np.full(len(expected), np.nan), np.isfinite(expected)
    errors[known] = np.nanmean(differences[known], axis=1)
    return errors


def left_out_error(table: Table, gap: float | None) -> float | None:
    """The mean of `left_out_errors` over all rows, or over validation members where it is larger; None without any."""
    errors = left_out_errors(table, gap)
    known = np.isfinite(errors)
    means = [float(errors[rows].mean()) for rows in (known, known & table.unseen) if rows.any()]
    return max(means, default=None)


# ---- measuring


@one_torch_thread()
def measure(
    surrogate: Surrogate, catalog: Catalog | None, folder: Path | None, progress: Report = lambda *_: None
) -> Expectation:
    """Measure what to expect of `surrogate` on its `catalog`, or read what was measured in the run's `folder` before.

    Takes some seconds; an exception from `progress`, or Ctrl-C, stops it and leaves nothing.  What was measured is kept in
    `explore/expectation.json` of the run's `folder`; only in memory where that is None or can't be written.  Without
    a catalog nothing is expected.  Raises CatalogError for a damaged catalog, ValueError where it has other parameters.
    """
    if catalog is None:
        return Expectation.of((), surrogate, ())
    if catalog.plan.space.names != surrogate.space.names:
        raise ValueError(f"the catalog is of {catalog.plan.space.names}, the surrogate of {surrogate.space.names}")
    members = catalog.members
    mark = fingerprint(surrogate, members)
    measured = None if folder is None else _read(folder / FILE, mark)
    if measured is None:
        measured = tuple(_measured(surrogate, catalog, places_of(surrogate, members), progress))
        if folder is not None:
            _keep(folder / FILE, mark, measured)
    return Expectation.of(measured, surrogate, members)


@dataclass(frozen=True, eq=False)
class Case:
    """What is to be measured: a member in one appearance at some views."""

    member: Member
    appearance: str
    varied: Mapping[str, float | str]
    views: tuple[int, ...]
    seen_views: bool


def places_of(surrogate: Surrogate, members: Sequence[Member]) -> list[Case]:
    """Where to measure: validation members, training members in the base appearance, and training members under trained settings.

    Of training members only views that training did not see; of both never a view that tests.  Of many all evenly.
    """
    base = base_name(surrogate)
    varied: dict[str, Mapping[str, float | str]] = {}
    for variation in (v.variation for v in surrogate.visualizations):
        varied |= {s.appearance: variation.asked(s) for s in variation.settings if s.split != "test"}
    shown: dict[str, Mapping[str, float | str]] = {base: {}, **varied}
    validation = [case for m in members if m.split == "validation" for case in _cases(m, shown)]
    learnt = [m for m in members if m.split == "train" and "validation" in m.view_splits]
    at_base = [case for m in learnt for case in _cases(m, {base: {}})]
    at_settings = _in_turn([case for m in learnt for case in _cases(m, varied)])
    return [
        *_some(validation, MOST_VALIDATION),
        *_some(at_base, MOST_TRAINING),
        *at_settings[:MOST_VARIED],
    ]


def fingerprint(surrogate: Surrogate, members: Sequence[Member]) -> str:
    """A SHA-256 over all that the measurements depend on: the model's numbers, the members, and how they are measured."""
    mark = hashlib.sha256(json.dumps([VERSION, VIEWS, MOST_VALIDATION, MOST_TRAINING, MOST_VARIED]).encode())
    tensors = {**surrogate.gaussians.tensors(), **surrogate.deformation.stored()}
    for i, visualization in enumerate(surrogate.visualizations):
        tensors |= {f"{i}.{name}": tensor for name, tensor in visualization.stored().items()}
    for name, tensor in sorted(tensors.items()):
        mark.update(name.encode())
        mark.update(np.ascontiguousarray(tensor.detach().cpu().numpy()).tobytes())
    values = {
        "space": surrogate.space.to_json(),
        "normalization": [surrogate.normalization.center.tolist(), surrogate.normalization.extent],
        "rasterizer": surrogate.rasterizer.to_json(),
        "variations": [v.variation.to_json() for v in surrogate.visualizations],
        "training": surrogate.training.get("fingerprint"),
        "members": [[m.name, dict(m.parameters), m.split, m.view_splits, m.appearances] for m in members],
    }
    mark.update(json.dumps(values, sort_keys=True).encode())
    return mark.hexdigest()


def _cases(member: Member, shown: Mapping[str, Mapping[str, float | str]]) -> list[Case]:
    """The member in each of the appearances that it was rendered in, at views of its own kind."""
    by_split = {split: [i for i, s in enumerate(member.view_splits) if s == split] for split in ("validation", "train")}
    known = by_split["validation"] or by_split["train"]
    views = tuple(known[i] for i in spread(len(known), VIEWS))
    seen = not by_split["validation"]
    return [Case(member, a, varied, views, seen) for a, varied in shown.items() if a in member.appearances and views]


def _some(cases: Sequence[Case], most: int) -> list[Case]:
    return [cases[i] for i in spread(len(cases), most)]


def _in_turn(cases: Sequence[Case]) -> list[Case]:
    """Every appearance once, then all once more: each time at another of the members that show it, and these in turn."""
    of_appearance: dict[str, list[Case]] = {}
    for case in cases:
        of_appearance.setdefault(case.appearance, []).append(case)
    turned = [group[i % len(group) :] + group[: i % len(group)] for i, group in enumerate(of_appearance.values())]
    return [case for turn in itertools.zip_longest(*turned) for case in turn if case is not None]


def _measured(surrogate: Surrogate, catalog: Catalog, cases: Sequence[Case], progress: Report) -> Iterator[Measured]:
    """Measure each case; those whose pictures can't be read are left out."""
    done, total = 0, sum(len(case.views) for case in cases)
    background = catalog.plan.background
    for case in cases:
        deformed = Setting(case.member.parameters, case.varied).gaussians(surrogate)
        found = []
        for view in case.views:
            with suppress(ImageError):
                truth = composite(catalog.image(case.member, case.appearance, view), background or WHITE)
                drawn = deformed.render(case.member.cameras[view], background=background)
                found.append(psnr(truth, composite(drawn, background or WHITE)))
            done += 1
            progress("what to expect", done, total)
        if found:
            member, varied = case.member, dict(case.varied)
            parameters = dict(member.parameters)
            yield Measured(
                member.name, member.split, parameters, case.appearance, varied, tuple(found), case.seen_views
            )


def _keep(path: Path, mark: str, measured: Sequence[Measured]) -> None:
    record = {"version": VERSION, "fingerprint": mark, "measured": [asdict(m) for m in measured]}
    with suppress(OSError):  # of a run that can only be read it is measured anew each time
        durable.make_folder(path.parent)
        durable.remove_abandoned(path.parent)
        durable.replace(path, json.dumps(record, indent=1, allow_nan=False).encode())


def _read(path: Path, mark: str) -> tuple[Measured, ...] | None:
    """What was kept under this mark; None where nothing was, or it is damaged."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["fingerprint"] != mark:
            return None
        return tuple(Measured(**values) for values in record["measured"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
