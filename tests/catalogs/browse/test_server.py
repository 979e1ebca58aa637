"""The server gives out the page and the catalog's plain files, and nothing else."""

from __future__ import annotations

import http.client
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from catalogs.browse import CatalogServer, page_of, serve
from catalogs.browse.server import open_below
from catalogs.catalog import Catalog


def ask(server: CatalogServer, target: str, *, method: str = "GET", host: str = "127.0.0.1") -> tuple[int, bytes]:
    """Status and body of a request whose target is sent as it stands: no client tidies it up."""
    with socket.create_connection(server.server_address[:2], timeout=10) as connection:
        connection.sendall(f"{method} {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode("latin-1"))
        answer = http.client.HTTPResponse(connection, method=method)
        answer.begin()
        return answer.status, answer.read()


@pytest.fixture
def secrets(grid: Catalog) -> Iterator[None]:
    """What must not get out: a file beside the catalog, links to it, a hidden file, a pipe, a lock."""
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


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1"])
def test_the_server_answers_only_to_local_names(server: CatalogServer, host: str) -> None:
    assert ask(server, "/data.csv", host=host)[0] in (400, 403)


def test_the_server_only_reads(server: CatalogServer) -> None:
    for method in ("POST", "PUT", "DELETE"):
        assert ask(server, "/data.csv", method=method)[0] == 501
    assert server.server_address[0] == "127.0.0.1"


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

    def refuse(path: Path) -> Path:
        raise PermissionError(f"{path} is read-only")

    def stop(self: CatalogServer) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("catalogs.browse.server.write_page", refuse)
    monkeypatch.setattr(CatalogServer, "serve_forever", stop)
    serve(catalog.path, announce=said.append)
    assert "read-only" in said[0]
    assert re.search(r"at http://127\.0\.0\.1:\d+/", said[1])
    assert said[2] == "stopped"
