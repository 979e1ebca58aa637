"""The explorer inside a notebook: a server in a thread of the kernel, and a frame that shows its page."""

from __future__ import annotations

import asyncio
import atexit
import html
import os
import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from surrogate.explore.run import Run
from surrogate.model import Surrogate

if TYPE_CHECKING:
    from surrogate.explore.application import Explorer

PATIENCE = 30.0  # seconds for a server to start


class Shown:
    """An explorer that runs in this process until `close` is called or the kernel ends.

    In Jupyter it shows itself.  The browser must reach this machine's 127.0.0.1: where the kernel runs elsewhere, forward the
    port of `address` as well (`ssh -L`).
    """

    def __init__(self, run: Run, *, height: int = 720) -> None:
        from surrogate.explore.application import Explorer

        self._height = height
        self._ready = threading.Event()
        self._explorer: Explorer = Explorer(run)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._serving: asyncio.Task[Any] | None = None
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._serve, name="explorer", daemon=True)
        self._thread.start()
        atexit.register(self.close)
        if not self._ready.wait(PATIENCE) or self._failure is not None:
            self.close()
            raise RuntimeError(f"the explorer did not start: {self._failure or f'no answer in {PATIENCE:g} s'}")

    @property
    def address(self) -> str:
        """Where the page is."""
        return self._explorer.address

    def close(self) -> None:
        """Stop the server: its port and its threads are free again."""
        loop, self._loop = self._loop, None
        if loop is not None and self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._stop(), loop)
            self._thread.join(timeout=PATIENCE)
        self._explorer.close()
        atexit.unregister(self.close)

    async def _stop(self) -> None:
        await self._explorer.stop()
        if self._serving is not None:
            self._serving.cancel()

    def _serve(self) -> None:
        try:
            asyncio.run(self._live())
        except asyncio.CancelledError:
            pass
        except BaseException as error:  # whatever it is, `__init__` waits to hear of it
            self._failure = error
            self._ready.set()

    async def _live(self) -> None:
        self._loop, self._serving = asyncio.get_running_loop(), asyncio.current_task()
        await self._explorer.start(ready=lambda _: self._announce(), exec_mode="coroutine", thread=True)

    def _announce(self) -> None:
        self._ready.set()
        self._explorer.measure_expectation()

    def _repr_html_(self) -> str:
        address = html.escape(self.address, quote=True)
        return (
            f'<iframe src="{address}" title="Explorer of {html.escape(self._explorer.run.title, quote=True)}" '
            f'width="100%" height="{self._height:d}" style="border:0;border-radius:6px" allow="clipboard-write"></iframe>'
            f'<p><a href="{address}" target="_blank" rel="noopener">In a window of its own</a></p>'
        )

    def __repr__(self) -> str:
        return f"<Explorer of {self._explorer.run.title} at {self.address}>"


def show(surrogate: Surrogate, run: str | os.PathLike[str] | None = None, *, height: int = 720) -> Shown:
    """Explore `surrogate` in this notebook, `height` pixels tall.

    With the folder of its `run` (such as "runs/tgv-dvr") the page also knows the stored pictures: trained values, the truth, what
    error to expect.  Raises ModuleNotFoundError without the extra `[explore]`, RuntimeError where no server can start.
    """
    if run is None:
        return Shown(Run("surrogate", surrogate), height=height)
    return Shown(replace(Run.open(run), surrogate=surrogate), height=height)
