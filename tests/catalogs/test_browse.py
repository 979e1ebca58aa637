"""The browse page: what it says, what its server gives out, and what a real browser shows."""

from __future__ import annotations

import base64
import functools
import http.client
import http.server
import io
import json
import os
import re
import select
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from catalogs.appearance import ImportedImages
from catalogs.browse import CatalogServer, page_of, serve, write_page
from catalogs.browse.page import describe
from catalogs.browse.server import open_below
from catalogs.cameras import Camera, icosphere, orbit, view_splits
from catalogs.catalog import Catalog, CatalogError, CatalogPlan
from catalogs.check import check
from catalogs.cli import main
from catalogs.parameters import Parameter, ParameterSpace

PROJECT = Path(__file__).resolve().parents[2]
SIZE = 64
GRID = [(x, y) for x in (0.0, 1.0, 2.0) for y in (-5.0, 5.0)]


def picture(seed: int, opaque: bool = False) -> np.ndarray:
    """Premultiplied noise in four smooth blocks and a transparent border, its own for every seed."""
    random = np.random.default_rng(seed)
    alpha = np.zeros((SIZE, SIZE, 1))
    alpha[8:-8, 8:-8] = 255 if opaque else random.integers(0, 256, (SIZE - 16, SIZE - 16, 1))
    color = random.integers(0, 256, (SIZE, SIZE, 3))
    return np.concatenate([color * alpha // 255, np.full_like(alpha, 255) if opaque else alpha], axis=2).astype(
        np.uint8
    )


def grid_plan(**changes: Any) -> CatalogPlan:
    values: dict[str, Any] = {
        "space": ParameterSpace((Parameter("x", 0.0, 2.0), Parameter("y<b>", -5.0, 5.0, "m/s"))),
        "appearances": (ImportedImages("first"), ImportedImages("second")),
        "cameras": tuple(orbit((1.0, 0.0, 0.0), 1.0, width=SIZE, height=SIZE, frequency=2)),
        "view_splits": tuple(view_splits(42)),
        "bounds": ((0.0, -1.0, -1.0), (2.0, 1.0, 1.0)),
    }
    return CatalogPlan(**{**values, **changes})


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    """Six members on a grid of two parameters, two appearances, 42 views."""
    catalog = Catalog.create(tmp_path_factory.mktemp("grid") / "grid.cdb", grid_plan())
    for number, (x, y) in enumerate(GRID):
        split = "test" if number == 5 else "train"
        with catalog.begin_member(f"m{number}", {"x": x, "y<b>": y}, split=split) as writer:
            for a, appearance in enumerate(catalog.appearance_names):
                for view in range(42):
                    writer.write_image(appearance, view, picture(10000 * number + 1000 * a + view))
    return catalog


# ---- the page as text


def data_of(page: str) -> dict[str, Any]:
    match = re.search(r'<script type="application/json" id="catalog">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return json.loads(match.group(1))


def test_the_page_names_every_picture(grid: Catalog) -> None:
    data = data_of(page_of(grid))
    for member in data["members"]:
        for appearance in data["appearances"]:
            for view in range(len(data["viewpoints"][member["viewpoints"]])):
                path = f"members/{member['name']}/{appearance['name']}/{data['files'][view]}"
                assert (grid.path / path).is_file()
    assert {m["name"]: tuple(m["values"]) for m in data["members"]} == {f"m{i}": p for i, p in enumerate(GRID)}
    assert data["splits"] == [view_splits(42)]
    assert data["background"] is None


def test_viewpoints_are_seen_from_the_middle_of_the_box(grid: Catalog) -> None:
    (points,) = describe(grid)["viewpoints"]
    np.testing.assert_allclose(np.array(points)[:, :3], icosphere(2), atol=2e-6)
    np.testing.assert_allclose(np.array(points)[:, 3:], [c.up for c in grid.plan.cameras], atol=2e-6)


def test_a_hostile_name_stays_text(tmp_path: Path) -> None:
    plan = grid_plan(space=ParameterSpace((Parameter("</script><script>alert(1)</script>", 0.0, 1.0),)))
    page = page_of(Catalog.create(tmp_path / "x.cdb", plan))
    assert page.count("<script") == 2
    assert data_of(page)["parameters"][0]["name"] == "</script><script>alert(1)</script>"


def test_the_page_asks_nobody_else(grid: Catalog) -> None:
    page = page_of(grid)
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", page)
    assert "default-src 'none'" in page


def test_the_page_leaves_the_catalog_valid_and_replaces_itself(catalog: Catalog) -> None:
    assert check(catalog.path) == []
    page = write_page(catalog.path)
    assert page == catalog.path / "index.html"
    page.write_text("old")
    assert "<html" in write_page(catalog.path).read_text()
    assert check(catalog.path) == []
    assert [p.name for p in catalog.path.iterdir() if "partial" in p.name] == []


def test_what_can_not_be_browsed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CatalogError, match="exr images, which no browser shows"):
        page_of(Catalog.create(tmp_path / "x.cdb", grid_plan(image_format="exr")))
    with pytest.raises(CatalogError, match=r"catalog\.json is missing"):
        write_page(tmp_path)
    assert list(tmp_path.glob("*.html")) == []
    result = CliRunner().invoke(main, ["browse", str(tmp_path / "nothing.cdb")])
    assert result.exit_code == 1
    assert "catalog.json is missing" in result.output


def test_the_title_tells_catalogs_apart(tmp_path: Path) -> None:
    assert describe(Catalog.create(tmp_path / "runs/nyx/catalog.cdb", grid_plan()))["title"] == "nyx"
    assert describe(Catalog.create(tmp_path / "mine.cdb", grid_plan()))["title"] == "mine"
    plan = grid_plan(provenance={"scene": "tgv"})
    assert describe(Catalog.create(tmp_path / "other.cdb", plan))["title"] == "tgv"


# ---- the server


@pytest.fixture(scope="module")
def server(grid: Catalog) -> Iterator[CatalogServer]:
    with CatalogServer(grid.path, page_of(grid).encode()) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        yield running
        running.shutdown()
        thread.join()


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


# ---- a real browser


FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--force-color-profile=srgb",
    "--remote-debugging-pipe",
)


class Browser:
    """Chromium without a window, driven over the DevTools protocol's pipe (file descriptors 3 and 4, JSON ended by NUL)."""

    def __init__(self, program: str, profile: Path, width: int = 1200, height: int = 800) -> None:
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        shell = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        command = ["bash", "-c", shell, "bash", program, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, pass_fds=(to_browser, from_browser), **quiet)  # type: ignore[call-overload]
        os.close(to_browser)
        os.close(from_browser)
        self._count, self._buffer, self.events = 0, b"", list[dict[str, Any]]()
        self._session: str | None = None
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(t["targetId"] for t in targets if t["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._receive()).get("id") != self._count:
            self.events.append(answer)
        assert "error" not in answer, answer["error"]
        return answer["result"]

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            assert select.select([self._read], [], [], 60)[0], "the browser does not answer"
            part = os.read(self._read, 1 << 20)
            assert part, "the browser has ended"
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def evaluate(self, expression: str) -> Any:
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, expression: str, seconds: float = 30.0) -> Any:
        end = time.monotonic() + seconds
        while not (value := self.evaluate(expression)):
            assert time.monotonic() < end, f"never true: {expression}"
            time.sleep(0.02)
        return value

    def open(self, address: str) -> None:
        self.events.clear()
        self.call("Page.navigate", url="about:blank")
        self.wait_for("location.href === 'about:blank'")
        self.call("Page.navigate", url=address)
        self.wait_for("location.href !== 'about:blank' && document.readyState === 'complete'")

    def mouse(self, kind: str, x: float, y: float) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def press(self, key: str) -> None:
        codes = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=codes[key])

    def pixels(self, selector: str) -> np.ndarray:
        """What is on the screen where the element is, [H, W, 3] uint8."""
        box = self.evaluate(
            f"(({{x, y, width, height}}) => ({{x, y, width, height, scale: 1}}))"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        data = self.call("Page.captureScreenshot", format="png", clip=box)["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))

    def complaints(self) -> list[str]:
        """Exceptions, logged errors (blocked or missing files among them)."""
        self.evaluate("0")
        kinds = {"Runtime.exceptionThrown", "Log.entryAdded"}
        return [json.dumps(e["params"])[:500] for e in self.events if e.get("method") in kinds]

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(timeout=30)
        os.close(self._read)
        os.close(self._write)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    programs = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    program = next((path for name in programs if (path := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no browser to test the page with (looked for {', '.join(programs)})")
    running = Browser(program, tmp_path_factory.mktemp("profile"))
    yield running
    running.close()


SHOWN = "document.documentElement?.dataset.shown"


def shown(browser: Browser) -> tuple[str, str, int]:
    """Member, appearance and view of the picture on the screen, once it is the one that the page wants."""
    browser.wait_for(
        f"{SHOWN} && {SHOWN} === addressOf(member(), shown.appearance, shown.view) "
        "&& document.getElementById('picture').complete"
    )
    _, member, appearance, file = browser.evaluate(SHOWN).split("/")
    return member, appearance, int(file.removesuffix(".png"))


def composited(catalog: Catalog, background: tuple[int, int, int], of: tuple[str, str, int]) -> np.ndarray:
    image = catalog.image(*of, dtype="float32") * 255.0
    return image[..., :3] + (1.0 - image[..., 3:] / 255.0) * np.array(background)


@pytest.mark.parametrize(
    ("name", "color"), [("black", (0, 0, 0)), ("white", (255, 255, 255)), ("dark", (0x10, 0x12, 0x16))]
)
def test_a_browser_shows_the_pixels_of_the_catalog(
    grid: Catalog, server: CatalogServer, browser: Browser, name: str, color: tuple[int, int, int]
) -> None:
    for of in (("m4", "second", 11), ("m0", "first", 30)):
        member, appearance, view = of
        fields = f"member={member}&appearance={appearance}&view={view}&background={name}&size=actual"
        browser.open(f"{server.address}#{fields}")
        assert shown(browser) == of
        screen = browser.pixels("#picture")
        assert screen.shape == (SIZE, SIZE, 3)
        assert np.abs(screen - composited(grid, color, of)).max() <= 1.0
    assert browser.complaints() == []


def test_the_page_works_from_the_file_system(grid: Catalog, browser: Browser) -> None:
    page = write_page(grid.path)
    try:
        browser.open(f"file://{page}#member=m3&view=5&background=white&size=actual")
        assert shown(browser) == ("m3", "first", 5)
        expected = composited(grid, (255, 255, 255), ("m3", "first", 5))
        assert np.abs(browser.pixels("#picture") - expected).max() <= 1.0
        assert browser.complaints() == []
    finally:
        page.unlink()


def slider(browser: Browser, number: int) -> tuple[float, float, float]:
    """Left end, length of travel and height in the window of a slider's thumb."""
    box = browser.evaluate(
        f"(({{x, y, width, height}}) => [x, y, width, height])"
        f"(document.getElementById('parameter-{number}').getBoundingClientRect())"
    )
    return box[0] + 8, box[2] - 16, box[1] + box[3] / 2


def test_sliders_move_to_members(server: CatalogServer, browser: Browser) -> None:
    browser.open(f"{server.address}#member=m0&view=3")
    assert shown(browser) == ("m0", "first", 3)
    left, length, y = slider(browser, 0)
    browser.mouse("mousePressed", left, y)
    browser.mouse("mouseMoved", left + 0.47 * length, y)
    assert shown(browser)[0] == "m2"
    browser.mouse("mouseMoved", left + 0.95 * length, y)
    assert shown(browser) == ("m4", "first", 3), "the other parameter and the view stay"
    browser.mouse("mouseReleased", left + 0.95 * length, y)
    assert browser.evaluate("+document.getElementById('parameter-0').value") == 2.0, "the thumb falls on the member"
    left, length, y = slider(browser, 1)
    browser.mouse("mousePressed", left + 0.9 * length, y)
    browser.mouse("mouseReleased", left + 0.9 * length, y)
    assert shown(browser)[0] == "m5"
    caption = browser.evaluate("document.getElementById('caption').textContent")
    assert "x 2" in caption
    assert "y<b> 5 m/s" in caption
    assert "test member" in caption
    browser.evaluate("document.getElementById('parameter-0').focus()")
    for key, expected in (("ArrowLeft", "m3"), ("ArrowLeft", "m1"), ("ArrowLeft", "m1"), ("ArrowRight", "m3")):
        browser.press(key)
        assert shown(browser)[0] == expected
    assert browser.complaints() == []


def test_menus_choose_member_and_appearance(server: CatalogServer, browser: Browser) -> None:
    browser.open(server.address)
    choose = "(id, value) => {{ const s = document.getElementById(id); s.value = value; s.onchange({{target: s}}); }}"
    browser.evaluate(f"({choose.format()})('member', '4')")
    assert shown(browser)[:2] == ("m4", "first")
    assert browser.evaluate("+document.getElementById('parameter-0').value") == 2.0
    browser.evaluate(f"({choose.format()})('appearance', '1')")
    assert shown(browser)[:2] == ("m4", "second")


def test_dragging_turns_the_thing_with_the_pointer(grid: Catalog, server: CatalogServer, browser: Browser) -> None:
    """A point on the near side, followed from picture to picture by its cameras, goes where the pointer goes.

    Only roughly: 42 viewpoints lie 36 degrees apart.
    """
    middle = np.mean(grid.plan.bounds, axis=0)
    agreements = []
    for start in (0, 5, 12, 20, 33, 41):
        for drag in ((150, 0), (-150, 0), (0, 150), (0, -150)):
            browser.open(f"{server.address}#member=m0&view={start}")
            assert shown(browser)[2] == start
            browser.mouse("mousePressed", 400, 350)
            for i in range(1, 11):
                browser.mouse("mouseMoved", 400 + drag[0] * i / 10, 350 + drag[1] * i / 10)
            browser.mouse("mouseReleased", 400 + drag[0], 350 + drag[1])
            view = shown(browser)[2]
            assert view != start
            if {start, view} & {0, 41}:
                continue  # at a pole, where "up" is another, pictures roll as they turn
            before, after = grid.plan.cameras[start], grid.plan.cameras[view]
            near = middle - 0.5 * before.forward
            moved = (after.project(near[None])[0] - before.project(near[None])[0])[0]
            agreements.append(float(np.dot(moved, drag) / np.linalg.norm(moved) / np.linalg.norm(drag)))
    assert len(agreements) >= 10
    assert min(agreements) > 0.4
    assert np.mean(agreements) > 0.8


def test_arrow_keys_and_the_globe_turn_too(server: CatalogServer, browser: Browser) -> None:
    browser.open(f"{server.address}#member=m0&view=20")
    assert shown(browser)[2] == 20
    browser.evaluate("document.getElementById('stage').focus()")
    seen = {20}
    for key in ("ArrowRight", "ArrowUp", "ArrowLeft", "ArrowDown"):
        before = shown(browser)[2]
        browser.press(key)
        browser.wait_for(f"shown.view !== {before}")
        seen.add(shown(browser)[2])
    assert len(seen) >= 3
    box = browser.evaluate("(r => [r.x, r.y])(document.getElementById('globe').getBoundingClientRect())")
    before = shown(browser)[2]
    browser.mouse("mousePressed", box[0] + 85, box[1] + 45)
    browser.mouse("mouseReleased", box[0] + 85, box[1] + 45)
    assert shown(browser)[2] != before


def test_the_address_keeps_what_is_seen(server: CatalogServer, browser: Browser) -> None:
    browser.open(f"{server.address}#member=none&view=999&background=url(x)&size=huge&appearance=second")
    assert shown(browser)[:2] == ("m0", "second")
    browser.evaluate("document.querySelector('button[data-background=white]').click()")
    browser.evaluate("document.querySelector('button[data-size=actual]').click()")
    address, seen = browser.evaluate("location.href"), shown(browser)
    assert "background=white" in address
    browser.open(address)
    assert shown(browser) == seen
    assert browser.evaluate("document.getElementById('stage').dataset.size") == "actual"
    assert browser.complaints() == []


def test_a_missing_picture_is_said_and_the_next_one_shown(
    catalog: Catalog, browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    catalog.image_path("first", "dvr", 4).unlink()
    browser.open(f"file://{write_page(catalog.path)}#member=first&view=4")
    browser.wait_for(SHOWN)
    assert "members/first/dvr/004.png can't be shown" in browser.evaluate(
        "document.getElementById('message').innerText"
    )
    browser.evaluate("document.getElementById('stage').focus()")
    browser.press("ArrowRight")
    assert shown(browser)[2] != 4
    assert browser.evaluate("document.getElementById('message').hidden")


def test_an_empty_catalog_says_so(tmp_path: Path, browser: Browser) -> None:
    browser.open(f"file://{write_page(Catalog.create(tmp_path / 'x.cdb', grid_plan()).path)}")
    assert browser.evaluate("document.getElementById('message').innerText") == "The catalog has no members yet."
    assert browser.complaints() == []


def test_members_with_cameras_of_their_own(tmp_path: Path, browser: Browser) -> None:
    """Opaque pictures on a background; a change of member goes to its nearest view."""
    plan = grid_plan(cameras=(), view_splits=(), appearances=(ImportedImages("x"),), background=(1.0, 0.5, 0.0))
    catalog = Catalog.create(tmp_path / "own.cdb", plan)
    cameras = [
        Camera.look_at(
            (1 + 4 * np.cos(a), 4 * np.sin(a), 0.5), (1, 0, 0), vertical_fov_degrees=30, width=SIZE, height=SIZE
        )
        for a in np.arange(8) * np.pi / 4
    ]
    for number, order in enumerate(([0, 1, 2, 3, 4], [6, 5, 4, 2])):
        own = [cameras[i] for i in order]
        with catalog.begin_member(
            f"m{number}", {"x": number, "y<b>": 0.0}, cameras=own, view_splits=["train"] * len(own)
        ) as writer:
            for view in range(len(own)):
                writer.write_image("x", view, picture(100 * number + view, opaque=True))
    browser.open(f"file://{write_page(catalog.path)}#member=m0&view=2&size=actual")
    assert shown(browser) == ("m0", "x", 2)
    assert np.abs(browser.pixels("#picture") - composited(catalog, (0, 0, 0), ("m0", "x", 2))).max() <= 1.0
    assert browser.evaluate("getComputedStyle(document.getElementById('stage')).backgroundColor") == "rgb(255, 128, 0)"
    browser.evaluate("chooseMember(1)")
    assert shown(browser) == ("m1", "x", 3), "the same direction as before"
    assert browser.complaints() == []


# ---- Cinema:Explorer


def test_cinema_explorer_opens_the_catalog(catalog: Catalog, tmp_path: Path, browser: Browser) -> None:
    """The way that the README describes: cinemasci installs its viewer beside the catalog, any static server serves it."""
    environment = PROJECT / ".venv-cinemasci"
    if not (environment / ".complete").exists():
        pytest.skip("cinemasci is not installed in .venv-cinemasci: `make clients` does it")
    install = ["-m", "cinemasci.install", "--path", ".", "--database", catalog.path.name, "--viewer", "explorer"]
    subprocess.run([environment / "bin/python", *install], cwd=tmp_path, check=True, capture_output=True)

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *arguments: Any) -> None:
            pass

    handler = functools.partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as host:
        threading.Thread(target=host.serve_forever, daemon=True).start()
        browser.open(f"http://127.0.0.1:{host.server_address[1]}/cinema_explorer.html")
        browser.wait_for("document.querySelectorAll('svg path').length > 40")
        requests = [
            e["params"]["request"]["url"] for e in browser.events if e.get("method") == "Network.requestWillBeSent"
        ]
        assert all(url.startswith(f"http://127.0.0.1:{host.server_address[1]}/") for url in requests), requests
        text = browser.evaluate("document.body.innerText")
        assert "Re" in text
        assert "view_split" in text
        images = "[...document.querySelectorAll('img')].filter(i => i.src.includes('/members/'))"
        browser.wait_for(f"{images}.length > 0 && {images}.every(i => i.complete && i.naturalWidth === 16)")
        host.shutdown()
