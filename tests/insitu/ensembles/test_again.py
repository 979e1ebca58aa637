"""`insitu ensemble` again, with what its first call was given left out."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from catalogs.store.catalog import Catalog
from insitu.cli import main
from tests.support.looks import LOOK

pytestmark = pytest.mark.usefixtures("prepared_workers")


def ensemble(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["ensemble", *arguments, "--workers", "1"])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Six members, of which the last can't be read, and their table."""
    monkeypatch.chdir(tmp_path)
    for i in range(6):
        np.save(f"m{i}.npy", np.random.default_rng(i).random((6, 7, 8)).astype("f4"))
    Path("m5.npy").write_text("broken")
    Path("all.csv").write_text("path,Re [m]\n" + "".join(f"m{i}.npy,{i}\n" for i in range(6)))
    Path("one.csv").write_text("path,Re\nm3.npy,3\n")
    Path("look.toml").write_text(LOOK)
    return tmp_path


@pytest.mark.slow
def test_what_is_left_out_is_as_in_the_catalog(folder: Path) -> None:
    how = "--spacing 1 2 1 --origin 0 0 3 --dims y,z,x --bounds Re -1 9 --validation 2 --size 8 --appearance look.toml"
    first = ensemble("all.csv", "--catalog", "c.cdb", *how.split())
    assert "1 member failed; the same command tries it again" in first.output
    made = Catalog.open("c.cdb")
    assert [m.name for m in made.missing] == ["Re-5.0"]
    assert made.missing[0].parameters == {"Re": 5.0}
    np.save("m5.npy", np.random.default_rng(5).random((6, 7, 8)).astype("f4"))
    again = ensemble("all.csv", "--catalog", "c.cdb")
    assert again.exit_code == 0, again.output
    assert "5 were there already" in again.output
    assert ensemble("one.csv", "--catalog", "c.cdb").exit_code == 0
    assert Catalog.open("c.cdb").missing == ()
    boxes = {str(m.provenance["bounds"]) for m in Catalog.open("c.cdb").members}
    assert boxes == {"[[0.0, 0.0, 3.0], [7.0, 10.0, 9.0]]"}
    other = ensemble("all.csv", "--catalog", "c.cdb", "--spacing", "1", "1", "1")
    assert "source.spacing" in other.output


@pytest.mark.slow
def test_a_first_file_that_can_not_be_read_is_passed_over_where_looks_are_suggested(folder: Path) -> None:
    Path("m0.npy").write_text("broken")
    np.save("m5.npy", np.random.default_rng(5).random((6, 7, 8)).astype("f4"))
    done = ensemble("all.csv", "--catalog", "c.cdb", "--spacing", "1", "1", "1", "--size", "8")
    assert "passed over: m0.npy" in done.output
    assert len(Catalog.open("c.cdb").members) == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--catalog c.cdb --target-decibels 1e9", "target_decibels must lie between 0 and 58"),
        ("--catalog c", "a folder whose name ends with .cdb"),
        ("--catalog one.csv/c.cdb", "Not a directory"),
    ],
)
def test_options_are_checked_before_a_field_is_read(folder: Path, arguments: str, message: str) -> None:
    done = ensemble("all.csv", *arguments.split())
    assert message in done.output
    assert "reading" not in done.output


def test_what_may_be_forgotten_is_said_once(folder: Path) -> None:
    done = ensemble(
        "all.csv", "--catalog", "c.cdb", "--shard", "9/9", "--appearance", "look.toml", "--bounds", "Re", "1e3", "1e4"
    )
    assert done.output.count("the first field states no spacing") == 1
    assert done.output.count("all members lie outside the bounds [1000, 10000] of Re") == 1


@pytest.mark.slow
def test_a_rerun_may_name_what_was_chosen_anyway_and_leave_out_what_was_named(folder: Path) -> None:
    for i in range(4):
        values = np.random.default_rng(i).random((6, 7, 8)).astype("f4")
        values[0, 0, 0] = np.nan
        np.savez(f"r{i}.npz", q=values)
    Path("all.csv").write_text("path,Re,seed\n" + "".join(f"r{i}.npz,{i},{i % 2}\n" for i in range(4)))
    how = ["all.csv", "--catalog", "c.cdb"]
    named = ["--parameters", "Re", "--nan", "transparent", "--size", "8", "--appearance", "look.toml"]
    whole = Path("r3.npz").read_bytes()
    Path("r3.npz").write_text("broken")
    assert "1 member failed" in ensemble(*how, *named).output
    again = ensemble(*how, "--array", "q")
    assert "3 were there already" in again.output, again.output
    Path("r3.npz").write_bytes(whole)
    last = ensemble(*how)
    assert last.exit_code == 0, last.output
    assert {tuple(m.parameters) for m in Catalog.open("c.cdb").members} == {("Re",)}
    assert "dims" in ensemble(*how, "--dims", "x,y,z").output
