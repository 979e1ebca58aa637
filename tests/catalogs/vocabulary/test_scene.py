"""Scenes: what is in the repository parses, and a mistake in one is named."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from catalogs.vocabulary.parameters import SPLITS
from catalogs.vocabulary.scene import Scene
from tests.support.scenes import REYNOLDS, SIMULATED, scene

SCENES = sorted((Path(__file__).resolve().parents[3] / "scenes").glob("*.toml"))

MINIMAL = f"""
name = "demo"
{SIMULATED}{REYNOLDS}[members]
train = 4
validation = [[150.0]]
test = [155.0]
seed = 3
[[appearance]]
kind = "isosurface"
name = "surface"
isovalue = 0.5
"""


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_scenes_of_the_repository_load_under_their_own_name(path: Path) -> None:
    loaded = Scene.load(path)
    assert loaded.name == path.stem
    assert len(loaded.views.splits()) == 10 * loaded.views.frequency**2 + 2


def test_members_are_counts_or_lists_and_keep_their_split(tmp_path: Path) -> None:
    loaded = scene(tmp_path, MINIMAL)
    assert [m.split for m in loaded.members] == ["train"] * 4 + ["validation", "test"]
    assert loaded.members[4].parameters == {"Re": 150.0}
    slices = sorted(int((m.parameters["Re"] - 100.0) / 25.0) for m in loaded.members[:4])
    assert slices == [0, 1, 2, 3]  # one member in each quarter: a Latin hypercube
    assert loaded.members == scene(tmp_path, MINIMAL).members


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('kind = "simulation"', 'kind = "magic"', "source.kind"),
        ("[source]", "[sauce]", "sauce"),
        ("high = 200.0", "high = 50.0", "Re"),
        ("test = [155.0]", "test = [150.0]", "same"),
        ("test = [155.0]", "test = [[155.0, 1.0]]", "members.test"),
        ("train = 4", "", "members.train"),
        ("train = 4", "training = 4", "training"),
        ("isovalue = 0.5", "isovalue = 0.5\nshiny = 1", "shiny"),
        ('kind = "isosurface"', 'kind = "solid"', "solid"),
        ("seed = 3", "seed = 3\n[views]\nwidth = 0", "width"),
        ("seed = 3", "seed = 3\n[render]\nnan = 'zero'", "nan"),
        ("seed = 3", "seed = 3\n[render]\nbackend = 'gpu'", "backend"),
        ('name = "demo"', 'name = "demo', "scene.toml"),
    ],
)
def test_a_mistake_is_named_with_its_file(tmp_path: Path, old: str, new: str, named: str) -> None:
    with pytest.raises(ValueError, match=r"scene\.toml") as caught:
        scene(tmp_path, MINIMAL.replace(old, new, 1))
    assert named in str(caught.value)


def test_a_hooked_scene_says_its_members_itself(tmp_path: Path) -> None:
    hooked = MINIMAL.replace(SIMULATED, '[source]\nkind = "hooked"\nscript = "simulation.py"\n')
    assert scene(tmp_path, hooked).members == scene(tmp_path, MINIMAL).members


RUNS = MINIMAL.replace("[members]", '[[parameters]]\nname = "time"\nlow = 0.0\nhigh = 9.0\n[members]').replace(
    "train = 4\nvalidation = [[150.0]]\ntest = [155.0]",
    """
train = [
  { Re = 100.0, time = [1.0, 3.5] },
  { time = 2, Re = 200 },
  [150.0, 4.0],
]
test = [{ Re = [120.0, 130.0], time = 5.0 }]""",
)


def test_the_dumps_of_a_run_are_one_table(tmp_path: Path) -> None:
    loaded = scene(tmp_path, RUNS)
    assert [(m.name, *m.parameters.values()) for m in loaded.members] == [
        ("train-000", 100.0, 1.0),
        ("train-001", 100.0, 3.5),
        ("train-002", 200.0, 2.0),
        ("train-003", 150.0, 4.0),
        ("test-000", 120.0, 5.0),
        ("test-001", 130.0, 5.0),
    ]
    assert all(type(value) is float for m in loaded.members for value in m.parameters.values())


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("Re = 100.0, time = [1.0, 3.5]", "time = [1.0, 3.5]", "members.train[0] must give Re, time, got time"),
        ("time = 2, Re = 200", "time = 2, Re = 200, Ma = 1", "members.train[1] must give Re, time, got time, Re, Ma"),
        (
            "Re = 100.0, time = [1.0, 3.5]",
            "Re = [100.0], time = [1.0]",
            "members.train[0]: one parameter may be a list",
        ),
        ("time = [1.0, 3.5]", "time = []", "members.train[0].time is empty"),
        ("time = [1.0, 3.5]", "time = [1.0, 1.0]", "two are the same"),
        ("time = [1.0, 3.5]", 'time = ["one"]', "one"),
        ("[150.0, 4.0]", "[150.0]", "members.train[2] must hold 2 values"),
    ],
)
def test_a_mistake_in_a_run_is_named(tmp_path: Path, old: str, new: str, named: str) -> None:
    with pytest.raises(ValueError, match=r"scene\.toml") as caught:
        scene(tmp_path, RUNS.replace(old, new, 1))
    assert named in str(caught.value)


def test_an_unknown_scene_lists_the_known_ones(tmp_path: Path) -> None:
    (tmp_path / "known.toml").write_text(MINIMAL)
    with pytest.raises(FileNotFoundError, match="present here: known"):
        Scene.load(tmp_path / "unknown.toml")


def test_absent_data_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path))
    loaded = scene(tmp_path, 'name = "demo"\n[source]\nkind = "nerf"\npath = "absent"\n')
    with pytest.raises(FileNotFoundError, match="GS_SURROGATE_DATA"):
        loaded.data_path()


OF_CATALOG = 'name = "demo"\n[source]\nkind = "catalog"\npath = "flow.cdb"\n'


def test_a_catalog_is_found_beside_the_scene_and_says_all_else(tmp_path: Path) -> None:
    loaded = scene(tmp_path, OF_CATALOG + "hold_out = 0.2\n[members]\nseed = 4\n[training]\ngaussians = 7\n")
    assert loaded.catalog_path == loaded.path.parent / "flow.cdb"
    assert (loaded.source["hold_out"], loaded.seed, loaded.training) == (0.2, 4, {"gaussians": 7})


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("hold_out = 1.2", r"source.hold_out.*must lie in \(0, 1\), got 1.2"),
        ("hold_out = true", "got True"),
        ("holdout = 0.2", r"unknown keys holdout"),
        ("[views]\nwidth = 3", r"views are in the catalog"),
        ("[members]\nvalidation = 3", "members.validation does not apply"),
        ("[members]\ntrain = 3", "only seed and validation apply"),
    ],
)
def test_what_a_scene_of_a_catalog_can_not_say_is_named(tmp_path: Path, more: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        scene(tmp_path, OF_CATALOG + more)
    with pytest.raises(ValueError, match=r"source\.path must name a catalog"):
        scene(tmp_path, OF_CATALOG.replace('"flow.cdb"', "3"))


def test_without_variations_members_show_all(tmp_path: Path) -> None:
    loaded = scene(tmp_path, MINIMAL)
    assert loaded.variations == ()
    assert loaded.assigned(loaded.members) == loaded.members
    assert all(member.appearances is None for member in loaded.members)


def test_the_default_scene_asks_between_what_it_is_taught() -> None:
    makefile = (SCENES[0].parents[1] / "Makefile").read_text()
    assert re.search(r"^SCENE +\?= tgv$", makefile, re.MULTILINE)
    loaded = Scene.load(SCENES[0].parent / "tgv.toml")
    assert Counter(m.split for m in loaded.members) == {"train": 41, "validation": 6, "test": 13}
    runs = {split: {m.parameters["Re"] for m in loaded.members if m.split == split} for split in SPLITS}
    assert [len(runs[split]) for split in SPLITS] == [9, 2, 4]
    assert not runs["train"] & (runs["validation"] | runs["test"]), "runs of their own"
    assert not runs["validation"] & runs["test"]
    places = {
        split: loaded.space.normalize([[*m.parameters.values()] for m in loaded.members if m.split == split])
        for split in SPLITS
    }
    assert (np.abs(places["test"]) < 0.95).all(), "within what is taught"
    nearest = np.linalg.norm(places["test"][:, None] - places["train"], axis=-1).min(axis=1)
    assert nearest.min() > 0.15, "and not beside a training member"
