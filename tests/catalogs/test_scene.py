"""Scenes: what is in the repository parses, and a mistake in one is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from catalogs.scene import Scene

SCENES = sorted((Path(__file__).resolve().parents[2] / "scenes").glob("*.toml"))

MINIMAL = """
name = "demo"
[source]
kind = "simulation"
simulation = "taylor_green"
[[parameters]]
name = "Re"
low = 100.0
high = 200.0
[members]
train = 4
validation = [[150.0]]
test = [155.0]
seed = 3
[[appearance]]
kind = "isosurface"
name = "surface"
isovalue = 0.5
"""


def scene(tmp_path: Path, text: str) -> Scene:
    path = tmp_path / "demo.toml"
    path.write_text(text)
    return Scene.load(path)


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
        ('name = "demo"', 'name = "demo', "demo.toml"),
    ],
)
def test_a_mistake_is_named_with_its_file(tmp_path: Path, old: str, new: str, named: str) -> None:
    with pytest.raises(ValueError, match=r"demo\.toml") as caught:
        scene(tmp_path, MINIMAL.replace(old, new, 1))
    assert named in str(caught.value)


def test_an_unknown_scene_lists_the_known_ones(tmp_path: Path) -> None:
    (tmp_path / "known.toml").write_text(MINIMAL)
    with pytest.raises(FileNotFoundError, match="known here: known"):
        Scene.load(tmp_path / "unknown.toml")


def test_absent_data_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path))
    loaded = scene(tmp_path, 'name = "demo"\n[source]\nkind = "nerf"\npath = "absent"\n')
    with pytest.raises(FileNotFoundError, match="GS_SURROGATE_DATA"):
        loaded.data_path()
