"""The explorer inside a notebook: a server in a thread of the kernel, and a frame that shows its page."""

from __future__ import annotations

import asyncio
import atexit
import html
import os
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from surrogate.explore.run import Run
from surrogate.explore.server.explorer import Explorer
from surrogate.explore.server.link import PageParameters
from surrogate.model import Surrogate

PATIENCE = 30.0  # seconds for a server to start
HUB = "JUPYTERHUB_SERVICE_PREFIX"  # the variable in which JupyterHub tells Jupyter's base URL


class NotebookExplorer:
    """An explorer that runs in this process until `close` is called or the kernel ends; in Jupyter it shows itself.

    The browser must reach this machine's 127.0.0.1.  Where the kernel runs elsewhere, forward the port of `address` (`ssh -L`), or
    give the `base_url` of a Jupyter that has jupyter-server-proxy.
    """

    def __init__(self, run: Run, *, height: int = 720, base_url: str = "") -> None:
        self._height = height
        self._ready = threading.Event()
        self._explorer = Explorer(run, base_url=base_url, linked=True)
        self._task: asyncio.Task[Any] | None = None
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._serve, name="explorer", daemon=True)
        self._thread.start()
        atexit.register(self.close)
        if not self._ready.wait(PATIENCE) or self._failure is not None:
            self.close()
            raise RuntimeError(f"the explorer did not start: {self._failure or f'no answer in {PATIENCE:g} s'}")

    @property
    def address(self) -> str:
        """The page's address: below that of Jupyter, if it has a `base_url`."""
        return self._explorer.address

    @property
    def parameters(self) -> PageParameters:
        """The parameters that the page shows: `page.parameters["Re"] = 900` moves it."""
        return self._explorer.parameters

    def on_change(self, callback: Callable[[dict[str, float]], Any]) -> None:
        """Call a function with all parameters by name whenever the page has changed them, in a thread of the explorer."""
        self.parameters.on_change(callback)

    def close(self) -> None:
        """Stop the server: its port and its threads are free again."""
        if self._task is not None and self._thread.is_alive():
            self._task.get_loop().call_soon_threadsafe(self._task.cancel)
            self._thread.join(timeout=PATIENCE)
        self._explorer.close()
        atexit.unregister(self.close)

    def _serve(self) -> None:
        try:
            asyncio.run(self._live())
        except asyncio.CancelledError:
            pass
        except BaseException as error:  # whatever it is, `__init__` waits to hear of it
            self._failure = error
            self._ready.set()

    async def _live(self) -> None:
        self._task = asyncio.current_task()
        await self._explorer.serve(ready=lambda _: self._ready.set())

    def _repr_html_(self) -> str:
        address = html.escape(self.address, quote=True)
        return (
            f'<iframe src="{address}" title="Explorer of {html.escape(self._explorer.run.title, quote=True)}" '
            f'width="100%" height="{self._height:d}" style="border:0;border-radius:6px" allow="clipboard-write"></iframe>'
            f'<p><a href="{address}" target="_blank" rel="noopener">In a window of its own</a></p>'
        )

    def __repr__(self) -> str:
        return f"<Explorer of {self._explorer.run.title} at {self.address}>"


def show(
    surrogate: Surrogate,
    run: str | os.PathLike[str] | None = None,
    *,
    height: int = 720,
    base_url: str | None = None,
) -> NotebookExplorer:
    """Explore `surrogate` in this notebook, `height` pixels tall.

    With the folder of its `run` (such as "runs/tgv") the page also knows the stored pictures: trained values, the truth, what
    error to expect.  `base_url` is that of a Jupyter server with jupyter-server-proxy, through which the page is then reached.
    JupyterHub sets it, and "" goes to this machine's own port all the same.  Raises ModuleNotFoundError without the
    extra `[explore]`, RuntimeError where no server can start.

    Examples
    --------
    >>> import surrogate
    >>> from blobs import make_run
    >>> page = surrogate.show(surrogate.Surrogate.load(make_run() / "surrogate"), make_run(), base_url="")
    >>> page  # in a notebook: the page itself
    <Explorer of blobs at http://127.0.0.1:.../>
    >>> page.close()
    """
    shown_run = Run("surrogate", surrogate) if run is None else replace(Run.open(run), surrogate=surrogate)
    return NotebookExplorer(
        shown_run, height=height, base_url=os.environ.get(HUB, "") if base_url is None else base_url
    )
