"""Fixtures that every room shares."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections import defaultdict
from pathlib import Path

import hypothesis
import pytest

pytest_plugins = [
    "tests.support.browsers",
    "tests.support.hangs",
    "tests.support.installed",
    "tests.support.stored_ensembles",
]

PROJECT = Path(__file__).resolve().parent.parent

# No example fails for being slow: machines are shared.
hypothesis.settings.register_profile("any machine", deadline=None)
hypothesis.settings.load_profile("any machine")

# A shell that starts the tests in the background lets them inherit "ignore Ctrl-C"; some of them press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure() -> None:
    """Look for no garbage while the tests are imported: it takes a third of that time, and next to all of it stays."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.enable()
    gc.freeze()


SECONDS, SLOW_SECONDS = 0.05, 1.0  # that a test takes, and a slow one that does not say: `slow(seconds=30)`


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put files that take long before the others where several processes share them, so that all end at about one time."""
    if not hasattr(config, "workerinput"):
        return
    lasting: dict[Path, float] = defaultdict(float)
    for item in items:
        slow = item.get_closest_marker("slow")
        lasting[item.path] += slow.kwargs.get("seconds", SLOW_SECONDS) if slow else SECONDS
    items.sort(key=lambda item: (-lasting[item.path], item.path))


@pytest.fixture(autouse=True)
def seeded() -> None:
    """Random numbers of torch's own generator do not depend on earlier tests."""
    if torch := sys.modules.get("torch"):
        # For devices that are not in use torch.manual_seed formats the stack, which takes 2 ms.
        (torch if torch.cuda.is_initialized() else torch.default_generator).manual_seed(0)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data that is not part of the project; the test skips where it is absent."""
    folder = Path(os.environ.get("GS_SURROGATE_DATA", PROJECT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}: set GS_SURROGATE_DATA to the folder that holds it")
    return folder
