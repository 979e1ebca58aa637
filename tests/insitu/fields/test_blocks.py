"""Members whose fields lie in blocks on four ranks of MPI, against the same in one block and in one process."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.store.members import COARSE
from render.quality import psnr
from tests.support.mpi import under_mpi

RANKS = 4
PARTS = ("pictures", "partitions", "mistakes", "disagreements", "killed")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
Told = list[dict[str, dict[str, Any]]]


@dataclass(frozen=True)
class Ranks:
    """The folder in which the ranks worked, their output by part, and the end of those of which one died before."""

    folder: Path
    told: Told
    died: CompletedProcess[str]
    survived: list[str]

    def part(self, name: str) -> list[dict[str, Any]]:
        return [one[name] for one in self.told]


@pytest.fixture(scope="module")
def ranks(tmp_path_factory: pytest.TempPathFactory) -> Ranks:
    """One run of all parts, since starting four ranks takes ten seconds of a core; before it one that is killed."""
    folder = tmp_path_factory.mktemp("ranks")
    (folder / "kill").touch()
    died = under_mpi("tests.support.ranks_program", RANKS, str(folder), "killed")
    survived = [m.name for m in Catalog.open(folder / "killed.cdb").members]
    (folder / "kill").unlink()
    done = under_mpi("tests.support.ranks_program", RANKS, str(folder), *PARTS, seconds=600.0)
    assert done.returncode == 0, done.stdout + done.stderr
    told = [json.loads((folder / f"rank-{n}.json").read_text()) for n in range(RANKS)]
    return Ranks(folder, told, died, survived)


def worst(one: Catalog, other: Catalog, appearance: str, member: str = "p-0.5", like: str | None = None) -> float:
    """Of all views the smallest PSNR of a member's pictures, dB."""
    pairs = zip(images(one, member, appearance), images(other, like or member, appearance), strict=True)
    return min(psnr(a, b) for a, b in pairs)


def images(catalog: Catalog, member: str, appearance: str):
    for view in range(len(catalog.plan.cameras)):
        yield catalog.image(member, appearance, view, dtype="float32")


def test_pictures_of_four_ranks_are_those_of_one(ranks: Ranks) -> None:
    told = ranks.part("pictures")
    assert all(one == told[0] for one in told)
    for form in ("png", "exr"):
        assert (told[0][f"has {form} before"], told[0][f"rendered {form}"]) == (False, "rendered")
        assert (told[0][f"has {form}"], told[0][f"again {form}"]) == (True, "skipped")
        blocks, one, alone = (Catalog.open(ranks.folder / f"{name}-{form}.cdb") for name in ("blocks", "one", "alone"))
        least = 90.0 if form == "exr" else 80.0
        for appearance in ("plain", "shaded"):
            assert worst(blocks, one, appearance) >= least
            assert worst(blocks, alone, appearance) >= least
        assert worst(blocks, one, "surface") >= 60.0
        assert worst(blocks, alone, "surface") >= 60.0
        assert blocks.plan.provenance["sample_distances"] == alone.plan.provenance["sample_distances"]
        for field in ("a", "b"):
            found, expected = (c.member("p-0.5").summaries()[field] for c in (blocks, alone))
            np.testing.assert_array_equal(found.histogram, expected.histogram)
            np.testing.assert_array_equal(found.even_points, expected.even_points)
            assert (found.minimum, found.maximum) == (expected.minimum, expected.maximum)
        coarse = [(c.member("p-0.5").path / COARSE).read_bytes() for c in (blocks, one, alone)]
        assert coarse[0] == coarse[1] == coarse[2]  # of the few samples none is averaged


def test_however_the_blocks_come_the_pictures_are_the_same(ranks: Ranks) -> None:
    told = ranks.part("partitions")
    for name in ("blocks", "ghosts", "shared", "levels", "blueprint"):
        assert [one[name] for one in told] == ["rendered"] * RANKS
    catalog = Catalog.open(ranks.folder / "partitions.cdb")
    own, ghosts, shared = (catalog.member(f"p-{p}").coarse_field() for p in (0.0, 0.2, 0.4))
    for other in (ghosts, shared):
        np.testing.assert_array_equal(other.values, own.values)
    assert worst(catalog, catalog, "plain", "p-0.2", "p-0.0") >= 80.0
    assert worst(catalog, catalog, "plain", "p-0.4", "p-0.0") >= 80.0
    assert worst(catalog, catalog, "plain", "p-0.8", "p-0.0") >= 80.0
    assert worst(catalog, catalog, "plain", "p-0.6", "p-0.0") >= 30.0  # half of it at half the resolution
    assert [len(one["heard"]) for one in told] == [1, 0, 0, 0], told[0]["heard"]
    assert "the blocks fill no grid as they are (rank 0 has the spacing" in told[0]["heard"][0]
    assert "resampled to 35 x 26 x 30 samples (trilinear)" in told[0]["heard"][0]


def test_a_mistake_on_one_rank_is_an_error_on_all(ranks: Ranks) -> None:
    told = ranks.part("mistakes")
    for name, message in {
        "nan": "ValueError: rank 2 of 4: 1 of ",
        "warned": "ValueError: rank 2 of 4: 1 of ",
        "type": "TypeError: rank 3 of 4: ",
        "origins": "ValueError: the blocks of ranks 0 and 1 lie at the same place",
        "none": "ValueError: no rank has a block of the field",
        "parameters": "ValueError: ",
        "transparent": "rendered",
        "right": "rendered",
        "twice": "CatalogError: member p-0.0 ",
        "background": "ValueError: rank 0 of 4: background= and comm= can't be combined",
        "other plan": "ValueError: catalog ",
    }.items():
        assert len({one[name] for one in told}) == 1, name
        assert told[0][name].startswith(message), name
    assert [one["failures"] for one in told] == [{}] * RANKS
    assert [m.name for m in Catalog.open(ranks.folder / "mistakes.cdb").members] == ["p-0.0", "p-0.3"]


def test_a_rank_that_disagrees_is_named_on_all(ranks: Ranks) -> None:
    told = ranks.part("disagreements")
    together = ": all ranks render one member together, so give the same on all"
    expected = {
        "parameters": "ValueError: rank 0 gives parameters = {'p': 0.0}, rank 2 {'p': 0.1}" + together,
        "other names": "ValueError: rank 0 gives parameters = {'p': 0.0}, rank 2 {'q': 0.0}" + together,
        "no parameters": "ValueError: rank 0 gives parameters = {'p': 0.0}, rank 2 None" + together,
        "time": "ValueError: rank 0 gives time = 0.1, rank 2 0.2" + together,
        "no time": "ValueError: rank 0 gives time = 0.1, rank 2 None" + together,
        "name": "ValueError: rank 0 gives name = 'b', rank 2 'a'" + together,
        "nan": "ValueError: rank 0 gives nan = 'refuse', rank 2 'transparent'" + together,
        "array": "ValueError: rank 0 gives array = None, rank 2 'q'" + together,
        "dims": "ValueError: rank 0 gives dims = 'zyx', rank 2 'xyz'" + together,
        "warned": "ValueError: rank 0 gives time = 0.1, rank 2 0.2" + together,
        "types": "ValueError: the blocks must have one type of numbers, but rank 0 has float64, rank 2 has int32: convert them",
        "bad ghosts": "ValueError: rank 2 of 4: ghosts must be a number of layers",
        "ghosts": "ValueError: the blocks fill no grid (the blocks leave ",
        "has": "ValueError: rank 0 gives parameters = {'p': 0.0}, rank 2 {'p': 0.5}" + together,
        "mesh": "ValueError: rank 2 of 4: a mesh is one mapping",
        "rounding": "rendered",
        "policy": "ValueError: rank 2 of 4: nan must be one of",
        "background": "ValueError: rank 2 of 4: background= and comm= can't be combined",
        "path": "ValueError: rank 2 of 4: catalog must be the path of a .cdb folder, got 3",
    }
    expected["types of meshes"] = expected["types"]
    for name, message in expected.items():
        assert len({one[name] for one in told}) == 1, name
        assert told[0][name].startswith(message), (name, told[0][name])
    assert "ghosts of rank 0 are [0, 0, 0], of rank 2 [1, 1, 1]" in told[0]["ghosts"]
    assert "gives" not in told[0]["no block"]
    assert not (ranks.folder / "x.cdb").exists()


def test_a_rank_that_dies_leaves_no_half_member_and_the_next_run_goes_on(ranks: Ranks) -> None:
    assert ranks.died.returncode != 0
    assert "signal 9" in ranks.died.stdout + ranks.died.stderr
    assert ranks.survived == ["p-0.0"]
    assert [one["second"] for one in ranks.part("killed")] == ["rendered"] * RANKS
    assert sorted(m.name for m in Catalog.open(ranks.folder / "killed.cdb").members) == ["p-0.0", "p-1.0"]
