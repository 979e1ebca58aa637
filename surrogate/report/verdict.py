"""The first paragraph of a report: what to believe of a surrogate's pictures and where, by rules over measured scores."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.words import FEWEST_LEARNT, joined_names, plural
from surrogate.evaluation.cases import VALIDATION
from surrogate.evaluation.evaluate import MEAN_IMAGE
from surrogate.evaluation.tables import number
from surrogate.model.representation import FIELD
from surrogate.report.members import row_of
from surrogate.report.outlook import longer_training
from surrogate.report.ranges import Bound, where

BELIEVED = {"structures": 0.9, "colours": 0.9, "details": 0.75}  # predicted shares from which on an aspect is believed
WORDS = {"structures": "place and size of structures", "colours": "colours", "details": "fine detail"}
FEW_TESTS = 3  # members and fewer, which say little about a box of parameters
EMPTY_SHARE = 0.2
NAMED, NAMED_PARAMETERS = 3, 2  # members, and parameters of each
FOREGROUND = "psnr_foreground"


@dataclass(frozen=True)
class Judges:
    """The pictures that judge a surrogate.

    Attributes
    ----------
    members : entries of the report about them.
    words : what they are, for people.
    path : of their scores in entries of the report; () without any that were unseen.
    """

    members: Sequence[Mapping[str, Any]]
    words: str
    path: tuple[str, ...]

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Judges:
        """Test members, else validation members, else nobody."""
        by_split = {split: [m for m in record["members"] if m["split"] == split] for split in ("test", VALIDATION)}
        if tests := by_split["test"]:
            row = row_of(record["images"], "unseen_parameters")
            return cls(
                tests, f"{plural(len(tests), 'test member')} that training never saw", (row, "unseen_parameters")
            )
        if chosen := by_split[VALIDATION]:
            return cls(chosen, f"{plural(len(chosen), 'validation member')}, by which the model was chosen, too,", ())
        return cls([], "", ())

    def score(self, entry: Mapping[str, Any], metric: str) -> float | None:
        """The mean of a metric of a predictor's pictures of these members."""
        if not self.path:
            return entry[VALIDATION].get(metric) if self.members else None
        value = entry[metric]
        for name in self.path:
            value = value[name]
        return value


def verdict(record: Mapping[str, Any]) -> str:
    """The paragraph, in Markdown: warnings first, then what to believe and where, figures, and what would help."""
    judges, space = Judges.of(record), ParameterSpace.from_json(record["parameters"])
    importance = record["outlook"]["importance"]
    named = sorted(space.parameters, key=lambda p: -importance.get(p.name, 0.0))[:NAMED_PARAMETERS]
    first, second = [*_warnings(record, judges)], list[str]()
    if not _is_blank(record):
        first += [*_beliefs(judges, space, named), *_one_in_ten(record, judges, space), *_leads(record, judges)]
        second += _outlook(record)
    return "\n\n".join("  ".join(part) for part in (first, second) if part)


def _is_blank(record: Mapping[str, Any]) -> bool:
    return bool(record["empty"]["of"]) and record["empty"]["images"] == record["empty"]["of"]


def _warnings(record: Mapping[str, Any], judges: Judges) -> Iterator[str]:
    """Sentences on what would make all others misleading."""
    empty, trained = record["empty"], sum(m["split"] == "train" for m in record["members"])
    if _is_blank(record):
        yield f"**All {empty['of']:,} pictures are blank: nothing was learnt or tested.**"
        return
    mean_image: Mapping[str, Any] = next(
        (entry for entry in record["trivial_predictors"] if entry["name"] == MEAN_IMAGE), {}
    )
    if (ahead := _lead(record, judges, mean_image)) is not None and ahead < 0.0:
        yield f"**Do not use these pictures: the mean of the training pictures is {-ahead:.1f} dB closer to the truth.**"
    if not judges.members:
        yield "**No member was kept aside: nothing is known of parameters between the members**, only of other views."
    elif record["parameters"] and len(judges.members) <= FEW_TESTS:
        yield f"**Only {plural(len(judges.members), 'member')} tested this: too few for the box of parameters.**"
    if record["parameters"] and trained < FEWEST_LEARNT:
        yield f"**{plural(trained, 'member')} to learn from: between so few, pictures can at best be blended.**"
    if empty["images"] > EMPTY_SHARE * empty["of"]:
        yield f"**{empty['images']:,} of {empty['of']:,} pictures are blank**, which flatters means over whole pictures."


def _beliefs(judges: Judges, space: ParameterSpace, named: Sequence[Parameter]) -> Iterator[str]:
    """Sentences on which aspects of the pictures to believe, and where; members are described by the `named` parameters."""
    tested = [m for m in judges.members if (m.get("predicted") or {}).get("structures") is not None]
    if not tested:
        return
    places, yes, no = [m["parameters"] for m in tested], dict[str, list[str]](), dict[str, list[str]]()
    listing = set[str]()
    for aspect, words in WORDS.items():
        fails = [m["predicted"][aspect] < BELIEVED[aspect] for m in tested]
        wrong = [m["name"] for m, fail in zip(tested, fails, strict=True) if fail]
        if not wrong:
            yes.setdefault("wherever it was tested", []).append(words)
        elif all(fails):
            no.setdefault("anywhere", []).append(words)
        elif bounds := where(space, places, fails):
            no.setdefault(f"at {_range(bounds)}", []).append(words)
            yes.setdefault(f"at {bounds[0].opposite}" if len(bounds) == 1 else "elsewhere", []).append(words)
        else:
            listed = f" ({joined_names(wrong)})" if len(wrong) <= NAMED else ", in no range of parameters"
            listing |= set(wrong if len(wrong) <= NAMED else ())
            wrongly = f"at {len(wrong)} of {len(fails)} members{listed}"
            few = 2 * len(wrong) < len(fails)
            (yes if few else no).setdefault(f"except {wrongly}" if few else wrongly, []).append(words)
    for lead, each in (("Believe", yes), ("Do not believe", no)):
        if each:
            yield f"**{lead}** {'; '.join(f'{_and(words)} {at}' for at, words in each.items())}."
    if named and listing:
        yield f"There {'; '.join(_place(m, named) for m in tested if m['name'] in listing)}."


def _one_in_ten(record: Mapping[str, Any], judges: Judges, space: ParameterSpace) -> Iterator[str]:
    """The decibels that one picture in ten is below, of the foreground first, and where the worst members lie."""
    low = {metric: judges.score(record["one_in_ten"], metric) for metric in (FOREGROUND, "psnr")}
    if low[FOREGROUND] is None:
        return
    text = (
        f"One picture in ten of {judges.words} is below {low[FOREGROUND]:.1f} dB where it shows something "
        f"({number(low['psnr'], 1)} dB as a whole)"
    )
    scored = [m for m in judges.members if m[FOREGROUND] is not None]
    ordered = sorted(m[FOREGROUND] for m in scored)
    worst = [m[FOREGROUND] <= ordered[math.ceil(len(scored) / 4) - 1] for m in scored]
    bounds = where(space, [m["parameters"] for m in scored], worst)
    yield f"{text}; the worst fourth of the members is at {_range(bounds)}." if bounds else f"{text}."


def _leads(record: Mapping[str, Any], judges: Judges) -> Iterator[str]:
    """The distance to the best simple prediction, and to the other representations."""
    simple = best_simple(record, judges)
    if (ahead := _lead(record, judges, simple)) is not None and ahead >= 0.0:
        yield f"On average pictures are {ahead:.1f} dB closer to the truth than the best simple prediction ({_name(simple)})."
    elif ahead is not None:
        yield f"**At stored views a simple prediction ({_name(simple)}) is {-ahead:.1f} dB closer to the truth.**"
    for entry in record["trivial_predictors"]:
        gap = _lead(record, judges, entry) if entry["representation"] == FIELD else None
        if gap is not None:
            better = "worse" if gap >= 0.0 else "better"
            yield f"Drawn from the emulated field alone, pictures are {abs(gap):.1f} dB {better}."


def _outlook(record: Mapping[str, Any]) -> Iterator[str]:
    """Sentences on longer training, on more members, and on what the model lacks."""
    if record["gaussians"]:
        yield longer_training(record["curve"])
    outlook = record.get("outlook") or {}
    if gains := outlook.get("gains"):
        said = [
            f"{g['more']} more members, about {g['decibels']:+.1f} dB ({g['low']:+.1f} to {g['high']:+.1f})"
            for g in gains
        ]
        yield f"More members would bring the emulated field: {'; '.join(said)}."
    if outlook.get("lacks"):
        yield outlook["lacks"]


def best_simple(record: Mapping[str, Any], judges: Judges) -> Mapping[str, Any]:
    """The entry of the simple predictor, from stored pictures, with the best foreground; empty without any."""
    scores = {
        number: score
        for number, entry in enumerate(record["trivial_predictors"])
        if not entry["representation"] and (score := judges.score(entry, FOREGROUND)) is not None
    }
    return record["trivial_predictors"][max(scores, key=lambda n: scores[n])] if scores else {}


def _lead(record: Mapping[str, Any], judges: Judges, entry: Mapping[str, Any]) -> float | None:
    """Decibels of the foreground by which the surrogate is ahead of a predictor."""
    own, other = (judges.score(one, FOREGROUND) if one else None for one in (record, entry))
    return None if own is None or other is None else own - other


def _name(entry: Mapping[str, Any]) -> str:
    return str(entry["name"]).split(" (")[0]


def _range(bounds: Sequence[Bound]) -> str:
    return " and ".join(map(str, bounds))


def _and(words: Sequence[str]) -> str:
    return ", and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _place(member: Mapping[str, Any], named: Sequence[Parameter]) -> str:
    """A member with the values of some parameters."""
    at = [f"{p.name} = {p.text(member['parameters'][p.name], 4)} {p.unit}".rstrip() for p in named]
    return f"{member['name']} has {joined_names(at)}"
