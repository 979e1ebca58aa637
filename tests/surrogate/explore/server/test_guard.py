from __future__ import annotations

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from catalogs.browse.access import Access
from surrogate.explore.server.guard import refusal

LOCAL = Access.of("127.0.0.1")
OPEN = Access.of("0.0.0.0")
TOKEN, COOKIE = OPEN.token, OPEN.cookie


def request(path: str = "/", **headers: str) -> web.Request:
    return make_mocked_request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:1", "LOCALHOST:80", "127.0.0.1", "[::1]:90"])
def test_this_machine_may_talk_to_a_local_server(host: str) -> None:
    assert refusal(LOCAL, request(Host=host)) == ""
    assert refusal(LOCAL, request(Host=host, Origin=f"http://{host}")) == ""


@pytest.mark.parametrize(
    "host", ["evil.example:8000", "127.0.0.1.evil.example", "", "localhost.evil.example", "[", "[::1"]
)
def test_a_name_that_resolves_here_is_refused(host: str) -> None:
    assert refusal(LOCAL, request(Host=host)) != ""


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "http://127.0.0.1:9999", "https://localhost", "http://localhost:8000.evil", ""],
)
def test_pages_of_other_sites_are_refused(origin: str) -> None:
    assert "other sites" in refusal(LOCAL, request(Host="localhost:8000", Origin=origin))


def test_other_addresses_need_the_token() -> None:
    assert len(TOKEN) >= 32
    assert Access.of("0.0.0.0").token != TOKEN
    assert "token" in refusal(OPEN, request(Host="192.168.0.7:80"))
    assert "token" in refusal(OPEN, request("/?token=wrong", Host="192.168.0.7:80"))
    assert "token" in refusal(OPEN, request("/?token=%ff%fe", Host="192.168.0.7:80"))
    assert "token" in refusal(OPEN, request(Host="192.168.0.7:80", Cookie=f"{COOKIE}=x{TOKEN}"))
    assert refusal(OPEN, request(f"/?token={TOKEN}", Host="192.168.0.7:80")) == ""
    assert refusal(OPEN, request(Host="192.168.0.7:80", Cookie=f"{COOKIE}={TOKEN}")) == ""
    stranger = request(f"/?token={TOKEN}", Host="192.168.0.7:80", Origin="http://evil.example")
    assert "other sites" in refusal(OPEN, stranger)


def test_servers_of_one_host_do_not_take_each_others_cookies() -> None:
    assert Access.of("0.0.0.0").cookie != COOKIE
    assert TOKEN not in COOKIE


def test_a_local_server_has_no_token() -> None:
    assert LOCAL.token == ""
    assert Access.of("localhost").token == ""
    assert Access.of("192.168.0.7").token != ""


@pytest.mark.parametrize("base_url", ["/user/name/", "user/name", "/user/name"])
def test_behind_a_proxy_the_token_counts_and_not_the_name(base_url: str) -> None:
    access = Access.of("127.0.0.1", base_url)
    token = access.token
    assert access.address(80) == f"/user/name/proxy/80/?token={token}"
    for host in ("hub.example", "127.0.0.1:80", "localhost"):
        assert "token" in refusal(access, request(Host=host))
        assert refusal(access, request(f"/?token={token}", Host=host)) == ""
        assert refusal(access, request(Host=host, Origin=f"https://{host}", Cookie=f"{access.cookie}={token}")) == ""
    assert "other sites" in refusal(
        access, request(f"/?token={token}", Host="hub.example", Origin="http://evil.example")
    )


def test_jupyter_without_a_path_is_a_proxy_as_well() -> None:
    assert Access.of("127.0.0.1", "/").address(80).startswith("/proxy/80/?token=")
