"""Studies that are interrupted, killed, or conducted by several processes."""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from research.studies.ablation import study as module
from research.studies.ablation.study import LOCK, AblationStudy
from research.studies.ablation.variants import Variant
from research.studies.progress import StudyProgress
from surrogate.storage.checkpoints import locked
from tests.research.support.ablations import BUDGET, names

pytestmark = pytest.mark.usefixtures("given_step_times")


@pytest.mark.slow
def test_an_interruption_in_a_fit_loses_that_fit_only(conduct, catalog: Catalog, tmp_path: Path) -> None:
    pressed = []

    def press(progress: StudyProgress) -> None:
        if progress.name == "no-relocation, seed 0" and "speed" not in progress.work and not pressed:
            pressed.append(str(progress))
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        conduct(only=["joint", "no-relocation"], progress=press)
    assert pressed[0].startswith("no-relocation, seed 0 (2 / 3)  ")
    assert " left  " in pressed[0]
    assert pressed[0].endswith(" in all")
    assert sorted(path.name for path in tmp_path.glob("*.json")) == ["default.seed0.json"]
    assert not list(tmp_path.glob("fits/*/surrogate"))
    assert names(conduct(only=["joint", "no-relocation"])) == [("no-relocation", 0), ("joint", 0)]


def test_what_another_process_is_fitting_is_left_to_it(conduct, at_once, tmp_path: Path) -> None:
    taken = tmp_path / "fits" / "joint.seed0"
    taken.mkdir(parents=True)
    with locked(taken):
        assert names(conduct(only=["joint", "no-relocation"])) == [("default", 0), ("no-relocation", 0)]
    assert names(conduct(only=["joint", "no-relocation"])) == [("joint", 0)]


def test_what_another_process_finished_meanwhile_is_not_fitted_again(
    conduct, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    conduct(only=["default"])
    whole = (tmp_path / "default.seed0.json").read_bytes()
    (tmp_path / "default.seed0.json").unlink()
    monkeypatch.setattr(
        module, "locked", lambda folder: ((tmp_path / "default.seed0.json").write_bytes(whole), locked(folder))[1]
    )
    assert conduct(only=["default"]) == []


def fitted_after(event: Callable[[str], None]) -> Callable[..., dict]:
    """In place of `AblationStudy._fit`: `event` gets the name of the fitted variant."""

    def fit(study: AblationStudy, variant: Variant, *_: object) -> dict:
        event(variant.name)
        return {"deformation_steps": 10, "psnr": 20.0, "ssim": 0.5, "images": 1, "seconds": BUDGET}

    return fit


def test_what_a_killed_process_was_fitting_is_taken_over_in_the_end(
    conduct, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = tmp_path / "fits" / "no-relocation.seed0"
    (taken / "surrogate").mkdir(parents=True)  # what it leaves
    with contextlib.ExitStack() as other:
        other.enter_context(locked(taken))
        killed = fitted_after(lambda name: other.close() if name == "joint" else None)
        monkeypatch.setattr(module.AblationStudy, "_fit", killed)
        assert names(conduct(only=["joint", "no-relocation"])) == [("default", 0), ("joint", 0), ("no-relocation", 0)]
    assert not (taken / "surrogate").exists()


@pytest.mark.parametrize("finishes", [True, False])
def test_what_takes_the_steps_of_a_fit_under_way_waits_for_it_or_is_left_too(
    conduct, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, finishes: bool
) -> None:
    monkeypatch.setattr(module.AblationStudy, "_fit", fitted_after(lambda _: None))
    conduct(only=["samples-2"])
    whole = (tmp_path / "samples-2.seed0.json").read_bytes()
    (tmp_path / "samples-2.seed0.json").unlink()
    with contextlib.ExitStack() as other:
        other.enter_context(locked(tmp_path / "fits" / "samples-2.seed0"))

        def event(name: str) -> None:
            if finishes and name == "no-relocation":
                (tmp_path / "samples-2.seed0.json").write_bytes(whole)
                other.close()

        monkeypatch.setattr(module.AblationStudy, "_fit", fitted_after(event))
        now = [("no-relocation", 0), ("default-in-samples-2-steps", 0)]
        assert names(conduct(only=["no-relocation", "default-in-samples-2-steps"])) == (now if finishes else now[:1])
    assert "no result" not in (tmp_path / "ablation.md").read_text()


def test_what_fails_is_tried_again_by_one_process_of_several_that_began_together(
    conduct, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries: list[str] = []

    def fails(name: str) -> None:
        tries.append(name)
        if name == "no-relocation" and tries.count("no-relocation") == 2:
            conduct(only=["joint"])  # another process, whose list has come to what follows
        if name == "joint":
            raise ValueError("it never works")

    monkeypatch.setattr(module.AblationStudy, "_fit", fitted_after(fails))
    conduct(only=["no-relocation", "joint"])
    (tmp_path / "no-relocation.seed0.json").unlink()
    conduct(only=["no-relocation", "joint"])
    assert tries == ["default", "no-relocation", "joint", "no-relocation", "joint"]


def test_a_late_result_stays_where_its_repetition_fails(
    conduct, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    conduct(only=["default"])
    before = (tmp_path / "default.seed0.json").read_bytes()

    def fails(_: str) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr(module.AblationStudy, "_fit", fitted_after(fails))
    (failed,) = conduct(only=["default"], again=True)
    assert failed.error == "MemoryError: no room"
    assert (tmp_path / "default.seed0.json").read_bytes() == before


def test_pages_are_written_one_after_the_other_and_leftovers_go(
    conduct, at_once, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dead = subprocess.run(
        [
            sys.executable,
            "-c",
            "import pathlib, sys; from catalogs.files import durable; "
            "path = durable.partial_name(pathlib.Path(sys.argv[1])); path.write_text('half'); print(path)",
            str(tmp_path / "default.seed0.json"),
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    assert Path(dead).exists()
    held: list[bool] = []

    def write(*_: object) -> None:
        try:
            with (tmp_path / LOCK).open("w") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held.append(False)
        except BlockingIOError:
            held.append(True)

    monkeypatch.setattr("research.studies.ablation.table.write", write)
    conduct(only=["default"])
    assert held == [True, True]
    assert not Path(dead).exists()
