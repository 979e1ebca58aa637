"""Ends a process of tests that hangs, and says where: the stack of each of its threads goes to the error stream.

A thread of C that needs no Python ends it, so that a hang in compiled code counts as well.  An exception in the thread that
waits would not do: it is lost where a `finally`, a fixture or a second run waits again.

xdist puts another process in its place, which runs the test again and then the rest.  The test failed, even if it passes
then.  The signal USR2 prints the same stacks and ends nothing, see `.ci/run`.
"""

from __future__ import annotations

import faulthandler
import os
import signal

import pytest

SECONDS = 300.0  # for a test, and for making or ending its fixtures: `@pytest.mark.timeout(600)` says otherwise
END_SECONDS = 120.0  # for what follows the last test
ERRORS = pytest.StashKey[int]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ERRORS] = os.dup(2)  # not captured now, but in tests; open until the process has ended
    faulthandler.register(signal.SIGUSR2, file=config.stash[ERRORS])


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    _limit(item)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    _limit(item)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    _limit(item)


def pytest_runtest_logfinish() -> None:
    faulthandler.cancel_dump_traceback_later()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    _end_within(END_SECONDS, session.config)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """The interpreter ends now, or, in a process of xdist's, waits for the others: xdist ends it."""
    if hasattr(config, "workerinput"):
        faulthandler.cancel_dump_traceback_later()
    else:
        _end_within(END_SECONDS, config)


def _limit(item: pytest.Item) -> None:
    marker = item.get_closest_marker("timeout")
    _end_within(marker.args[0] if marker else SECONDS, item.config)


def _end_within(seconds: float, config: pytest.Config) -> None:
    faulthandler.dump_traceback_later(seconds, file=config.stash[ERRORS], exit=True)
