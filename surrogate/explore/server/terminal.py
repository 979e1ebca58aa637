"""The explorer from a terminal: served until Ctrl-C."""

from __future__ import annotations

import asyncio
import errno
import signal
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from catalogs.web.access import LOCAL
from surrogate.explore.run import Run
from surrogate.explore.server.explorer import Explorer


def explore(
    run: Run,
    *,
    host: str = LOCAL,
    port: int | None = None,
    base_url: str = "",
    open_page: bool = False,
    announce: Callable[[str], Any] = print,
) -> None:
    """Show a run until Ctrl-C, after announcing its address.  Raises OSError where no server can listen there.

    Without a `port` it is one of the run's own, see `Explorer.serve`.

    With Jupyter's `base_url` the address is a path below that of Jupyter, whose jupyter-server-proxy passes it on.
    """
    explorer = Explorer(run, host=host, base_url=base_url)

    def ready(address: str) -> None:
        announce(f"{run.title} at {address}{' on the host of Jupyter' if base_url else ''} (Ctrl-C stops)")
        if open_page and not base_url:  # below the path of Jupyter it is seen from elsewhere
            webbrowser.open(address)

    try:
        with suppress(KeyboardInterrupt, asyncio.CancelledError):
            asyncio.run(_until_terminated(explorer.serve(port=port, ready=ready)))
    except (OSError, OverflowError) as error:
        raise OSError(_why_not(error, host, port)) from error
    finally:
        explorer.close()
    announce("stopped")


async def _until_terminated(serving: Any) -> None:
    task = asyncio.ensure_future(serving)
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)  # asyncio minds Ctrl-C by itself
    await task


def _why_not(error: OSError | OverflowError, host: str, port: int | None) -> str:
    """Why no server can listen there, and what would do."""
    if port is not None and not 0 <= port <= 65535:
        return f"a port lies in 0 to 65535, got {port}"
    reason = getattr(error, "errno", None)
    if reason == errno.EADDRINUSE:
        return f"port {port} of {host} is taken: name another one, or none for one that is free"
    if reason == errno.EACCES:
        return f"port {port} is not for everybody: name one above 1023, or none for one that is free"
    return f"no server can listen at {host}: {getattr(error, 'strerror', None) or error}"
