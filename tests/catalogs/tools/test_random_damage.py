"""Random damage to any file of a catalog: `check` names it, and repairing loses nothing that could be kept."""

from __future__ import annotations

import csv
import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from catalogs.files import cinema
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.missing import missing_members, report_missing
from catalogs.tools.check import check
from catalogs.tools.packing import pack
from catalogs.tools.repair import repair
from tests.catalogs.conftest import add_member, small_plan
from tests.support.mortal_disk import contents

PARAMETERS = {"a": 110.0, "b": 150.0, "c": 190.0}
DERIVED = ("data.csv", "rows.csv")  # what a repair may write anew
NOT_OF_THE_PLAN = ("schema", "images", "digest")
CASES = 30  # per seed
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, Path]:
    """A small catalog of three members and a missing one, and the same packed."""
    folder = tmp_path_factory.mktemp("whole")
    made = Catalog.create(folder / "x.cdb", small_plan())
    for seed, (name, reynolds) in enumerate(PARAMETERS.items()):
        add_member(made, name, reynolds, seed=seed)
    made.rebuild_table()
    pack(made.path, folder / "packed.cdb")
    for path in (made.path, folder / "packed.cdb"):
        report_missing(path, "d", {"Re": 199.0, "Pr": 1.0}, "ValueError: bad")
    return {False: made.path, True: folder / "packed.cdb"}


def flip(draw: random.Random, one: Path, _: Path) -> None:
    data = bytearray(one.read_bytes())
    data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    one.write_bytes(bytes(data))


def overwrite(draw: random.Random, one: Path, _: Path) -> None:
    data = bytearray(one.read_bytes())
    start = draw.randrange(len(data))
    data[start : start + 64] = bytes(len(data[start : start + 64]))
    one.write_bytes(bytes(data))


def digit(draw: random.Random, one: Path, _: Path) -> None:
    data = bytearray(one.read_bytes())
    digits = [place for place, byte in enumerate(data) if byte in b"0123456789"]
    if digits:
        data[draw.choice(digits)] = draw.choice(b"0123456789")
        one.write_bytes(bytes(data))


def cut(draw: random.Random, one: Path, _: Path) -> None:
    one.write_bytes(one.read_bytes()[: draw.randrange(one.stat().st_size)])


def lengthen(draw: random.Random, one: Path, _: Path) -> None:
    one.write_bytes(one.read_bytes() + draw.randbytes(20))


def delete(draw: random.Random, one: Path, _: Path) -> None:
    one.unlink()


def swap(draw: random.Random, one: Path, other: Path) -> None:
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)


def copy(draw: random.Random, one: Path, other: Path) -> None:
    one.write_bytes(other.read_bytes())


def rename(draw: random.Random, one: Path, _: Path) -> None:
    one.rename(one.with_name(f"x{one.name}"))


FILES: list[Callable[[random.Random, Path, Path], None]] = [
    *(flip, overwrite, digit, cut, lengthen, delete, swap, copy, rename)
]


def damage_folder(draw: random.Random, path: Path) -> None:
    """Remove, rename or swap members' folders."""
    one, other = draw.sample(sorted((path / "members").iterdir()), 2)
    kind = draw.randrange(3)
    if kind == 0 or not one.is_dir():
        shutil.rmtree(one, ignore_errors=True)
    else:
        aside = one.with_name(f"aside{draw.randrange(1000)}")
        one.rename(aside)
        if kind == 2:
            other.rename(one)
            aside.rename(other)


def damage(draw: random.Random, path: Path) -> None:
    """One random damage, most to files of any kind, some to folders."""
    if draw.random() < 0.1:
        damage_folder(draw, path)
        return
    by_kind: dict[str, list[Path]] = {}
    for name in contents(path):
        if name != ".lock":
            by_kind.setdefault(name.rpartition(".")[2] + name.partition("/")[0], []).append(path / name)
    one = draw.choice(draw.choice(list(by_kind.values())))
    same = [file for file in path.rglob(f"*{one.suffix}") if file.is_file() and file != one]
    anything = [path / name for name in contents(path) if path / name != one]
    draw.choice(FILES)(draw, one, draw.choice(same or anything))


def meaning(path: Path) -> dict[str, Any]:
    """All that matters in a catalog, read without our readers: values of JSON and CSV files, and bytes of others."""
    return {name: _meaning(Path(name), data) for name, data in contents(path).items()} | {".lock": b""}


def _meaning(name: Path, data: bytes) -> Any:
    try:
        if name.suffix == ".json":
            record = json.loads(data)
            return {k: v for k, v in record.items() if k not in NOT_OF_THE_PLAN} if name.stem == "catalog" else record
        if name.suffix == ".csv":
            return list(csv.reader(data.decode().splitlines(), strict=True))
    except (ValueError, AttributeError, csv.Error):
        return data
    return data


def check_repaired(path: Path, damaged: dict[str, bytes], original: dict[str, bytes], *, single: bool) -> None:
    """After a repair: members are whole or missing, nothing is lost, and the rest is as if it alone had been written."""
    now = contents(path)
    stored = {member.name for member in Catalog.open(path).members}
    findings = [f for f in check(path) if not f.place.startswith(".missing/")]
    assert [f for f in findings if f.problem != cinema.NO_ROW or stored] == []
    assert stored <= set(PARAMETERS)
    for name, data in original.items():
        if name.startswith("members/") and name.split("/")[1] in stored:
            assert now[name] == data, name
    lines = original["data.csv"].splitlines(keepends=True)
    expected = [lines[0], *(line for line in lines[1:] if line.split(b",")[4].decode() in stored)]
    assert sorted(now["data.csv"].splitlines(keepends=True)) == sorted(expected)
    kept = set(now.values())
    lost = [n for n, d in damaged.items() if d not in kept and not n.endswith((*DERIVED, "member.json"))]
    assert [name for name in lost if not name.startswith(".missing/")] == []
    if single:
        missing = {member.name: member.parameters for member in missing_members(path)}
        for name in set(PARAMETERS) - stored:
            assert missing[name] == {"Re": PARAMETERS[name], "Pr": 1.0}


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("packed", [False, True])
def test_damage_is_named_and_what_is_left_is_kept(
    whole: dict[bool, Path], tmp_path: Path, seed: int, packed: bool
) -> None:
    draw = random.Random(1000 * packed + seed)
    original, right = contents(whole[packed]), meaning(whole[packed])
    for case in range(CASES // (2 if packed else 1)):
        path, single = tmp_path / f"{case}.cdb", case % 3 > 0
        shutil.copytree(whole[packed], path)
        for _ in range(1 if single else 3):
            damage(draw, path)
        damaged = contents(path)
        findings = check(path)
        changed = {name for name, values in right.items() if meaning(path).get(name) != values}
        if changed - {".missing/d.json", ".lock"}:
            assert findings, changed
        if any(finding.place == "catalog.json" for finding in findings):
            with pytest.raises(CatalogError, match=r"catalog\.json"):
                repair(path)
            assert contents(path) == damaged
        else:
            repair(path)
            check_repaired(path, damaged, original, single=single)
        shutil.rmtree(path)
