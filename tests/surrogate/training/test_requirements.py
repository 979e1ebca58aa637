"""Commands refuse at their start what could only fail at their end."""

import builtins
import errno
import shutil
import tempfile
from collections import namedtuple
from pathlib import Path
from typing import Any

import psutil
import pytest
from click.testing import CliRunner

from catalogs.files import durable
from surrogate.cli import main
from surrogate.settings import TrainingSettings
from surrogate.training import requirements
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from surrogate.training.requirements import require_possible
from surrogate.training.source import Source
from tests.support.blobs import Blobs, stored
from tests.support.results import make_catalog

BLOBS = Blobs(count=3, size=16)
Memory = namedtuple("Memory", "available free")
Disk = namedtuple("Disk", "free")


def test_a_model_or_images_too_large_for_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    catalog = stored(tmp_path / "a.cdb", BLOBS)
    options = TrainingOptions(Budget(steps=20), settings={"gaussians": 2_000_000_000})
    with pytest.raises(ValueError, match=r"2,000,000,000 Gaussians .* GB; take fewer Gaussians \(gaussians=N\)"):
        begin(catalog.path, tmp_path / "run", options)
    assert not (tmp_path / "run").exists()
    source = Source(TrainingSettings(gaussians=10), catalog)
    images = 3 * 10 * 16 * 16 * 4  # members, training views, pixels, channels
    monkeypatch.setattr(psutil, "swap_memory", lambda: Memory(0, 0))
    gaussians = 10 * (23 + source.settings.latent_size) * 4 * 7
    for free, fits in ((images + gaussians - 1, False), (images + gaussians, True)):
        monkeypatch.setattr(psutil, "virtual_memory", lambda free=free: Memory(free, free))
        if fits:
            require_possible(source, tmp_path)
        else:
            with pytest.raises(ValueError, match=r"GB of memory, and .* GB are free: the images take"):
                require_possible(source, tmp_path)


def test_images_that_are_read_when_used_take_no_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = Source(TrainingSettings(gaussians=10), stored(tmp_path / "a.cdb", BLOBS))
    free = 10 * (23 + source.settings.latent_size) * 4 * 7 + 1000
    monkeypatch.setattr(psutil, "swap_memory", lambda: Memory(0, 0))
    monkeypatch.setattr(psutil, "virtual_memory", lambda: Memory(free, free))
    with pytest.raises(ValueError, match="GB are free"):
        require_possible(source, tmp_path)
    monkeypatch.setattr(requirements, "MEMORY", 1000)
    require_possible(source, tmp_path)


def test_a_disk_too_full_for_checkpoints_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    catalog = stored(tmp_path / "a.cdb", BLOBS)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Disk(1000))
    with pytest.raises(ValueError, match=r"the checkpoints of .* Gaussians need .* left: make room"):
        begin(catalog.path, tmp_path / "deep" / "run", TrainingOptions(Budget(steps=20)))
    assert not (tmp_path / "deep").exists()


def test_members_too_far_outside_the_bounds_are_refused(tmp_path: Path) -> None:
    catalog = stored(tmp_path / "a.cdb", BLOBS, members=(("train", 0.0), ("train", 1.0), ("test", 1.9)))
    require_possible(Source(TrainingSettings(), catalog), tmp_path)
    far = stored(tmp_path / "b.cdb", BLOBS, members=(("train", 0.0), ("train", 1.0), ("test", 2.5)))
    with pytest.raises(ValueError, match=r"member .*: p = 2\.5 lies too far outside .*: render the ensemble anew"):
        require_possible(Source(TrainingSettings(), far), tmp_path)


def test_a_report_and_pictures_that_can_not_be_written_are_refused_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.move(make_catalog(tmp_path, "flow").path, "flow.cdb")
    trained = CliRunner().invoke(main, ["train", "flow.cdb", "--steps", "8", "gaussians=20"])
    assert trained.exit_code == 0, trained.output

    def read_only(**_: Any) -> Any:
        raise OSError(errno.EROFS, "Read-only file system")

    def late(*_: Any, **__: Any) -> Any:
        raise AssertionError("too late")

    monkeypatch.setattr("surrogate.evaluation.evaluate.evaluate", late)
    monkeypatch.setattr("surrogate.explore.exporting.sweep.pictures", late)
    with monkeypatch.context() as patched:
        patched.setattr(tempfile, "TemporaryDirectory", read_only)
        for words in (["evaluate", "runs/flow"], ["sweep", "runs/flow", "--over", "p", "-o", "a.png"]):
            result = CliRunner().invoke(main, words)
            assert result.exit_code == 1
            assert "Read-only file system: nothing can be written there" in result.output

    importing = builtins.__import__

    def without(name: str, *more: Any) -> Any:
        if name.startswith("matplotlib"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return importing(name, *more)

    with monkeypatch.context() as patched:
        patched.setattr(builtins, "__import__", without)
        patched.setattr("surrogate.report.commands.import_module", without)
        result = CliRunner().invoke(main, ["evaluate", "runs/flow"])
    assert result.exit_code == 1
    assert "needs the package matplotlib: pip install 'gs-surrogate[surrogate]'" in result.output


def test_a_writable_folder_is_left_as_it_was(tmp_path: Path) -> None:
    durable.require_writable(tmp_path / "new" / "folder")
    assert list(tmp_path.iterdir()) == []
