"""Names, units, bounds and splits of parameters, from the attributes and small arrays of a file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.parameters import SPLITS
from catalogs.vocabulary.words import joined_names
from insitu.readers.arrays import Arrays, StoredArray
from render.coordinates import described

SPLIT = "split"
SPLIT_WORDS = {"training": "train", "val": "validation", "valid": "validation", "testing": "test"}
LOWER, UPPER = ("lower", "low", "min", "lower_bounds", "minimum"), ("upper", "high", "max", "upper_bounds", "maximum")
BOTH = ("bounds", "ranges", "limits", "parameter_bounds", "parameter_ranges", "param_bounds")
TIME = re.compile(r"t|x?times?|time_\w+|\w+_time", re.IGNORECASE)  # names of times
NAMES = ("names", "parameter_names", "param_names", "columns", "labels")


def asking(arrays: Arrays, missing: Iterable[str]) -> ValueError:
    """The error that asks for what is missing, in one sentence, with what is there."""
    return ValueError(f"please give {' and '.join(missing)}; the file holds {arrays}")


def wanted_array(arrays: Arrays, name: str) -> StoredArray | None:
    """The array of this name: its path, or the only one whose path ends so."""
    if name in arrays.arrays:
        return arrays.arrays[name]
    ends = [a for a in arrays.arrays.values() if a.stem == name]
    return ends[0] if len(ends) == 1 else None


def auxiliaries(arrays: Arrays, *, but: str = "") -> set[str]:
    """Paths of the arrays that describe others by CF's attributes, save those that `but` alone names.

    They are fields or parameters only where the user says so.
    """
    paths: set[str] = set()
    about = [(a.group, a.attrs) for a in arrays.arrays.values()] + list(arrays.attrs.items())
    for group, attrs in about:
        stated = {key: as_text(value) for key, value in attrs.items() if isinstance(value, str | bytes) and key != but}
        paths |= {path for name in described(stated) if (path := _nearest(arrays, group, name))}
    return paths


def is_time(array: StoredArray) -> bool:
    """True if an array holds times, by its attributes or its name."""
    about = {key: as_text(array.attrs.get(key, "")).lower() for key in ("axis", "standard_name", "units")}
    stated = about["axis"] == "t" or about["standard_name"] == "time" or " since " in about["units"]
    return stated or TIME.fullmatch(array.stem) is not None


def _nearest(arrays: Arrays, group: str, name: str) -> str:
    """The path of an array that is named in a group, in it or above; "" where there is none."""
    while group:
        if f"{group}/{name}" in arrays.arrays:
            return f"{group}/{name}"
        group = group.rpartition("/")[0]
    return name.strip("/") if name.strip("/") in arrays.arrays else ""


def table_of(array: StoredArray) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Parameters [M, P] and, where the array names its columns, their names."""
    values = array.read()
    if array.dtype.names:
        return np.stack([values[n] for n in array.dtype.names], axis=1).astype(np.float64), tuple(array.dtype.names)
    if values.ndim == 1:
        values = values[:, None]
    if values.ndim != 2 or values.dtype.kind not in "fiu":
        raise ValueError(f"{array!r} must hold one row of numbers a member")
    return values.astype(np.float64), ()


def numbers_of(array: StoredArray) -> NDArray[np.float64]:
    """One parameter of every member [M]."""
    if len(array.shape) != 1 or array.dtype.kind not in "fiu":
        raise ValueError(f"{array!r} must hold one number a member")
    return array.read().astype(np.float64)


def attributes_about(arrays: Arrays, array: StoredArray) -> dict[str, Any]:
    """The attributes of the file, of the groups above an array, and its own: the nearest hold."""
    attributes = dict(arrays.attrs.get("", {}))
    path = ""
    for part in array.group.split("/") if array.group else ():
        path = f"{path}/{part}" if path else part
        attributes.update(arrays.attrs.get(path, {}))
    return {**attributes, **array.attrs}


def column_names(arrays: Arrays, columns: StoredArray, count: int, fields: Sequence[StoredArray]) -> tuple[str, ...]:
    """Names of `count` columns; raises ValueError asking for them."""
    lists: dict[str, tuple[str, ...]] = {}
    for array in (*fields, columns):
        about = attributes_about(arrays, array)
        lists |= {
            k: words for k, v in about.items() if "unit" not in k.lower() and len(words := words_of(v, count)) == count
        }
    for array in arrays.arrays.values():  # names may be an array of words
        if array.shape == (count,) and array.dtype.kind in "OSUT":
            lists[array.name] = tuple(map(as_text, array.read()))
    ranked = [k for k in lists if k.lower().rpartition("/")[2] in NAMES]
    ranked += [k for k in lists if "name" in k.lower()] + [
        k for k in lists if re.search("param|column|label|variable", k.lower())
    ]
    candidates = ranked or (list(lists) if len(lists) == 1 else [])
    if not candidates:
        more = f": attributes {joined_names(sorted(lists))} could be they" if lists else ""
        raise asking(arrays, [f"--names, the names of the {count} columns of {columns.name!r}{more}"])
    return lists[candidates[0]]


def column_units(arrays: Arrays, columns: StoredArray, count: int, fields: Sequence[StoredArray]) -> tuple[str, ...]:
    """Units of `count` columns, from attributes of the parameters, else of the file; "" where these say nothing of each."""
    about = {**attributes_about(arrays, fields[0] if fields else columns), **columns.attrs}
    own = {**arrays.attrs.get("", {}), **columns.attrs}
    keys = [k for k in about if "unit" in k.lower() and (k in own or "param" in k.lower())]
    unit_lists = (words_of(about[k], count, empty=True) for k in sorted(keys, key=lambda k: "param" not in k.lower()))
    return next((words for words in unit_lists if len(words) == count), ("",) * count)


def words_of(value: Any, count: int, *, empty: bool = False) -> tuple[str, ...]:
    """The words of an attribute: an array of them, a JSON list, or one text that separates them by comma, semicolon or space."""
    array = np.asarray(value)
    if array.dtype.kind in "OSUT" and array.ndim == 1:
        return tuple(map(as_text, array))
    if array.ndim or array.dtype.kind not in "OSUT":
        return ()
    text = as_text(array.item() if array.dtype.kind != "T" else str(array)).strip()
    if text.startswith("["):
        try:
            listed = json.loads(text)
            return tuple(map(str, listed)) if all(isinstance(w, str) for w in listed) else ()
        except ValueError:
            text = text.strip("[]").replace("'", "")
    for separator in (";", ",", r"\s+|\|"):
        words = tuple(w.strip() for w in re.split(separator, text))
        if len(words) == count and (empty or all(words)):
            return words
    return ()


def bounds_about(
    arrays: Arrays, columns: StoredArray | None, field: StoredArray, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """(low, high) of each of `count` parameters as attributes say; None where they don't."""
    about = attributes_about(arrays, columns or field) | attributes_about(arrays, field)
    by_key = {k.lower(): np.asarray(v) for k, v in about.items()}
    numbers = {k: v.astype(np.float64) for k, v in by_key.items() if v.dtype.kind in "fiu"}
    low, high = (next((np.atleast_1d(numbers[k]) for k in keys if k in numbers), None) for keys in (LOWER, UPPER))
    if low is None or high is None:
        both = next(
            (numbers[k] for k in BOTH if k in numbers and numbers[k].size == 2 * count and numbers[k].ndim == 2), None
        )
        if both is None:
            return None
        low, high = both.T if both.shape == (count, 2) else both
    for name, values in (("lower", low), ("upper", high)):
        if values.shape != (count,):
            raise ValueError(f"attribute {name!r} must hold {count} values, got shape {values.shape}")
    return low, high


def splits_of(arrays: Arrays, name: str | None, count: int) -> tuple[str, ...] | None:
    """The splits of `count` members, from the array of this name or "split"; None where there is none."""
    array = wanted_array(arrays, name or SPLIT)
    if array is None:
        if name:
            raise ValueError(f"--split: there is no array {name!r}; the file holds {arrays}")
        return None
    words = [as_text(word).lower() for word in array.read().ravel()]
    splits = tuple(SPLIT_WORDS.get(word, word) for word in words)
    wrong = sorted(set(splits) - set(SPLITS))
    if len(splits) != count or wrong:
        raise ValueError(f"{array.name!r} must hold {count} of {SPLITS}, got {len(splits)} with {wrong or 'no others'}")
    return splits


def as_text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
