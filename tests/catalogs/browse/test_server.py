"""The server gives out the page and the catalog's plain files, and nothing else."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.request import urlopen

import pytest

from catalogs.browse import CatalogServer, page_of, serve
from catalogs.browse.server import open_below
from catalogs.store.catalog import Catalog
from catalogs.tools.packing import pack
from tests.catalogs.browse.conftest import running
from tests.support.browsed import shown

if TYPE_CHECKING:
    from playwright.sync_api import Page


def ask(
    server: CatalogServer, target: str, *, method: str = "GET", host: str = "127.0.0.1", cookie: str = ""
) -> tuple[int, bytes]:
    """Status and body of a request whose target is sent as it stands: no client tidies it up."""
    status, _, body = answer_of(server, target, method=method, host=host, cookie=cookie)
    return status, body


def answer_of(
    server: CatalogServer, target: str, *, method: str = "GET", host: str = "127.0.0.1", cookie: str = ""
) -> tuple[int, http.client.HTTPMessage, bytes]:
    """The same with the headers of the answer."""
    lines = [
        f"{method} {target} HTTP/1.1",
        f"Host: {host}",
        "Connection: close",
        *([f"Cookie: {cookie}"] * bool(cookie)),
    ]
    with socket.create_connection(("127.0.0.1", server.server_address[1]), timeout=10) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode("latin-1"))
        answer = http.client.HTTPResponse(connection, method=method)
        answer.begin()
        return answer.status, answer.headers, answer.read()


@pytest.fixture
def secrets(grid: Catalog) -> Iterator[None]:
    """Files that must not be served: one beside the catalog, links to it, a hidden file, a pipe, a lock."""
    outside = grid.path.parent / "secret.txt"
    outside.write_text("secret")
    (grid.path / "link.txt").symlink_to(outside)
    (grid.path / "members/up").symlink_to(grid.path.parent)
    (grid.path / "inner.csv").symlink_to(grid.path / "data.csv")
    (grid.path / ".hidden").write_text("secret")
    os.mkfifo(grid.path / "pipe")
    yield
    for name in ("link.txt", "members/up", "inner.csv", ".hidden", "pipe"):
        (grid.path / name).unlink()


def test_the_server_gives_out_the_page_and_the_files(grid: Catalog, server: CatalogServer) -> None:
    assert ask(server, "/") == (200, page_of(grid).encode())
    assert ask(server, "/index.html?x=1")[0] == 200
    assert ask(server, "/data.csv") == (200, (grid.path / "data.csv").read_bytes())
    image = grid.image_path("m2", "second", 7)
    assert ask(server, "/members/m2/second/007.png") == (200, image.read_bytes())
    assert ask(server, "/members/m2/%73econd/007.png", host="localhost:9000") == (200, image.read_bytes())
    assert ask(server, "/data.csv", method="HEAD") == (200, b"")


@pytest.mark.usefixtures("secrets")
@pytest.mark.parametrize(
    "target",
    [
        "/../secret.txt",
        "/members/../../secret.txt",
        "/%2e%2e/secret.txt",
        "/..%2fsecret.txt",
        "/members/%2e%2e%2f%2e%2e%2fsecret.txt",
        "/..\\secret.txt",
        "//etc/passwd",
        "/%2fetc/passwd",
        "/link.txt",
        "/inner.csv",
        "/members/up/secret.txt",
        "/.hidden",
        "/.lock",
        "/pipe",
        "/members",
        "/members/",
        "/members/m0/",
        "/data.csv/",
        "/data.csv%00.png",
        "/%ff%fe",
        "/none",
        "/" + "x" * 5000,
        "*",
        "http://127.0.0.1/../secret.txt",
    ],
)
def test_the_server_gives_out_nothing_else(server: CatalogServer, target: str) -> None:
    status, body = ask(server, target)
    assert status == 404
    assert b"secret" not in body.replace(b"secret.txt", b"")
    assert ask(server, "/data.csv")[0] == 200, "and it is still there"


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "192.168.0.1", "0.0.0.0", "2130706433", "", "[::1"],
)
def test_the_server_answers_only_to_local_names(server: CatalogServer, host: str) -> None:
    assert ask(server, "/data.csv", host=host)[0] in (400, 403)


def test_the_server_only_reads(server: CatalogServer) -> None:
    for method in ("POST", "PUT", "DELETE"):
        assert ask(server, "/data.csv", method=method)[0] == 501
    assert server.server_address[0] == "127.0.0.1"


@pytest.fixture(scope="module")
def open_server(grid: Catalog) -> Iterator[CatalogServer]:
    """One that other machines reach."""
    with running(CatalogServer(grid.path, page_of(grid).encode(), host="0.0.0.0")) as server:
        yield server


def test_other_addresses_need_the_token(grid: Catalog, open_server: CatalogServer) -> None:
    token = open_server.access.token
    assert token is not None
    assert len(token) >= 32
    assert open_server.address == f"http://{socket.gethostname()}:{open_server.server_address[1]}/?token={token}"
    for target in ("/", "/index.html", "/data.csv", "/nothing", "/?token=", "/?token=wrong", f"/?other={token}"):
        assert ask(open_server, target)[0] == 403
    assert ask(open_server, "/data.csv", method="HEAD")[0] == 403
    name = open_server.access.cookie
    for cookie in ("", f"{name}=", f"{name}=wrong", f"other={token}", f"{name}={token}x", "\xe9"):
        status, body = ask(open_server, "/data.csv", cookie=cookie)
        assert status == 403
        assert token.encode() not in body
    status, headers, _ = answer_of(open_server, f"/?token={token}")
    assert status == 303
    assert headers["Location"] == "/", "the token leaves the address"
    cookie, *attributes = headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Lax"} <= set(attributes)
    assert ask(open_server, "/", cookie=cookie) == (200, page_of(grid).encode())
    assert ask(open_server, "/data.csv", cookie=f"a[]=1; {cookie}; b=2")[0] == 200
    assert ask(open_server, "/../secret.txt", cookie=cookie)[0] == 404


def test_tokens_are_random(grid: Catalog) -> None:
    tokens = set()
    for _ in range(3):
        with CatalogServer(grid.path, b"", host="0.0.0.0") as server:
            tokens.add(server.access.token)
    assert len(tokens) == 3


@pytest.mark.parametrize(
    ("host", "status"),
    [("127.0.0.1", 200), ("192.168.7.7:80", 200), ("[fe80::1]:80", 200), ("evil.example", 403), ("", 403)],
)
def test_an_open_server_answers_to_addresses_and_its_own_names(
    open_server: CatalogServer, host: str, status: int
) -> None:
    cookie = f"{open_server.access.cookie}={open_server.access.token}"
    assert ask(open_server, "/data.csv", host=host, cookie=cookie)[0] == status
    assert ask(open_server, "/data.csv", host=f"{socket.gethostname().upper()}:1", cookie=cookie)[0] == 200


@pytest.mark.parametrize(
    ("host", "local"), [("127.0.0.1", True), ("localhost", True), ("127.0.0.5", True), ("::1", True)]
)
def test_this_machine_needs_no_token(grid: Catalog, host: str, local: bool) -> None:
    try:
        server = CatalogServer(grid.path, b"", host=host)
    except OSError as error:
        pytest.skip(f"this machine has no {host}: {error}")
    with server:
        assert (server.access.token == "") == local
        assert server.address == f"http://{f'[{host}]' if ':' in host else host}:{server.server_address[1]}/"


def test_a_client_that_goes_away_leaves_the_terminal_alone(
    server: CatalogServer, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", server.server_address[1])) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close by a reset
        connection.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    assert ask(server, "/data.csv")[0] == 200
    time.sleep(0.2)
    assert capfd.readouterr() == ("", "")


def test_the_command_prints_one_address_and_stops_on_ctrl_c(catalog: Catalog) -> None:
    command = [sys.executable, "-c", "from catalogs.cli import main; main()", "browse", str(catalog.path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        addresses = re.findall(r"http://\S+", said)
        assert len(addresses) == 1
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", addresses[0])
        with urlopen(addresses[0], timeout=10) as answer:
            assert b"<title>" in answer.read()
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=60)
        assert rest == "stopped\n"
        assert process.returncode == 0
    finally:
        process.kill()


def test_a_browser_keeps_the_token_as_a_cookie(grid: Catalog, open_server: CatalogServer, page: Page) -> None:
    address = open_server.address.replace(socket.gethostname(), "127.0.0.1")
    page.goto(f"{address}#member=m3&view=5")
    assert shown(page) == ("m3", "first", 5)
    assert "token" not in page.url
    page.goto("about:blank")
    page.goto(f"http://127.0.0.1:{open_server.server_address[1]}/#member=m2&view=5")
    assert shown(page) == ("m2", "first", 5)


def test_a_file_that_becomes_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a/b.txt").write_text("plain")
    with open_below(tmp_path, "a/b.txt") as file:
        assert file.read() == b"plain"
    (tmp_path / "a").rename(tmp_path / "c")
    (tmp_path / "a").symlink_to(tmp_path / "c")
    with pytest.raises(OSError, match="a"):
        open_below(tmp_path, "a/b.txt")


def test_a_folder_that_refuses_the_page_is_served_all_the_same(
    catalog: Catalog, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    def refuse(path: Path, data: bytes) -> None:
        raise PermissionError(f"{path} is read-only")

    def stop(self: CatalogServer) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("catalogs.files.durable.replace", refuse)
    monkeypatch.setattr(CatalogServer, "serve_forever", stop)
    serve(catalog.path, announce=said.append)
    assert "read-only" in said[0]
    assert re.search(r"at http://127\.0\.0\.1:\d+/", said[1])
    assert said[2] == "stopped"


def test_packed_pictures_are_served_under_the_names_of_their_files(grid: Catalog, tmp_path: Path) -> None:
    pack(grid.path, tmp_path / grid.path.name)
    packed = Catalog.open(tmp_path / grid.path.name)
    member = grid.members[0]
    appearance = member.appearances[0]
    name = f"/members/{member.name}/{appearance}/000.png"
    page = page_of(packed)
    assert page == page_of(grid)
    with running(CatalogServer(packed.path, page.encode(), packed=packed)) as server:
        status, headers, body = answer_of(server, name)
        assert (status, headers["Content-Type"]) == (200, "image/png")
        assert body == grid.image_path(member, appearance, 0).read_bytes()
        assert ask(server, name, method="HEAD") == (200, b"")
        for wrong in (
            "x/000.png",
            f"{appearance}/999.png",
            f"{appearance}/-1.png",
            f"{appearance}/0.png",
            "a/b/000.png",
        ):
            assert ask(server, f"/members/{member.name}/{wrong}")[0] == 404
        for wrong in ("/members/../x/000.png", f"/other/{member.name}/{appearance}/000.png", "/members/no/x/000.png"):
            assert ask(server, wrong)[0] == 404
        path = member.path.name
        kept = packed.path / "members" / path / "pictures.h5"
        kept.rename(tmp_path / "outside.h5")
        kept.symlink_to(tmp_path / "outside.h5")
        assert ask(server, name)[0] == 404
