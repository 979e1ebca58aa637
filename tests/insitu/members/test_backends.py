"""The backends of the members of a catalog: recorded, shared, and noted where they differ."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import insitu
from catalogs.files.images import read_image
from catalogs.store.description import accept_description
from catalogs.vocabulary.appearance import Isosurface
from insitu.cli import main
from tests.support.hooked import VOLUME, blob, render
from tests.support.looks import LOOK

SCENE = (
    'name = "a"\n[source]\nkind = "loop"\n[[parameters]]\nname = "Re"\nlow = 0\nhigh = 4\n'
    '[views]\nfrequency = 1\nwidth = 16\nheight = 16\n[render]\nbackend = "vtk"\n' + LOOK
)
LOOKS = (VOLUME, Isosurface("iso", 0.5))


def pictures(path: Path, member: int, appearance: str = "dvr") -> np.ndarray:
    stored = sorted((path / "members").iterdir())[member]
    return np.stack([read_image(file) for file in sorted(stored.rglob(f"{appearance}/*.png"))]).astype(int)


def test_a_catalog_records_what_draws_its_appearances(tmp_path: Path) -> None:
    render(tmp_path / "a.cdb", appearances=LOOKS)
    render(tmp_path / "b.cdb", appearances=LOOKS, backend="cpu")
    recorded = [insitu.Catalog.open(tmp_path / name).plan.provenance["backends"] for name in ("a.cdb", "b.cdb")]
    assert recorded == [{"dvr": "cpu", "iso": "vtk"}, {"dvr": "cpu", "iso": "cpu"}]


def test_members_drawn_otherwise_are_noted_and_look_alike(tmp_path: Path) -> None:
    path = tmp_path / "a.cdb"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        render(path, backend="vtk", existing="skip")
        render(path, blob(0.4), 160.0)  # by VTK, as the first
    with pytest.warns(UserWarning, match="dvr are drawn by backend cpu"):
        noted = render(path, blob(0.4), 170.0, backend="cpu")
    assert any("drawn by backend cpu" in warning for warning in noted.warnings)
    members = insitu.Catalog.open(path).members
    assert [member.provenance.get("backends") for member in members] == [None, None, {"dvr": "cpu"}]
    assert np.abs(pictures(path, 1) - pictures(path, 2)).max() <= 1
    assert (pictures(path, 1) != pictures(path, 2)).mean() < 0.01


def test_catalogs_from_before_there_was_a_choice_are_continued_by_vtk(tmp_path: Path) -> None:
    path = tmp_path / "a.cdb"
    render(path, backend="vtk")
    about = json.loads((path / "catalog.json").read_text())
    del about["provenance"]["backends"]
    (path / "catalog.json").write_text(json.dumps(about))
    accept_description(path)
    later = render(path, blob(), 160.0)
    assert not later.warnings
    np.testing.assert_array_equal(pictures(path, 0), pictures(path, 1))


def test_another_word_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"backend must be one of .* got 'gpu'"):
        render(tmp_path / "a.cdb", backend="gpu")
    assert not (tmp_path / "a.cdb").exists()


@pytest.mark.slow
def test_commands_and_scenes_choose_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("m1.npy", blob())
    Path("all.csv").write_text("path,Re\nm1.npy,1\n")
    Path("scene.toml").write_text(SCENE)
    for more, backend in (((), "vtk"), (("--backend", "cpu"), "cpu")):
        asked = ["ensemble", "all.csv", "--catalog", f"{backend}.cdb", "--scene", "scene.toml", "--spacing", *"111"]
        done = CliRunner().invoke(main, [*asked, "--bounds", "Re", "0", "4", "--workers", "1", *more])
        assert done.exit_code == 0, done.output
        assert insitu.Catalog.open(f"{backend}.cdb").plan.provenance["backends"] == {"dvr": backend}
