"""The server as strangers meet it: files outside, other methods and pages, and the token."""

from __future__ import annotations

import re
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import aiohttp
import pytest

pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")

from catalogs.web.access import Access
from surrogate.explore.run import Run
from surrogate.explore.server.notebook import NotebookExplorer
from tests.support.models import plain
from tests.support.tabs import Tab, lives, post, raw_answer, served, wait

TOKEN = secrets.token_urlsafe(24)
OUTSIDE = ("class Explorer", "root:", "import annotations")  # what files beside the page's hold, and /etc/passwd


@pytest.mark.parametrize(
    "target",
    [
        "/../application.py",
        "/explore/../application.py",
        "/explore/../../explore/application.py",
        "/explore/%2e%2e/application.py",
        "/explore/%2E%2E%2Fapplication.py",
        "/explore/..%2fapplication.py",
        "/explore/..%5capplication.py",
        "/explore/..\\application.py",
        "/explore/%252e%252e/application.py",
        "/explore/%252e%252e%252fapplication.py",
        "/explore/%c0%ae%c0%ae/application.py",
        "/explore/%u002e%u002e/application.py",
        "/explore/....//application.py",
        "/explore/.//..//application.py",
        "/explore//etc/passwd",
        "/explore/%2fetc%2fpasswd",
        "//etc/passwd",
        "/%2fetc/passwd",
        "/etc/passwd",
        "/explore/../../../../../../../../../../etc/passwd",
        "/explore/" + "%2e%2e%2f" * 20 + "etc/passwd",
        "/" + "../" * 20 + "etc/passwd",
        "/explore/explore.js%00",
        "/explore/..%00/application.py",
        "/explore/%00",
        "/explore/" + "a" * 5000,
        "/explore/" + "a/" * 3000,
        "/explore",
        "/explore/",
        "/assets",
        "/catalog.cdb/",
        "/surrogate/model.json",
        "/explore/file:///etc/passwd",
        "/explore/\xff\xfe",
        "file:///etc/passwd",
    ],
)
def test_no_file_outside_is_served(explorer: str, target: str) -> None:
    status, answer = raw_answer(explorer, target)
    assert status in (400, 403, 404), answer[:200]
    assert not any(content in answer for content in OUTSIDE)
    assert "Traceback" not in answer
    assert raw_answer(explorer, "/explore/explore.js")[0] == 200


def test_links_out_of_the_page_are_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from surrogate.explore.server import explorer as module

    page = tmp_path / "page"
    shutil.copytree(module.PAGE, page)
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "file.js").write_text("class Explorer")
    (page / "file.js").symlink_to(tmp_path / "secret" / "file.js")
    (page / "folder").symlink_to(tmp_path / "secret")
    monkeypatch.setattr(module, "PAGE", page)
    with served(Run("plain", plain())) as address:
        assert raw_answer(address, "/explore/explore.js")[0] == 200
        for target in ("/explore/file.js", "/explore/folder/file.js", "/explore/folder", "/explore/folder/"):
            status, answer = raw_answer(address, target)
            assert status in (403, 404)
            assert "class Explorer" not in answer


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "FOO", "get", "POST"])
def test_other_methods_are_refused(explorer: str, method: str) -> None:
    for target in ("/", "/explore/explore.js", "/ws"):
        status, answer = raw_answer(explorer, target, method=method)
        assert status in (400, 403, 404, 405), answer[:200]
    if method != "POST":
        assert raw_answer(explorer, "/export", method=method)[0] in (400, 403, 404, 405)


@pytest.mark.parametrize(
    "headers",
    [
        "Host: evil.example\r\n",
        "Host: evil.example:80\r\n",
        "Host: \r\n",
        "Host: 127.0.0.1.evil.example\r\n",
        "Host: [\r\n",
        "Host: localhost@evil.example\r\n",
        "Origin: http://evil.example\r\n",
        "Origin: null\r\n",
        "Origin: http://127.0.0.1:1\r\n",
        "Origin: file://\r\n",
    ],
)
def test_pages_of_others_get_nothing(explorer: str, headers: str) -> None:
    upgrade = "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
    for method, target, more in (
        ("GET", "/", ""),
        ("GET", "/explore/explore.js", ""),
        ("POST", "/export", ""),
        ("GET", "/ws", upgrade),
    ):
        status, answer = raw_answer(explorer, target, method=method, headers=headers + more)
        assert status in (400, 403), answer[:200]
        assert not any(content in answer for content in (*OUTSIDE, "<html", "import "))


def test_two_hosts_are_no_host(explorer: str) -> None:
    netloc = urlsplit(explorer).netloc
    status, _ = raw_answer(explorer, "/", headers=f"Host: {netloc}\r\nHost: evil.example\r\n")
    assert status in (302, 400)
    assert raw_answer(explorer, "http://evil.example/", headers=f"Host: {netloc}\r\n")[0] in (302, 400, 403, 404)


def test_the_address_of_the_socket_is_not_for_reading(explorer: str) -> None:
    for _ in range(5):
        status, answer = raw_answer(explorer, "/ws")
        assert status == 400
        assert "Traceback" not in answer
    with Tab(explorer) as tab:
        lives(tab)


def test_every_answer_says_how_it_may_be_used(explorer: str) -> None:
    for target in ("/index.html", "/explore/explore.js", "/web/look.css", "/nothing", "/"):
        answer = raw_answer(explorer, target)[1].lower()
        assert "x-content-type-options: nosniff" in answer
        assert "content-security-policy: default-src 'self'" in answer
        assert "access-control-allow" not in answer


@pytest.mark.parametrize(
    "content", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b'{"size": NaN}', b"null", b"3", b'"x"', b"1" * 5000]
)
def test_exports_that_are_no_message_are_refused(explorer: str, content: bytes) -> None:
    status, answer = post(explorer, content)
    assert status == 400
    assert set(answer) == {"error"}
    assert len(answer["error"]) < 300


# ---- with a token


@pytest.fixture(scope="module")
def guarded() -> Iterator[tuple[str, str]]:
    """Address of a server that listens everywhere, and the name of its cookie."""
    access = Access("0.0.0.0", TOKEN)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Access, "of", lambda *_: access)
        explorer = NotebookExplorer(Run("plain", plain()))
    yield f"http://127.0.0.1:{explorer._explorer.port}/", access.cookie
    explorer.close()


def handshake(address: str, **headers: str) -> int:
    """The status of an attempt to open a WebSocket."""

    async def attempt() -> int:
        async with aiohttp.ClientSession() as session:
            try:
                async with session.ws_connect(f"{address.replace('http', 'ws')}ws", headers=headers):
                    return 101
            except aiohttp.WSServerHandshakeError as error:
                return error.status

    return wait(attempt())


def test_without_the_token_nothing_is_answered(guarded: tuple[str, str]) -> None:
    address, cookie = guarded
    for credentials in ("", f"Cookie: {cookie}=wrong\r\n", f"Cookie: {cookie}=\r\n", f"Cookie: other={TOKEN}\r\n"):
        for method, target in (
            ("GET", "/"),
            ("GET", "/?token=wrong"),
            ("GET", "/?token="),
            ("GET", "/index.html"),
            ("GET", "/explore/explore.js"),
            ("GET", "/ws"),
            ("POST", "/export"),
            ("GET", "/nothing"),
        ):
            status, answer = raw_answer(address, target, method=method, headers=credentials)
            assert status == 403
            assert TOKEN not in answer
    assert handshake(address) == 403
    assert handshake(address, Cookie=f"{cookie}=wrong") == 403
    assert handshake(address, Cookie=f"{cookie}={TOKEN}", Origin="http://evil.example") == 403


def test_the_token_becomes_a_cookie_that_opens_everything(guarded: tuple[str, str]) -> None:
    address, cookie = guarded
    status, answer = raw_answer(address, f"/?token={TOKEN}")
    assert status == 303
    assert "Location: ?\r\n" in answer  # the token leaves the address
    assert re.search(
        rf"Set-Cookie: {cookie}={TOKEN}; HttpOnly; SameSite=Lax\r\n", answer
    )  # without a path: this server's alone
    brought = f"Cookie: {cookie}={TOKEN}\r\n"
    assert raw_answer(address, "/explore/explore.js", headers=brought)[0] == 200
    assert raw_answer(address, "/export", method="POST", headers=brought, body="{}")[0] == 400
    assert handshake(address, Cookie=f"{cookie}={TOKEN}") == 101
    assert handshake(address, Cookie=f"{cookie}={TOKEN}", Origin=address.rstrip("/")) == 101
