"""Which members test a surrogate where members are dumps of runs, as the commands and the report say it."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import surrogate.storage.runs
from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.splits import choose_splits
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.cli import main
from tests.support.blobs import Blobs

BLOBS = Blobs(count=3, size=12)
VIEWS = ("train", "train", "test")
SMALL = ("gaussians=20", "--steps", "8", "--hold-out", "0.2")


def call(*words: object) -> str:
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


def catalog_of(path: Path, runs: int, dumps: int) -> Path:
    """A catalog of some runs over `p`, each with dumps over `time`, whose pictures follow both."""
    cameras = BLOBS.cameras()[: len(VIEWS)]
    space = ParameterSpace((Parameter("p", 0.0, 1.0), Parameter("time", 0.0, 1.0)))
    catalog = Catalog.create(path, CatalogPlan(space, (ImportedImages("drawn"),), cameras, VIEWS, BLOBS.bounds))
    for run in range(runs):
        for dump in range(dumps):
            p, time = run / max(1, runs - 1), dump / max(1, dumps - 1)
            with catalog.begin_member(f"run{run}-{dump}", {"p": p, "time": time}) as writer:
                for view, camera in enumerate(cameras):
                    writer.write_image("drawn", view, BLOBS.picture((p + time) / 2.0, camera))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("runs", "dumps", "said"),
    [
        (5, 3, "no test member shares a run with a training member: 1 of 5 whole runs test"),
        (
            1,
            6,
            "all members are dumps of one run (only time differs), so dumps of it test: nothing is known of other runs",
        ),
    ],
    ids=["runs", "one run"],
)
def test_commands_and_report_say_who_tests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runs: int, dumps: int, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    catalog_of(Path("flow.cdb"), runs, dumps)
    assert call("train", "flow.cdb", *SMALL).count(said) == 1
    for again in (("train", "flow.cdb"), ("evaluate", "runs/flow"), ("evaluate", "runs/flow"), ("show", "runs/flow")):
        assert call(*again).count(said) == 1
    record = json.loads(Path("runs/flow/report/report.json").read_text())
    assert record["ensemble"]["tests"] == said
    assert said[1:] in Path("runs/flow/report/report.md").read_text()


@pytest.mark.slow
def test_runs_of_which_dumps_were_held_out_go_on_and_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    catalog_of(Path("flow.cdb"), 7, 3)
    scene = Path("old.toml")
    scene.write_text(
        'name = "old"\n[source]\nkind = "catalog"\npath = "flow.cdb"\nhold_out = 0.2\n'
        "[training]\ngaussians = 20\ncanonical_steps = 2\ndeformation_steps = 6\n"
    )

    def by_dumps(*given: object, **how: object) -> object:
        return choose_splits(*given, **{**how, "whole_runs": False})  # type: ignore[arg-type]

    with monkeypatch.context() as earlier:
        earlier.setattr(surrogate.storage.runs, "choose_splits", by_dumps)
        call("train", "flow.cdb", *SMALL)
        call("train", scene)
    said = "4 of 4 test members share a run with a training member (only time differs), so their scores flatter"
    for words in (("train", "flow.cdb", *SMALL), ("train", "runs/flow"), ("train", scene)):
        answer = call(*words)
        assert said in answer
        assert "nothing to do" in answer
    assert said not in call("train", "flow.cdb", *SMALL, "-o", "runs/new")


def test_two_runs_are_too_few_to_keep_one_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    catalog_of(Path("flow.cdb"), 2, 4)
    answer = call("train", "flow.cdb", *SMALL)
    assert "the members are dumps of 2 runs, too few to keep one aside" in answer
    assert "in a new run" not in answer
