"""Serve one catalog: its page and the plain files below it, nothing else, to whom `catalogs.web.access` lets in."""

from __future__ import annotations

import io
import os
import shutil
import socket
import stat
import sys
import webbrowser
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import parse_qs, unquote, urlsplit

from catalogs.browse.page import PAGE, page_of
from catalogs.files import durable
from catalogs.files.images import FORMATS
from catalogs.files.packed import PACK
from catalogs.store.catalog import Catalog
from catalogs.store.pictures import number_of, pack_of
from catalogs.store.table import MEMBERS
from catalogs.web.access import LOCAL, Access

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".png": "image/png",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
}
UNKNOWN = "application/octet-stream"
LINGER_SECONDS = 30


class CatalogServer(ThreadingHTTPServer):
    """Answers for the files of `folder`; the page comes from memory, so that the folder may be read-only.

    Parameters
    ----------
    host : the address to listen on; any but this machine's own loopback needs the `token`, made here.
    port : 0 lets the system choose a free one.
    packed : the catalog, where its pictures are packed: they are served under the names of their own files.
    """

    def __init__(
        self, folder: Path, page: bytes, port: int = 0, *, host: str = LOCAL, packed: Catalog | None = None
    ) -> None:
        self.folder = folder
        self.page = page
        self.packed = packed
        self.access = Access.of(host)
        self.address_family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        super().__init__((host, port), CatalogRequest)

    @property
    def address(self) -> str:
        """The address to open, with the token where one is needed."""
        return self.access.address(self.server_address[1])

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Browsers drop connections as they please; anything else is an error."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class CatalogRequest(BaseHTTPRequestHandler):
    """GET and HEAD of the page and of plain files; no listings, no links, no hidden files, no other folder."""

    server: CatalogServer
    protocol_version = "HTTP/1.1"
    server_version = "catalogs"
    sys_version = ""
    timeout = LINGER_SECONDS

    def do_GET(self) -> None:
        if not self._is_let_in():
            return
        try:
            path = unquote(urlsplit(self.path).path, errors="strict")
            if path in ("/", f"/{PAGE}"):
                content: BinaryIO = io.BytesIO(self.server.page)
                size, kind = len(self.server.page), TYPES[".html"]
            elif self.server.packed is not None and Path(path).suffix in FORMATS.values():
                picture = packed_picture(self.server.packed, path.removeprefix("/"))
                content, size = io.BytesIO(picture), len(picture)
                kind = TYPES.get(Path(path).suffix, UNKNOWN)
            else:
                content = open_below(self.server.folder, path.removeprefix("/"))
                size = os.fstat(content.fileno()).st_size
                kind = TYPES.get(Path(path).suffix, UNKNOWN)
        except (OSError, ValueError):
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        with content:
            about = {"Content-Type": kind, "Cache-Control": "no-cache", "X-Content-Type-Options": "nosniff"}
            self._send_head(HTTPStatus.OK, size, about)
            if self.command == "GET":
                shutil.copyfileobj(content, self.wfile)

    do_HEAD = do_GET

    def _is_let_in(self) -> bool:
        """True if the request has access; else answers it, and exchanges a token in the address for a cookie."""
        access, query = self.server.access, parse_qs(urlsplit(self.path).query)
        brought = query.get("token", [None])[0]
        cookies = dict(pair.strip().partition("=")[::2] for pair in self.headers.get("Cookie", "").split(";"))
        hosts = [self.headers.get("Host", "")]
        reason = access.refusal(hosts, self.headers.get("Origin"), [brought, cookies.get(access.cookie)])
        if reason:
            self.send_error(HTTPStatus.FORBIDDEN, explain=reason)
        elif access.token and access.is_token(brought):
            cookie = f"{access.cookie}={access.token}; HttpOnly; SameSite=Lax; Path=/"
            about = {"Location": "/", "Set-Cookie": cookie, "Cache-Control": "no-store"}
            self._send_head(HTTPStatus.SEE_OTHER, 0, about)
        else:
            return True
        return False

    def _send_head(self, status: HTTPStatus, size: int, about: Mapping[str, str]) -> None:
        self.send_response(status)
        for name, value in {**about, "Content-Length": str(size), "Referrer-Policy": "no-referrer"}.items():
            self.send_header(name, value)
        self.end_headers()

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
        raise ValueError(f"{name!r} is not a plain file")
    return os.fdopen(file, "rb")


def packed_picture(catalog: Catalog, name: str) -> bytes:
    """The file `name` ("members/<member>/<appearance>/<view>.png") of a picture that is packed.

    Raises OSError or ValueError where the catalog has no such picture, and where its pack is a link, as `open_below` does.
    """
    folder, of, appearance, file = (name.split("/") + [""] * 4)[:4]
    member = catalog.member(of)
    view = int(Path(file).stem)
    if appearance not in member.appearances or not 0 <= view < len(member.cameras):
        raise ValueError(f"{name!r} is not a picture")
    if name != f"{folder}/{of}/{catalog.plan.image_name(appearance, view)}" or folder != MEMBERS:
        raise ValueError(f"{name!r} is not a picture")
    open_below(catalog.path, f"{folder}/{of}/{PACK}").close()
    return pack_of(member).file(number_of(member, appearance, view))[0]


def serve(
    folder: Path,
    *,
    host: str = LOCAL,
    port: int = 0,
    open_page: bool = False,
    explorer: str = "",
    announce: Callable[[str], Any] = print,
) -> None:
    """Write the page into the catalog at `folder` and serve it until Ctrl-C, after announcing its address.

    Where the address of an `explorer` is given, served pictures link to it.  Raises CatalogError where there is no catalog,
    OSError where the host is unknown or the port is taken, ValueError as `page_of` does.
    """
    catalog = Catalog.open(folder)
    page = page_of(catalog, explorer).encode()
    with CatalogServer(folder, page, port, host=host, packed=catalog if catalog.plan.packed else None) as server:
        try:
            durable.replace(folder / PAGE, page_of(catalog).encode() if explorer else page)
        except OSError as error:
            announce(f"the page is not kept beside the pictures: {error}")
        announce(f"{folder} at {server.address} (Ctrl-C stops)")
        if open_page:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            announce("stopped")
