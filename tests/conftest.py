"""Fixtures that every room shares."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import hypothesis
import pytest

pytest_plugins = ["tests.support.browsers"]

PROJECT = Path(__file__).resolve().parent.parent

# No example fails for being slow: machines are shared.
hypothesis.settings.register_profile("any machine", deadline=None)
hypothesis.settings.load_profile("any machine")

# A shell that starts the tests in the background lets them inherit "ignore Ctrl-C"; some of them press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data that is not part of the project; the test skips where it is absent."""
    folder = Path(os.environ.get("GS_SURROGATE_DATA", PROJECT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}: set GS_SURROGATE_DATA to the folder that holds it")
    return folder
