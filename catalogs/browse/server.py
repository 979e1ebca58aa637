"""Serve one catalog to this machine: its page and the plain files below it, nothing else."""

from __future__ import annotations

import io
import os
import shutil
import stat
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import unquote, urlsplit

from catalogs.browse.page import PAGE, page_of, write_page
from catalogs.catalog import Catalog

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".png": "image/png",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
}
LOCAL_NAMES = {"127.0.0.1", "localhost"}
LINGER_SECONDS = 30


class CatalogServer(ThreadingHTTPServer):
    """Answers on 127.0.0.1 for the files of `folder`; the page comes from memory, so that the folder may be read-only."""

    def __init__(self, folder: Path, page: bytes, port: int = 0) -> None:
        self.folder = folder
        self.page = page
        super().__init__(("127.0.0.1", port), CatalogRequest)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/"


class CatalogRequest(BaseHTTPRequestHandler):
    """GET and HEAD of the page and of plain files; no listings, no links, no hidden files, no other folder."""

    server: CatalogServer
    protocol_version = "HTTP/1.1"
    server_version = "catalogs"
    sys_version = ""
    timeout = LINGER_SECONDS

    def do_GET(self) -> None:
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        self._answer(with_body=False)

    def _answer(self, *, with_body: bool) -> None:
        # A page elsewhere may name this server by a host of its own (DNS rebinding): only local names are answered.
        if self.headers.get("Host", "").partition(":")[0] not in LOCAL_NAMES:
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        try:
            path = unquote(urlsplit(self.path).path, errors="strict")
            if path in ("/", f"/{PAGE}"):
                content: BinaryIO = io.BytesIO(self.server.page)
                size, kind = len(self.server.page), TYPES[".html"]
            else:
                content = open_below(self.server.folder, path.removeprefix("/"))
                size = os.fstat(content.fileno()).st_size
                kind = TYPES.get(Path(path).suffix, "application/octet-stream")
        except (OSError, ValueError):
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        with content:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(size))
            self.send_header("Cache-Control", "no-cache")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            if with_body:
                shutil.copyfileobj(content, self.wfile)

    def log_message(self, *arguments: Any) -> None:
        """Say nothing: the terminal belongs to whoever started the server."""


def open_below(folder: Path, name: str) -> BinaryIO:
    """Open the plain file `name` ("a/b/c.png") below `folder` for reading.

    Every step is opened in the folder before it and none may be a link, so nothing outside can be reached, not even if
    links are put in place meanwhile.  Raises OSError or ValueError for anything but a visible plain file.
    """
    *folders, last = name.split("/")
    if any(part.startswith(".") or not part or "\\" in part or "\x00" in part for part in (*folders, last)):
        raise ValueError(f"{name!r} names no visible file")
    here = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for part in folders:
            below = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=here)
            os.close(here)
            here = below
        file = os.open(last, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=here)
    finally:
        os.close(here)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise ValueError(f"{name!r} is no plain file")
    return os.fdopen(file, "rb")


def serve(folder: Path, *, port: int = 0, open_page: bool = False, announce: Callable[[str], Any] = print) -> None:
    """Write the page into the catalog at `folder` and serve it until Ctrl-C, after announcing its address.

    Raises CatalogError where there is no catalog, OSError where the port is taken.
    """
    page = page_of(Catalog.open(folder))
    with CatalogServer(folder, page.encode(), port) as server:
        try:
            write_page(folder)
        except OSError as error:
            announce(f"the page is not kept beside the pictures: {error}")
        announce(f"{folder} at {server.address} (Ctrl-C stops)")
        if open_page:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            announce("stopped")
