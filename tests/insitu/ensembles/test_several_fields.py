"""Ensembles and scenes of several fields, in files and from simulations."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import (
    appearance_from_json,
)
from catalogs.vocabulary.scene import Scene
from insitu.cli import main
from insitu.ensembles.dataset import make_dataset
from insitu.readers.layout import FileMapping
from insitu.readers.stored import StoredEnsemble
from tests.support.hooked import blob, speed, tree
from tests.support.scenes import scene

pytestmark = pytest.mark.usefixtures("prepared_workers")

PROJECT = Path(__file__).resolve().parents[3]


# --- stored ensembles ------------------------------------------------------------------------------------------------


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """Four members of three data sets, one of another shape."""
    path = tmp_path / "ensemble.h5"
    random = np.random.default_rng(0)
    with h5py.File(path, "w") as file:
        file["q"] = np.stack([blob(w) for w in (0.3, 0.4, 0.5, 0.6)])
        file["speed"] = np.stack([speed(w) for w in (0.3, 0.4, 0.5, 0.6)])
        file["coarse"] = random.random((4, 6, 6, 6))
        file["params"] = np.linspace(100.0, 200.0, 4)[:, None]
        file.attrs.update(names=["Re"], lower=[100.0], upper=[200.0], spacing=[0.1] * 3, origin=[0, 0, 0], time=3.0)
    return path


def test_several_data_sets_are_read_by_name(stored: Path) -> None:
    opened = StoredEnsemble.open(stored, FileMapping(("speed", "q")))
    found = opened.read(2)
    assert list(found) == ["speed", "q"]
    assert np.array_equal(found["speed"].values, speed(0.5))
    assert found["q"].time == 3.0
    assert opened.identity == {"kind": "hdf5", "file": "ensemble.h5", "datasets": ["speed", "q"], "contents": ANY}
    one = StoredEnsemble.open(stored, FileMapping(("q",))).identity
    assert one == {"kind": "hdf5", "file": "ensemble.h5", "dataset": "q", "contents": ANY}, "as it was: catalogs go on"
    assert "speed, q" in repr(opened)


@pytest.mark.parametrize(
    ("datasets", "message"),
    [
        (["q", "coarse"], "one shape.*coarse"),
        (["q", "p"], "no field p;"),
        (["q", "q"], "each once"),
        (["params"], "axes"),
    ],
)
def test_data_sets_that_can_not_be_are_named(stored: Path, datasets: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        StoredEnsemble.open(stored, FileMapping(tuple(datasets)))
    assert "ensemble.h5" in str(caught.value)


LOOK = """
[[appearance]]
kind = "isosurface"
name = "core"
field = "q"
isovalue = 0.5
[[appearance]]
kind = "isosurface"
name = "fast"
field = "speed"
isovalue = 2.0
"""


def run(*arguments: object) -> Any:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.mark.slow
def test_a_stored_ensemble_shows_the_data_sets_that_appearances_name(stored: Path, tmp_path: Path) -> None:
    look, out = tmp_path / "look.toml", tmp_path / "out.cdb"
    look.write_text(LOOK)
    result = run("ensemble", stored, "--catalog", out, "--appearance", look, "--size", 16, "--workers", 1)
    assert result.exit_code == 0, result.output
    assert check(out) == []
    made = Catalog.open(out)
    assert made.plan.fields == ("q", "speed")
    assert made.members[3].summary("speed").maximum == float(speed(0.6).max())  # type: ignore[union-attr]
    again = run("ensemble", stored, "--catalog", out, "--workers", 1)  # the catalog knows them
    assert again.exit_code == 0, again.output
    assert "4 were there already" in again.output
    wrong = run("ensemble", stored, "--catalog", tmp_path / "b.cdb", "--appearance", look, "--dataset", "q")
    assert wrong.exit_code == 1
    assert "appearance fast shows the field 'speed', but the member has q" in wrong.output
    assert not (tmp_path / "b.cdb").exists()


@pytest.mark.slow
def test_each_data_set_is_probed_and_may_be_shown_as_suggested(stored: Path, tmp_path: Path) -> None:
    both = ["--dataset", "q", "--dataset", "speed"]
    made = run("ensemble", stored, "--catalog", tmp_path / "a.cdb", *both, "--size", 16, "--workers", 1)
    assert made.exit_code == 0, made.output
    plan = Catalog.open(tmp_path / "a.cdb").plan
    assert [(a.name, a.field) for a in plan.appearances] == [("dvr-q", "q"), ("dvr-speed", "speed")]
    probed = run("probe", stored, "--array", "q", "--array", "speed", "--preview", tmp_path / "p.png")
    assert probed.exit_code == 0, probed.output
    assert probed.output.index("field q\n") < probed.output.index("field speed\n")
    assert sorted(p.name for p in tmp_path.glob("*.png")) == ["p-dvr-q.png", "p-dvr-speed.png"]
    text = probed.output[probed.output.index("[[appearance]]", probed.output.index("field speed")) :]
    (record,) = tomllib.loads(text.partition(f"\n# {tmp_path}")[0])["appearance"]
    assert appearance_from_json(record) == plan.appearances[1]
    single = run("probe", stored, "--array", "q")
    assert "field" not in single.output.replace("fields", "")
    assert 'name = "dvr"' in single.output


# --- scenes ----------------------------------------------------------------------------------------------------------


def small_scene(folder: Path, *changes: tuple[str, str]) -> Scene:
    """`tiny-fields` with fewer points, members and pictures."""
    text = (PROJECT / "scenes" / "tiny-fields.toml").read_text()
    for old, new in (
        ("resolution = 32", "resolution = 12"),
        ("time = 4.0", "time = 0.5"),
        ("train = [1500.0, 1833.0, 2167.0, 2500.0]", "train = [1500.0, 2500.0]"),
        ("[1667.0, 2333.0]", "[1667.0]"),
        ("width = 64\nheight = 64", "frequency = 1\nwidth = 16\nheight = 16"),
        ("target_decibels = 45.0", "target_decibels = 35.0"),
        *changes,
    ):
        assert old in text
        text = text.replace(old, new)
    return scene(folder, text)


@pytest.mark.slow
def test_the_scene_of_two_fields_is_made_and_then_left_alone(tmp_path: Path) -> None:
    from insitu.simulations import simulation

    asked = small_scene(tmp_path)
    result = make_dataset(asked, tmp_path / "runs", workers=1)
    assert (result.made, result.failures) == (4, {})
    assert check(result.catalog) == []
    made = Catalog.open(result.catalog)
    assert made.plan.fields == ("q_criterion", "speed")
    assert made.plan.variations == asked.variations
    assert set(made.plan.provenance["sample_distances"]) == {"dvr", "speed-dvr"}
    for member in made.members:
        truth = simulation("taylor_green").run_fields(
            member.parameters, fields=("speed", "q_criterion"), resolution=12, time=0.5
        )
        for name, field in truth.items():
            kept = member.summary(name)
            assert kept is not None
            assert (kept.minimum, kept.maximum) == (float(field.values.min()), float(field.values.max()))
    assert make_dataset(asked, tmp_path / "runs", workers=1).made == 0
    before = tree(result.catalog)
    other = small_scene(tmp_path, ('"speed"', '"vorticity"'))
    with pytest.raises(ValueError, match=r"not the one.*appearances\.speed-dvr\.field"):
        make_dataset(other, tmp_path / "runs")
    assert tree(result.catalog) == before


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        (
            'fields = ["q_criterion", "speed"]',
            'fields = ["q_criterion"]',
            "'speed', but the member has q_criterion",
        ),
        ('fields = ["q_criterion", "speed"]', "", "'speed', but the member has q_criterion"),
        ('"q_criterion", "speed"]', '"q_criterion", "speed", "vorticity"]', "vorticity, which no appearance shows"),
        ('"q_criterion", "speed"]', '"q_criterion", "sped"]', "q_criterion, speed, vorticity, each once"),
        ('"q_criterion", "speed"]', '"speed", "speed"]', "each once"),
        ('["q_criterion", "speed"]', '"speed"', "source.fields must be a list of names"),
        ('field = "speed"', 'field = "Speed"', "'Speed', but the member has"),
    ],
)
def test_fields_that_a_source_lacks_are_named_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str, named: str
) -> None:
    monkeypatch.setattr("insitu.ensembles.dataset.run_ensemble", lambda *_, **__: pytest.fail("it ran"))
    with pytest.raises(ValueError, match=r"scene\.toml") as caught:
        make_dataset(small_scene(tmp_path, (old, new)), tmp_path / "runs")
    assert named in str(caught.value)
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_a_scene_of_a_file_names_its_data_sets(stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path))
    text = (
        'name = "stored"\n[source]\nkind = "hdf5"\npath = "ensemble.h5"\nfields = ["speed", "q"]\n'
        f"{LOOK}[views]\nfrequency = 1\nwidth = 16\nheight = 16\n"
    )
    path, asked = tmp_path / "scene.toml", scene(tmp_path, text)
    result = make_dataset(asked, tmp_path / "runs", workers=1)
    assert (result.made, result.failures) == (4, {})
    assert Catalog.open(result.catalog).plan.fields == ("q", "speed")
    probed = run("probe", path, "--array", "speed")
    assert probed.exit_code == 0, probed.output
    assert "speed, q, got p" in run("probe", path, "--array", "p").output
    with pytest.raises(ValueError, match="leave dataset out"):
        make_dataset(scene(tmp_path, text.replace("fields =", 'dataset = "q"\nfields =')), tmp_path / "other")


@pytest.mark.slow
def test_data_sets_of_similar_names_are_told_apart(tmp_path: Path) -> None:
    """Their names' parts in those of appearances are the same."""
    path, names = tmp_path / "greek.h5", ("α", "β", "x" * 120)
    with h5py.File(path, "w") as file:
        for name in names:
            file[name] = np.stack([blob(w) for w in (0.3, 0.4)])
        file["params"] = np.array([[100.0], [200.0]])
        file.attrs.update(names=["Re"], lower=[100.0], upper=[200.0], spacing=[0.1] * 3, origin=[0, 0, 0])
    asked = [text for name in names for text in ("--array", name)]
    probed = run("probe", path, *asked, "--preview", tmp_path / "p.png")
    assert probed.exit_code == 0, probed.output
    assert len(list(tmp_path.glob("p-*.png"))) == 3
    asked = [text for name in names for text in ("--dataset", name)]
    made = run("ensemble", path, "--catalog", tmp_path / "a.cdb", *asked, "--size", 8, "--workers", 1)
    assert made.exit_code == 0, made.output
    assert Catalog.open(tmp_path / "a.cdb").plan.fields == names


def test_a_pilot_with_nan_is_named_with_its_field(stored: Path, tmp_path: Path) -> None:
    with h5py.File(stored, "a") as file:
        file["speed"][2, 3, 4, 5] = np.nan
    for arguments in (
        ("probe", stored, "--array", "q", "--array", "speed"),
        ("ensemble", stored, "--dataset", "speed"),
    ):
        more = ("--catalog", tmp_path / "a.cdb") if arguments[0] == "ensemble" else ()
        found = run(*arguments, *more)
        assert found.exit_code == 1
        assert "field 'speed' of member-0002: 1 of 1728 values are NaN" in found.output
    assert not (tmp_path / "a.cdb").exists()


def test_a_scene_of_images_made_elsewhere_has_nothing_to_probe() -> None:
    found = run("probe", PROJECT / "scenes" / "nyx.toml")
    assert found.exit_code == 1
    assert "nyx.toml: a source of kind nerf has no fields" in found.output
