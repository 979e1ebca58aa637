"""Training that is stopped before its end, and what a run ends with however often it was."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from surrogate import TrainingSettings, train
from surrogate.training.session import TrainingProgress
from tests.support import prepared

# Forked before any thread exists, so that each of the many short lives imports nothing anew; killed after a time of the
# processor, not of a clock, so that a life comes as far on a loaded machine.
KILLED = """
import json, os, random, signal, sys
from catalogs.store.catalog import Catalog
from surrogate import Surrogate, TrainingSettings, train
settings, catalog, folder = TrainingSettings.from_table(json.loads(sys.argv[1])), sys.argv[2], sys.argv[3]
random.seed(1)
kills = 0
while not Surrogate.exists(folder):
    seconds = random.uniform(0.001, 0.03 + 0.015 * kills)
    child = os.fork()
    if not child:
        signal.setitimer(signal.ITIMER_PROF, seconds)
        train(settings, Catalog.open(catalog), folder)
        os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in (0, -signal.SIGPROF), status
    kills += status != 0
print(kills)
"""


def outcome(folder: Path) -> tuple[bytes, list[dict], list[tuple]]:
    """Everything that a run ends with, but for the time it took."""
    training = json.loads((folder / "model.json").read_text())["training"]
    curve = [{**point, "seconds": None, "processor_seconds": None} for point in training["curve"]]
    choices = [(choice["name"], choice["kept"], choice["options"]) for choice in training["choices"]]
    return (folder / "model.safetensors").read_bytes(), curve, choices


def files(folder: Path) -> list[str]:
    """The names of what is kept there."""
    return sorted(path.name for path in folder.glob("[!.]*"))


def interrupt(
    when: Callable[[TrainingProgress], bool], settings: TrainingSettings, catalog: Catalog, folder: Path
) -> None:
    """Train in this process until the moment has come, then press Ctrl-C."""
    pressed = []

    def press(progress: TrainingProgress) -> None:
        if when(progress) and not pressed:
            pressed.append(os.kill(os.getpid(), signal.SIGINT))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("surrogate.training.session.REPORT_SECONDS", 0.0)
        with pytest.raises(KeyboardInterrupt):
            train(settings, catalog, folder, progress=press)


def kill_again_and_again(settings: TrainingSettings, catalog: Catalog, folder: Path) -> int:
    """Train in processes that are killed at random until one comes to the end; returns how many were."""
    status, out, errors = prepared.run(KILLED, json.dumps(settings.to_json()), catalog.path, folder, timeout=250.0)
    assert status == 0, errors
    return int(out)
