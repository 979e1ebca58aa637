from __future__ import annotations

import pytest

from catalogs.web.access import Access

LOCAL = Access.of("127.0.0.1")
OPEN = Access.of("0.0.0.0")
TOKEN, COOKIE = OPEN.token, OPEN.cookie


def refusal(access: Access, host: str, origin: str | None = None, *, brings: str | None = None) -> str:
    return access.refusal([host], origin, [brings])


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:1", "LOCALHOST:80", "127.0.0.1", "[::1]:90"])
def test_this_machine_may_talk_to_a_local_server(host: str) -> None:
    assert refusal(LOCAL, host) == ""
    assert refusal(LOCAL, host, f"http://{host}") == ""


@pytest.mark.parametrize(
    "host", ["evil.example:8000", "127.0.0.1.evil.example", "", "localhost.evil.example", "[", "[::1"]
)
def test_a_name_that_resolves_here_is_refused(host: str) -> None:
    assert refusal(LOCAL, host) != ""


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "http://127.0.0.1:9999", "https://localhost", "http://localhost:8000.evil", ""],
)
def test_pages_of_other_sites_are_refused(origin: str) -> None:
    assert "other sites" in refusal(LOCAL, "localhost:8000", origin)


def test_other_addresses_need_the_token() -> None:
    assert len(TOKEN) >= 32
    assert Access.of("0.0.0.0").token != TOKEN
    there = "192.168.0.7:80"
    for wrong in (None, "", "wrong", "\xff\xfe", f"x{TOKEN}", "\ud800"):
        assert "token" in refusal(OPEN, there, brings=wrong)
    assert refusal(OPEN, there, brings=TOKEN) == ""
    assert OPEN.refusal([there], None, ["stale", TOKEN]) == ""
    assert "other sites" in refusal(OPEN, there, "http://evil.example", brings=TOKEN)


def test_all_names_that_a_request_calls_it_by_must_be_its_own() -> None:
    assert LOCAL.refusal(["localhost:80", "127.0.0.1:80"], None, []) == ""
    assert "own address" in LOCAL.refusal(["localhost:80", "evil.example"], None, [])


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
        assert "token" in refusal(access, host)
        assert refusal(access, host, brings=token) == ""
        assert refusal(access, host, f"https://{host}", brings=token) == ""
    assert "other sites" in refusal(access, "hub.example", "http://evil.example", brings=token)


def test_jupyter_without_a_path_is_a_proxy_as_well() -> None:
    assert Access.of("127.0.0.1", "/").address(80).startswith("/proxy/80/?token=")
