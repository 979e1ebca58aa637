"""Serve one folder to this machine: files below it, nothing else."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any


class FolderRequest(SimpleHTTPRequestHandler):
    """GET and HEAD of regular files below the folder; no listings, no links out of it."""

    def send_head(self) -> Any:
        root, asked = Path(self.directory).resolve(), Path(self.translate_path(self.path))
        if asked.is_dir():
            asked = asked / "index.html"
        if not asked.resolve().is_relative_to(root) or not asked.is_file() or asked.name.startswith("."):
            self.send_error(404)
            return None
        return super().send_head()

    def log_message(self, *arguments: Any) -> None:
        """Say nothing: the terminal belongs to whoever started the server."""


def make_server(folder: Path, port: int = 0) -> ThreadingHTTPServer:
    """A server of `folder` on 127.0.0.1; port 0 takes a free one."""
    return ThreadingHTTPServer(("127.0.0.1", port), partial(FolderRequest, directory=str(folder)))


def serve(folder: Path, *, port: int = 0, open_page: bool = False, announce: Callable[[str], Any] = print) -> None:
    """Serve `folder` until Ctrl-C, after announcing its one address."""
    with make_server(folder, port) as server:
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        announce(f"{folder} at {address} (Ctrl-C stops)")
        if open_page:
            webbrowser.open(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            announce("stopped")
