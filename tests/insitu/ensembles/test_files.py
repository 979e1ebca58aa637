"""Ensembles of many files, end to end: whatever the format, the same pictures; and no other file passes for a stored one."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.scene import Scene, ViewPlan
from insitu.cli import main
from insitu.ensembles.ensemble import run_ensemble
from insitu.ensembles.files import FileEnsemble
from insitu.ensembles.sources import ensemble_of
from insitu.fields.location import FieldLocation
from insitu.members.planning import PlanOptions
from insitu.readers.tables import match_files, read_table
from tests.support.executors import AtOnce
from tests.support.hooked import FUNCTION, SPACING, blob

pytestmark = pytest.mark.usefixtures("prepared_workers")

VOLUME = VolumeRendering("dvr", FUNCTION)
NAMED = VolumeRendering("dvr", FUNCTION, field="f")
VIEWS = ViewPlan(frequency=1, width=12, height=12)
WIDTHS = (0.3, 0.4, 0.5)
PLACE = {"spacing": SPACING, "origin": (0.0, 0.0, 0.0)}


def image(values: np.ndarray) -> Any:
    import pyvista

    made = pyvista.ImageData(dimensions=values.shape[::-1], **PLACE)
    made["f"], made["other"] = values.ravel(), 2 * values.ravel()
    return made


def labelled(values: np.ndarray) -> Any:
    xarray = pytest.importorskip("xarray")
    places = {d: SPACING[0] * np.arange(12) for d in "xyz"}
    return xarray.Dataset({"f": (("z", "y", "x"), values), "other": (("z", "y", "x"), 2 * values)}, coords=places)


def hdf5(path: Path, values: np.ndarray) -> None:
    with h5py.File(path, "w") as file:
        file["f"], file["other"] = values, 2 * values
        file.attrs["spacing"] = SPACING


FORMATS: dict[str, Callable[[Path, np.ndarray], Any]] = {
    ".npy": np.save,
    ".npz": lambda path, values: np.savez(path, f=values, other=2 * values),
    ".vti": lambda path, values: image(values).save(path),
    ".h5": hdf5,
    ".nc": lambda path, values: labelled(values).transpose("x", "y", "z").to_netcdf(path, engine="h5netcdf"),
    ".zarr": lambda path, values: labelled(values).to_zarr(path, consolidated=False),
}


def write(folder: Path, suffix: str = ".npy") -> FileEnsemble:
    """A file for each width, in a folder of each run."""
    for number, width in enumerate(WIDTHS):
        (folder / f"run_{width}").mkdir(parents=True, exist_ok=True)
        FORMATS[suffix](folder / f"run_{width}" / f"dump_{number}{suffix}", blob(width))
    pattern = f"run_{{width}}/dump_{{}}{suffix}"
    arrays = () if suffix == ".npy" else ("f",)
    place: dict[str, Any] = PLACE if suffix in (".npy", ".npz") else {}
    return FileEnsemble.of(match_files(pattern, folder), arrays=arrays, location=FieldLocation(**place))


def render(path: Path, ensemble: FileEnsemble, look: VolumeRendering = VOLUME, **more: Any) -> Any:
    options = PlanOptions(ensemble.space, (look,), VIEWS, sample_distance=0.05)
    return run_ensemble(path, ensemble.members(), ensemble, options, executor=AtOnce(), **more)


def pictures(path: Path) -> np.ndarray:
    catalog = Catalog.open(path)
    return np.stack([catalog.images(member, "dvr") for member in catalog.members])


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    folder = tmp_path_factory.mktemp("plain")
    render(folder / "a.cdb", write(folder))
    return pictures(folder / "a.cdb")


@pytest.mark.parametrize("suffix", [s for s in FORMATS if s != ".npy"])
def test_every_format_gives_the_same_pictures(tmp_path: Path, suffix: str, expected: np.ndarray) -> None:
    result = render(tmp_path / "a.cdb", write(tmp_path, suffix), NAMED if suffix == ".vti" else VOLUME)
    assert (len(result.rendered), result.failures) == (3, {})
    assert np.abs(pictures(tmp_path / "a.cdb").astype(int) - expected).max() <= 1
    assert check(tmp_path / "a.cdb") == []


def test_members_keep_their_file_and_a_changed_one_is_named(tmp_path: Path) -> None:
    path, ensemble = tmp_path / "a.cdb", write(tmp_path)
    render(path, ensemble)
    kept = Catalog.open(path).member("width-0.4").provenance["source"]
    assert (kept["kind"], Path(kept["file"]).name) == ("files", "dump_1.npy")
    assert set(kept["contents"]) == {"size", "modified", "sha256"}
    changed = tmp_path / "run_0.4" / "dump_1.npy"
    os.utime(changed)  # a copy
    assert render(path, ensemble).skipped == ("width-0.3", "width-0.4", "width-0.5")
    np.save(changed, blob(0.9))
    with pytest.raises(ValueError, match=r"of width-0\.4: keep these"):
        render(path, ensemble)
    assert render(path, ensemble, existing="skip").rendered == ()
    before = pictures(path)
    assert [m.name for m in render(path, ensemble, existing="replace").rendered] == ["width-0.4"]
    assert [(new == old).all() for new, old in zip(pictures(path), before, strict=True)] == [True, False, True]
    assert render(path, ensemble).rendered == ()
    assert check(path) == []


def test_another_array_or_place_is_another_ensemble(tmp_path: Path) -> None:
    path, ensemble = tmp_path / "a.cdb", write(tmp_path, ".npz")
    render(path, ensemble, shard=(1, 2))
    for array, place in (("other", PLACE), ("f", {"spacing": (0.1, 0.1, 0.2)})):
        table, location = match_files("run_{width}/dump_{}.npz", tmp_path), FieldLocation(**place)  # type: ignore[arg-type]
        other = FileEnsemble.of(table, arrays=(array,), location=location)
        with pytest.raises(ValueError, match=r"source\.(arrays|spacing)"):
            render(path, other, shard=(2, 2))


def test_a_broken_file_costs_its_own_member(tmp_path: Path) -> None:
    ensemble = write(tmp_path)
    broken = tmp_path / "run_0.4" / "dump_1.npy"
    broken.write_bytes(broken.read_bytes()[:400])
    result = render(tmp_path / "a.cdb", ensemble)
    assert list(result.failures) == ["width-0.4"]
    assert "dump_1.npy" in result.failures["width-0.4"]
    np.save(broken, blob(0.4))
    assert len(render(tmp_path / "a.cdb", ensemble).rendered) == 1


def test_a_table_names_members_splits_units_and_bounds(tmp_path: Path) -> None:
    write(tmp_path)
    splits = zip(WIDTHS, ("", "test", "val"), strict=True)
    rows = "".join(f"run_{w}/dump_{i}.npy,{w},{split},m{i},{i}\n" for i, (w, split) in enumerate(splits))
    (tmp_path / "t.csv").write_text(f"file,width [cm],split,name,time\n{rows}")
    table = read_table(tmp_path / "t.csv")
    ensemble = FileEnsemble.of(table, bounds={"width": (0.0, 1.0)})
    assert [(p.name, p.low, p.high, p.unit) for p in ensemble.space.parameters] == [
        ("width", 0.0, 1.0, "cm"),
        ("time", 0.0, 2.0, ""),
    ]
    assert [(m.name, m.split) for m in ensemble.members()] == [("m0", "train"), ("m1", "test"), ("m2", "validation")]
    assert len(pickle.loads(pickle.dumps(ensemble))) == 3
    render(tmp_path / "a.cdb", ensemble)
    assert Catalog.open(tmp_path / "a.cdb").member("m1").provenance["time"] == 1.0


def test_what_the_space_needs_is_asked_for(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "t.csv").write_text("path,a,b\nrun_0.3/dump_0.npy,1,1\nrun_0.4/dump_1.npy,2,1\n")
    table = read_table(tmp_path / "t.csv")
    with pytest.raises(ValueError, match="'b' is 1 in every member: give --bounds b LOW HIGH"):
        FileEnsemble.of(table)
    assert FileEnsemble.of(table.only(["a"])).space.names == ("a",)
    with pytest.raises(ValueError, match=r"--bounds of c"):
        FileEnsemble.of(table, bounds={"c": (0, 1)})
    with pytest.raises(ValueError, match="--units must be of the 2"):
        FileEnsemble.of(table, bounds={"b": (0, 1)}, units=["m"])


APPEARANCE = """
[[appearance]]
kind = "isosurface"
name = "core"
isovalue = 0.5
"""


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        ("{folder}/none.csv", [], "there is no table"),
        ("{folder}/none_{{a}}.npy", [], "no file below"),
        ("{folder}/run_0.3", [], "is not an ensemble: name a table of files"),
        ("{folder}/t.csv", [], "2 files that are absent"),
        ("{folder}/run_{{width}}/dump_{{}}.npy", ["--names", "a"], "--names and --split"),
        ("{folder}/run_{{width}}/dump_{{}}.npy", ["--parameters", "b"], "none of width"),
        ("{folder}/run_{{width}}/dump_{{}}.npy", ["--shard", "two"], "I/N"),
    ],
)
def test_a_wrong_command_is_one_error_and_writes_nothing(
    tmp_path: Path, source: str, options: list[str], message: str
) -> None:
    write(tmp_path)
    (tmp_path / "t.csv").write_text("path,a\nx.npy,1\ny.npy,2\n")
    (tmp_path / "look.toml").write_text(APPEARANCE)
    command = ["ensemble", source.format(folder=tmp_path), "--catalog", str(tmp_path / "a.cdb")]
    result = CliRunner().invoke(main, [*command, "--appearance", str(tmp_path / "look.toml"), *options])
    assert result.exit_code == 1, result.output
    assert message in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert not (tmp_path / "a.cdb").exists()


SCENE = f"""
name = "dumps"
[source]
kind = "files"
path = "t.csv"
SETTINGS
[[parameters]]
name = "width"
low = 0.0
high = 1.0
unit = "cm"
{APPEARANCE}"""


def scene(folder: Path, settings: str) -> Scene:
    rows = "".join(f"run_{w}/dump_{i}.npy,{w},any\n" for i, w in enumerate(WIDTHS))
    (folder / "t.csv").write_text(f"path,width,note\n{rows}")
    (folder / "scene.toml").write_text(SCENE.replace("SETTINGS", settings))
    return Scene.load(folder / "scene.toml")


def test_a_scene_may_name_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path))
    write(tmp_path)
    found = ensemble_of(scene(tmp_path, "spacing = [0.1, 0.1, 0.2]"))
    assert str(found.space) == "width in [0, 1] cm"
    (member, *_) = found.members
    assert found.source.field(member, lambda fraction: None).spacing == (0.1, 0.1, 0.2)
    with pytest.raises(ValueError, match=r"source\.dims must be a list of three axes, got 'zyx'"):
        ensemble_of(scene(tmp_path, 'dims = "zyx"'))


@pytest.mark.slow
def test_the_command_renders_what_a_pattern_names(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "look.toml").write_text(APPEARANCE)
    command = [
        "ensemble",
        f"{tmp_path}/run_{{width}}/dump_{{}}.npy",
        "--catalog",
        str(tmp_path / "a.cdb"),
        "--size",
        "8",
    ]
    command += ["--appearance", str(tmp_path / "look.toml"), "--spacing", "0.1", "0.1", "0.1", "--workers", "1"]
    result = CliRunner().invoke(main, [*command, "--bounds", "width", "0", "1", "--units", "cm"])
    assert result.exit_code == 0, result.output
    assert "3 members rendered" in result.output
    (width,) = Catalog.open(tmp_path / "a.cdb").plan.space.parameters
    assert (width.low, width.high, width.unit) == (0.0, 1.0, "cm")


def test_members_whose_names_would_be_alike_are_refused(tmp_path: Path) -> None:
    write(tmp_path)
    paths = sorted(tmp_path.rglob("*.npy"))[:2]
    (tmp_path / "t.csv").write_text(f"path,Re,name\n{paths[0]},1,Re-2.0\n{paths[1]},2,\n")
    with pytest.raises(ValueError, match=r"would both be called Re-2\.0"):
        FileEnsemble.of(read_table(tmp_path / "t.csv"))


@pytest.mark.slow
def test_members_stored_under_another_name_are_there_already(tmp_path: Path) -> None:
    write(tmp_path)
    paths = sorted(tmp_path.rglob("*.npy"))[:3]
    named = "".join(f"{path},{i},first-{i}\n" for i, path in enumerate(paths[:2]))
    others = "".join(f"{path},{i},\n" for i, path in enumerate(paths))
    how = ["--catalog", str(tmp_path / "a.cdb"), "--bounds", "Re", "0", "2", "--workers", "1"]
    (tmp_path / "look.toml").write_text(APPEARANCE)
    for rows, added in ((named, ["--size", "8", "--appearance", str(tmp_path / "look.toml")]), (others, [])):
        (tmp_path / "t.csv").write_text("path,Re,name\n" + rows)
        done = CliRunner().invoke(main, ["ensemble", str(tmp_path / "t.csv"), *how, *added])
        assert done.exit_code == 0, done.output
    assert "2 were there already" in done.output
    made = Catalog.open(tmp_path / "a.cdb")
    assert ([m.name for m in made.members], made.missing) == (["Re-2.0", "first-0", "first-1"], ())
