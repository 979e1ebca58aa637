"""Train, validation and test splits of a catalog's members for one run; the catalog itself does not change."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.members import Member
from catalogs.vocabulary.parameters import SPLITS, ParameterSpace

SURROUNDED, NEARLY = 1e-6, 0.5  # distances to the others' convex hull, bounds being [-1, 1]
MOST_CANDIDATES = 500  # for the hold-out, drawn at random from more
FEWEST_TO_SPARE = 8  # training members; with fewer, views validate
VALIDATION_SHARE, MOST_VALIDATION = 0.08, 12
VALIDATION_VIEWS = 16  # every 16th training view validates

# Names of ordered parameters, in small letters alone; "t" is one too, but T is a temperature.
ORDERED_WORDS = (
    "time times simtime simulationtime physicaltime timeindex step steps timestep timesteps cycle cycles iteration iterations iter "
    "snapshot snapshots snap dump dumps frame frames output redshift scalefactor date year month day hour"
)

MemberGroup = Sequence[Member]  # of one run, or a member by itself


@dataclass(frozen=True)
class Splits:
    """The members of a run, each with its split; other members of the catalog do not belong to the run.

    Attributes
    ----------
    members : "train", "validation" or "test" by member name.
    validation_views : every n-th training view of each member validates as well; 0 for none.
    """

    members: Mapping[str, str] = field(repr=False)
    validation_views: int = 0

    def __post_init__(self) -> None:
        wrong = {name: split for name, split in self.members.items() if split not in SPLITS}
        if wrong:
            raise ValueError(f"a member's split must be one of {SPLITS}, got {wrong}")
        if type(self.validation_views) is not int or self.validation_views < 0:
            raise ValueError(f"validation_views must be a count, got {self.validation_views!r}")

    def of(self, member: Member) -> Member | None:
        """The member with its splits in the run; None where it does not belong to the run."""
        if member.name not in self.members:
            return None
        views = list(member.view_splits)
        if self.validation_views:
            train = [view for view, split in enumerate(views) if split == "train"]
            for view in train[self.validation_views // 2 :: self.validation_views]:
                views[view] = "validation"
        return replace(member, split=self.members[member.name], view_splits=tuple(views))

    def to_json(self) -> dict[str, Any]:
        """JSON values for `from_json`."""
        return {"members": dict(self.members), "validation_views": self.validation_views}

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Splits:
        """The splits of a `to_json` record; raises ValueError, KeyError or TypeError for a malformed one."""
        return cls(dict(record["members"]), record["validation_views"])


def choose_splits(
    members: Sequence[Member],
    space: ParameterSpace,
    appearance: str,
    *,
    hold_out: float | None = None,
    seed: int = 0,
    whole_runs: bool = True,
) -> Splits:
    """The members' own splits, completed by test members, a share `hold_out` of the training runs, and by validation.

    Members that differ in ordered parameters alone, such as time, are dumps of one run (see `runs_of`) and held out together.
    Held-out runs show `appearance`, lie between others, and are spread as evenly over the parameters as all runs.  Where no run
    lies between others, as with a single one, dumps between other dumps are held out.

    Without validation members, 8 % of the training runs validate; with fewer than 8 runs, 8 % of the training members; with fewer
    than 8 of these, some of their views.  The choice depends only on the members and the `seed`.  Without `whole_runs`, members are
    drawn one by one, as earlier versions did.

    Raises ValueError where no member can be held out, or the catalog has test members already.
    """
    splits = {member.name: member.split for member in members}
    random = np.random.default_rng(seed)

    def choose(share: float, most: int = len(members), fewest: int = 1) -> list[Member]:
        training = [m for m in members if splits[m.name] == "train"]
        alone = [[m] for m in training if appearance in m.appearances]
        runs = [run for run in runs_of(training, space) if any(appearance in m.appearances for m in run)]
        choices = [groups for groups in (runs if whole_runs else [], alone) if len(groups) >= fewest]
        return _choose(choices, space, share, most, random)

    if hold_out is not None:
        _check_hold_out(hold_out, members)
        tests = choose(hold_out)
        if not tests:
            count = sum(split == "train" for split in splits.values())
            raise ValueError(
                f"none of the {count} training members lies between others, so none can be held out to test the "
                "surrogate: omit hold_out, or render more members"
            )
        splits |= {member.name: "test" for member in tests}
    if "validation" in splits.values():
        return Splits(splits)
    watched = choose(VALIDATION_SHARE, MOST_VALIDATION, FEWEST_TO_SPARE)
    lacking = not watched and not any("validation" in m.view_splits for m in members)
    return Splits(splits | {member.name: "validation" for member in watched}, VALIDATION_VIEWS if lacking else 0)


def with_later(
    splits: Splits,
    members: Sequence[Member],
    space: ParameterSpace,
    appearance: str,
    *,
    hold_out: float | None = None,
    seed: int = 0,
) -> Splits:
    """The splits of a run with those of members that show `appearance` and came later; those it has stay.

    Later members keep the catalog's split, but dumps of a run join the others.  Where `choose_splits` held out a share of the runs
    for tests, or chose members for validation, some of the later ones follow, so that these shares stay.
    """
    own = dict(splits.members)
    present = [m for m in members if m.name in own or appearance in m.appearances]
    groups: list[list[Member]] = []
    for run in runs_of(present, space):
        earlier = {own[m.name] for m in run if m.name in own}
        joined = next(iter(earlier)) if len(earlier) == 1 else ""
        own |= {m.name: (joined or m.split) if m.split == "train" else m.split for m in run if m.name not in own}
        groups += [run] if len({own[m.name] for m in run}) == 1 else [[m] for m in run]

    def top_up(split: str, share: float, most: int = len(members), fewest: int = 1) -> None:
        pool = [group for group in groups if own[group[0].name] in ("train", split)]
        has = [i for i, group in enumerate(pool) if own[group[0].name] == split]
        later = [i for i, group in enumerate(pool) if i not in has and all(m.name not in splits.members for m in group)]
        lacking = min(most, round(share * len(pool))) - len(has)
        if lacking > 0 and later and len(pool) >= fewest:
            random = np.random.default_rng([seed, len(splits.members)])
            for i in held_out(_places(pool, space), lacking, random, later, has):
                own.update({m.name: split for m in pool[i]})

    if hold_out is not None:
        top_up("test", hold_out)
    if all(m.split != "validation" for m in members):
        top_up("validation", VALIDATION_SHARE, MOST_VALIDATION, FEWEST_TO_SPARE)
    return Splits(own, splits.validation_views)


def ordered_names(space: ParameterSpace) -> tuple[str, ...]:
    """The parameters that order the dumps of one run, by their names: time, step, cycle, snapshot, redshift and others."""
    words = set(ORDERED_WORDS.split())
    return tuple(n for n in space.names if n == "t" or re.sub("[^a-z]", "", n.lower()) in words)


def runs_of(members: Sequence[Member], space: ParameterSpace) -> list[list[Member]]:
    """The members grouped by run, in order: those of one run are equal in all parameters that are not ordered.

    Repetitions of a run that differ in a parameter, such as a seed, are runs of their own; those that differ in none are one run.
    """
    ordered, runs = ordered_names(space), dict[tuple[float, ...], list[Member]]()
    for member in members:
        runs.setdefault(tuple(member.parameters[n] for n in space.names if n not in ordered), []).append(member)
    return list(runs.values())


def run_numbers(members: Sequence[Member], space: ParameterSpace) -> list[int]:
    """The number of each member's run, see `runs_of`."""
    numbers = {member.name: number for number, run in enumerate(runs_of(members, space)) for member in run}
    return [numbers[member.name] for member in members]


def shared_runs(members: Sequence[Member], space: ParameterSpace) -> list[Member]:
    """The test members of whose run there is a training member too."""
    runs = [run for run in runs_of(members, space) if any(member.split == "train" for member in run)]
    return [member for run in runs for member in run if member.split == "test"]


def held_out(
    places: NDArray[np.float64],
    count: int,
    random: np.random.Generator,
    among: Sequence[int] | None = None,
    before: Sequence[int] = (),
) -> list[int]:
    """Rows of the normalized parameters (M, P) to hold out: at most `count`, each between others, spread as evenly as all rows.

    They are some of the rows `among` (None: all), beside the rows `before` that are held out already.

    A row lies between others if it is inside their convex hull.  Where too few do, as in many dimensions, those nearest to the
    hull of the others follow, up to a quarter of the bounds away.  The first row is drawn from the inner half; each next one
    minimizes the sum of distances from all rows to the nearest chosen one (greedy k-medians).
    """
    if len(places) < 3 or not places.shape[1]:
        return []
    candidates = random.permutation(len(places) if among is None else among)[: max(MOST_CANDIDATES, 2 * count)]
    outside = np.array([_distance_to_hull(np.delete(places, i, axis=0), places[i]) for i in candidates])  # [C]
    order = np.argsort(outside, kind="stable")
    between = int((outside <= SURROUNDED).sum())
    nearly = min(count, int((outside <= NEARLY).sum())) if places.shape[1] > 1 else 0
    candidates = candidates[order[: max(between, nearly)]]
    if not len(candidates):
        return []
    count = min(count, len(candidates), len(places) - 2)
    apart = np.linalg.norm(places[:, None] - places[candidates], axis=2)  # [M, C]
    from_before = np.linalg.norm(places[:, None] - places[list(before)], axis=2)  # [M, B]
    inner = apart.sum(axis=0).argsort(kind="stable")[: -(-len(candidates) // 2)]
    chosen = [] if before else [int(random.choice(inner))]
    while len(chosen) < count:
        nearest = np.hstack([apart[:, chosen], from_before]).min(axis=1, keepdims=True)  # [M, 1]
        total = np.minimum(apart, nearest).sum(axis=0)  # [C]
        total[chosen] = np.inf
        chosen.append(int(total.argmin()))
    return sorted(int(candidates[i]) for i in chosen)


def _check_hold_out(hold_out: float, members: Sequence[Member]) -> None:
    if type(hold_out) not in (int, float) or not 0.0 < hold_out < 1.0:
        raise ValueError(
            f"hold_out, the share of members that test the surrogate, must lie between 0 and 1, got {hold_out!r}"
        )
    tests = sum(member.split == "test" for member in members)
    if tests:
        raise ValueError(f"the catalog has {tests} test members already: omit hold_out")


def _choose(
    choices: Sequence[Sequence[MemberGroup]],
    space: ParameterSpace,
    share: float,
    most: int,
    random: np.random.Generator,
) -> list[Member]:
    """The members of a share of the groups, but of `most` at most, of the first choice of which some lie between others."""
    for groups in choices:
        count = min(most, max(1, round(share * len(groups))))
        if chosen := held_out(_places(groups, space), count, random):
            return [member for i in chosen for member in groups[i]]
    return []


def _places(groups: Sequence[MemberGroup], space: ParameterSpace) -> NDArray[np.float64]:
    """Normalized parameters (G, P) of groups; without the ordered ones (G, P - O) where these vary inside of groups."""
    values = np.array([[group[0].parameters[name] for name in space.names] for group in groups], dtype=np.float64)
    places = space.normalize(values.reshape(len(groups), len(space)))
    ordered = ordered_names(space)
    varying = any(len({tuple(m.parameters[n] for n in ordered) for m in group}) > 1 for group in groups)
    return np.delete(places, [i for i, name in enumerate(space.names) if varying and name in ordered], axis=1)


def _distance_to_hull(points: NDArray[np.float64], place: NDArray[np.float64]) -> float:
    """Distance d of a place (P,) from the convex hull of points (M, P); 0 inside.

    Found by non-negative least squares, with the sum s of the weights as one more equation.  Its squared residual is the minimum of
    (s d)^2 + (1 - s)^2 over s, which is d^2 / (1 + d^2).
    """
    from scipy.optimize import nnls

    system = np.vstack([points.T - place[:, None], np.ones(len(points))])  # [P + 1, M]
    residual = min(float(nnls(system, np.append(np.zeros(len(place)), 1.0))[1]), 1.0 - 1e-12)
    return float(residual / np.sqrt(1.0 - residual**2))
