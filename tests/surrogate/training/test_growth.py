"""A finished run goes on from its model with members that came later."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from click.testing import CliRunner

from catalogs.files import durable
from catalogs.store.catalog import Catalog
from surrogate.cli import main
from surrogate.model import Surrogate
from surrogate.storage.checkpoints import CHECKPOINT, Checkpoint
from surrogate.storage.runs import RECORD, RunFolder, RunRecord
from surrogate.training.begin import calmer
from surrogate.training.growth import GROWING, begin_growing, growing, keep_start, take_place
from surrogate.training.run import train
from surrogate.training.session import TrainingProgress
from tests.support.results import make_catalog

pytestmark = pytest.mark.slow

WORDS = ("gaussians=20", "--steps", "12", "--seed", "1")


def add(catalog: Catalog, name: str, p: float) -> None:
    with catalog.begin_member(name, {"p": p}) as writer:
        for view, _ in enumerate(catalog.plan.cameras):
            writer.write_image("drawn", view, catalog.image("train-0", "drawn", view))


def command(*words: object, code: int = 0) -> str:
    result = CliRunner().invoke(main, ["train", *map(str, words)])
    assert result.exit_code == code, result.output
    return result.output


def fingerprints(run: Path) -> tuple[str, object]:
    """Those of the record and of the model."""
    opened = RunFolder.open(run)
    assert opened.record is not None
    return opened.record.fingerprint, Surrogate.load(opened.model).training["fingerprint"]


def splits(run: Path) -> dict[str, str]:
    record = RunRecord.load(run)
    assert record is not None
    assert record.splits is not None
    return dict(record.splits.members)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the finished run `mine` of a catalog that has two members more since."""
    root = tmp_path_factory.mktemp("finished")
    catalog = make_catalog(root, "flow")
    command(catalog.path, "-o", root / "mine", *WORDS)
    add(catalog, "late", 0.3)
    add(catalog, "later", 0.4)
    return root


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished run, beside one of its catalog."""
    return shutil.copytree(finished, tmp_path / "copy") / "mine"


def grown(run: Path) -> RunFolder:
    """The training of the later members, finished, but not in the run's place."""
    before = RunFolder.open(run)
    inner = begin_growing(before)
    assert inner is not None
    keep_start(before, inner)
    train(inner.settings, inner.catalog, inner.model)
    return inner


def test_later_members_are_taken_in_and_training_goes_on(run: Path) -> None:
    old, members = Surrogate.load(run / "surrogate"), splits(run)
    said = command(run, "--new-members")
    assert "goes on from its model with 2 later members, 6 steps" in said
    assert f"-> {run / 'surrogate'}" in said
    assert splits(run) == {**members, "late": "train", "later": "train"}
    new = Surrogate.load(run / "surrogate")
    assert (old.training["steps"], new.training["steps"]) == (12, 18)
    assert new.training["seconds"] > old.training["seconds"]
    assert not (run / GROWING).exists()
    assert "nothing to do" in command(run, "--new-members")
    catalog = RunFolder.open(run).catalog
    assert len(catalog.members) == 6
    assert "nothing to do" in command(catalog.path, "-o", run, *WORDS)
    add(catalog, "last", 0.6)
    assert "goes on from its model with 1 later member, 3 steps" in command(run, "--new-members")  # of 12 once more
    assert Surrogate.load(run / "surrogate").training["steps"] == 21


def test_the_first_checkpoint_is_the_finished_model(run: Path) -> None:
    before = RunFolder.open(run)
    inner = begin_growing(before)
    assert inner is not None
    keep_start(before, inner)
    checkpoint, old = Checkpoint.load(inner.model), Surrogate.load(before.model)
    assert checkpoint is not None
    for name, tensor in old.gaussians.tensors().items():
        assert torch.equal(checkpoint.tensors[f"fitted.gaussians.{name}"], tensor)
    assert fingerprints(run)[0] == fingerprints(run)[1]  # the run is as it was
    calm = calmer(inner)  # as where it diverged
    assert calm is not None
    assert not (inner.model / CHECKPOINT).exists()
    assert (calm.settings.deformation_steps, calm.settings.latent_rate) == (6, inner.settings.latent_rate / 2.0)


class Stopped(Exception):
    """A process that ends at once."""


def test_an_interrupted_training_goes_on_as_if_it_were_not(run: Path, tmp_path: Path) -> None:
    other = shutil.copytree(run.parent, tmp_path / "other") / "mine"
    command(other, "--new-members")
    before = RunFolder.open(run)
    inner = begin_growing(before)
    assert inner is not None
    keep_start(before, inner)

    def stop(progress: TrainingProgress) -> None:
        if progress.stage == "compression":
            raise Stopped

    with pytest.raises(Stopped):
        train(inner.settings, inner.catalog, inner.model, progress=stop)
    assert fingerprints(run) == fingerprints(shutil.copytree(run, tmp_path / "before"))
    said = command(run)  # without the option: the training that was begun is the one that is not finished
    assert "goes on from its model with 2 later members" in said
    assert Surrogate.load(run / "surrogate").digest == Surrogate.load(other / "surrogate").digest or _alike(run, other)


def _alike(run: Path, other: Path) -> bool:
    """Equal but for the times that training took."""
    first, second = (Surrogate.load(folder / "surrogate") for folder in (run, other))
    return all(torch.equal(t, second.gaussians.tensors()[n]) for n, t in first.gaussians.tensors().items())


def killed_at(number: int, monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...]) -> None:
    """Let the process end before the call of this number of some functions of `durable`."""
    calls = itertools.count()

    def ending(function: Callable[..., object]) -> Callable[..., object]:
        def called(*arguments: object) -> object:
            if next(calls) == number:
                raise Stopped
            return function(*arguments)

        return called

    for name in names:
        monkeypatch.setattr(durable, name, ending(getattr(durable, name)))


@pytest.mark.parametrize("exchanging", [True, False])
def test_a_kill_while_it_takes_the_place_loses_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exchanging: bool
) -> None:
    grown(run)
    old, new = fingerprints(run)[1], Surrogate.load(run / GROWING / "surrogate").training["fingerprint"]
    if not exchanging:
        monkeypatch.setattr(durable, "exchange", lambda *_: (_ for _ in ()).throw(OSError(22, "unsupported")))
    for number in range(20):
        copy = shutil.copytree(run.parent, tmp_path / f"{number}") / "mine"
        before = RunFolder.open(copy)
        inner = growing(before)
        assert inner is not None
        with monkeypatch.context() as patch:
            killed_at(number, patch, ("exchange", "rename", "sync", "write"))
            try:
                take_place(before, inner)
                break
            except Stopped:
                pass
        if Surrogate.exists(copy / "surrogate"):
            assert Surrogate.load(copy / "surrogate").training["fingerprint"] in (old, new)
        else:
            assert not exchanging
        command(copy)
        assert fingerprints(copy) == (new, new)
        assert not (copy / GROWING).exists()
        assert sorted(path.name for path in copy.iterdir() if not path.name.startswith(".")) == [RECORD, "surrogate"]
    assert number > 4
    assert fingerprints(copy) == (new, new)


def test_a_catalog_that_moves_meanwhile_is_found_again(run: Path, tmp_path: Path) -> None:
    grown(run)
    catalog = RunFolder.open(run).catalog_path
    moved = tmp_path / "elsewhere" / catalog.name
    moved.parent.mkdir()
    catalog.rename(moved)
    command(moved, "-o", run, *WORDS)
    assert RunFolder.open(run).catalog_path.samefile(moved)
    assert "late" in splits(run)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("{catalog}", "-o", "{run}", "--new-members"), "--new-members: for the folder of a run only"),
        (("{scene}", "--new-members"), "is the run of a scene"),
        (("{unfinished}", "--new-members"), "can't take members in before it is finished: `surrogate train"),
        (("{changed}", "--new-members"), "can't go on, for appearance differ from those of"),
        (("{run}", "--new-members", "--model", "field"), "leave --model field out"),
    ],
)
def test_what_can_t_go_on_is_refused_with_the_remedy(
    run: Path, tmp_path: Path, words: tuple[str, ...], said: str
) -> None:
    record, names = RunRecord.load(run), ("scene", "unfinished", "changed")
    assert record is not None
    places = {name: shutil.copytree(run, run.with_name(name)) for name in names}
    replace(record, asked={}).save(places["scene"])
    (places["unfinished"] / "surrogate" / "model.json").unlink()
    model = places["changed"] / "surrogate" / "model.json"
    model.write_text(model.read_text().replace('"appearance": "drawn"', '"appearance": "other"'))
    places |= {"run": run, "catalog": RunFolder.open(run).catalog_path}
    before = sorted(run.parent.rglob("*"))
    assert said in command(*(word.format(**places) for word in words), code=1)
    assert sorted(p for p in run.parent.rglob("*") if p.name != ".lock") == [p for p in before if p.name != ".lock"]
