"""The command as people run it, and runs that are damaged or incomplete."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from click.testing import CliRunner

from tests.support import prepared
from tests.support.explorer_process import PROGRAM, address_in, command, installed

pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")

from surrogate.cli import main
from surrogate.explore.run import Run
from tests.support.models import plain
from tests.support.requests import CAMERA, message
from tests.support.tabs import Tab, lives, post, raw_answer, served, wait

# ---- the command


UPGRADE = b"GET /ws HTTP/1.1\r\nHost: HOST\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
KEYED = UPGRADE + b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
GARBAGE = [
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",  # the hello of TLS
    b"hello\r\n\r\n",
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"X: " + b"y" * 100_000 + b"\r\n\r\n",
    b"GET /ws HTTP/1.1\r\nHost: HOST\r\n\r\n",
    UPGRADE + b"\r\n",
    KEYED,
    KEYED + b"\xff" * 100,  # no frame of a WebSocket
    KEYED + b"\x82\x05hello",  # a frame without a mask
    KEYED + b"\x82\xff\x7f\xff\xff\xff\xff\xff\xff\xffmask",  # a frame of exabytes
    b"POST /export HTTP/1.1\r\nHost: HOST\r\nContent-Length: 1000\r\n\r\n{",
    b"POST /export HTTP/1.1\r\nHost: HOST\r\nContent-Length: -1\r\n\r\n{",
    b"POST /export HTTP/1.1\r\nHost: HOST\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    b"POST /export HTTP/1.1\r\nHost: HOST\r\nContent-Encoding: gzip\r\nContent-Length: 5\r\n\r\nhello",
    b"GET /explore/explore.js HTTP/1.1\r\nHost: HOST\r\nRange: bytes=5-1\r\n\r\n",
    b"GET /explore/explore.js HTTP/1.1\r\nHost: HOST\r\nIf-Modified-Since: \xff\r\n\r\n",
    b"GET /explore/a\x00b HTTP/1.1\r\nHost: HOST\r\n\r\n",
]


def suppressed(work: Callable[..., object], *arguments: object) -> None:
    """Do it, whatever comes of it."""
    with suppress(Exception):
        work(*arguments)


@pytest.mark.slow
def test_it_prints_one_address_and_stops_on_control_c(run_folder: Path) -> None:
    with installed(run_folder) as (process, line):
        parts = urlsplit(address_in(line))
        assert parts.hostname == "127.0.0.1"
        assert parts.port not in (None, 0)
        assert (parts.path, parts.query) == ("/", "")
        with Tab(f"http://{parts.netloc}/") as tab:
            lives(tab)
            for garbage in GARBAGE:  # nothing of which the terminal shows
                with socket.create_connection(("127.0.0.1", parts.port or 0)) as wire:
                    wire.sendall(garbage.replace(b"HOST", parts.netloc.encode()))
                    wire.settimeout(0.05)
                    with suppress(TimeoutError, ConnectionResetError):
                        wire.recv(1 << 16)
            tab.send(b"noise")
            assert "error" in tab.receive()
            lives(tab)
            process.send_signal(signal.SIGINT)
            rest, complaints = process.communicate(timeout=60)
        assert (rest, complaints, process.returncode) == ("stopped\n", "", 0)


def refused(run_folder: Path, *options: str) -> str:
    """The message instead of an address."""
    status, out, errors = prepared.run(PROGRAM, "explore", run_folder, *options)
    assert (status, out) == (1, "")
    return errors


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_stops_at_once_whatever_is_being_done(run_folder: Path, tmp_path: Path, number: signal.Signals) -> None:
    shutil.copytree(run_folder, tmp_path / "run", ignore=shutil.ignore_patterns("answers"))
    with command(tmp_path / "run") as (process, line):
        address = address_in(line)
        idle = Tab(address)
        film, made = message(kind="gif", size=[1400, 1400], sweep={"name": "p", "count": 3}), []
        busy = threading.Thread(target=lambda: suppressed(lambda: made.append(post(address, film)[0])))
        busy.start()
        with Tab(address) as tab:
            lives(tab)
            wait(tab.waits(1.0))
            process.send_signal(number)
            rest, complaints = process.communicate(timeout=60)
        busy.join(timeout=60)
        idle.close()
        assert 200 not in made
        assert (rest, complaints, process.returncode) == ("stopped\n", "", 0)


@pytest.mark.slow
def test_a_port_can_be_chosen_once(run_folder: Path) -> None:
    with socket.socket() as line:
        line.bind(("127.0.0.1", 0))
        port = line.getsockname()[1]
        said = refused(run_folder, "--port", str(port))
    assert said == f"Error: port {port} of 127.0.0.1 is taken: name another one, or none for one that is free\n"
    with command(run_folder, "--port", port) as (_, line_printed):
        assert address_in(line_printed) == f"http://127.0.0.1:{port}/"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--port", "70000"], "a port lies in 0 to 65535, got 70000"),
        (["--port", "-1"], "a port lies in 0 to 65535, got -1"),
        (["--host", "no.such.host.invalid"], "no server can listen at no.such.host.invalid: "),
        (["--host", "192.0.2.1"], "no server can listen at 192.0.2.1: "),
    ],
)
def test_where_nobody_can_listen_it_says_so(run_folder: Path, options: list[str], complaint: str) -> None:
    said = refused(run_folder, *options)
    assert said.startswith(f"Error: {complaint}")
    assert said.count("\n") == 1


@pytest.mark.slow
def test_other_addresses_get_a_token(run_folder: Path) -> None:
    with command(run_folder, "--host", "0.0.0.0") as (_, line):
        parts = urlsplit(address_in(line))
        assert parts.hostname == socket.gethostname().lower()
        token = parts.query.removeprefix("token=")
        assert len(token) >= 32
        here = f"http://127.0.0.1:{parts.port}/"
        assert raw_answer(here, "/")[0] == 403
        assert raw_answer(here, f"/?token={token}")[0] == 303


def broken(run_folder: Path, folder: Path, how: str) -> Path:
    """A copy of the run in which something is not as it should be."""
    shutil.copytree(run_folder, folder, ignore=shutil.ignore_patterns("answers"))
    model, catalog = folder / "surrogate", folder / "catalog.cdb"
    match how:
        case "nothing":
            shutil.rmtree(folder)
            folder.mkdir()
        case "no model":
            shutil.rmtree(model)
        case "half a model":
            next(model.glob("*.safetensors")).unlink()
        case "noise as a model":
            next(model.glob("*.safetensors")).write_bytes(os.urandom(1000))
        case "no JSON":
            (model / "model.json").write_text("{")
        case "other JSON":
            (model / "model.json").write_text("[]")
        case "a damaged plan":
            plan = next(path for path in catalog.glob("*.json"))
            plan.write_text(plan.read_text()[:100])
        case "an empty catalog":
            shutil.rmtree(catalog)
            catalog.mkdir()
        case "a damaged member":
            record = next((catalog / "members").glob("*/*.json"))
            record.write_text(record.read_text()[:100])
        case "another model":
            from dataclasses import replace

            from catalogs.vocabulary.parameters import Parameter, ParameterSpace

            other = plain()
            space = ParameterSpace((Parameter("q", 0.0, 1.0),))
            replace(other, space=space).save(model)
    return folder


@pytest.mark.parametrize(
    "how",
    [
        "nothing",
        "no model",
        "half a model",
        "noise as a model",
        "no JSON",
        "other JSON",
        "a damaged plan",
        "an empty catalog",
        "a damaged member",
        "another model",
    ],
)
def test_what_is_broken_is_said_in_a_sentence(run_folder: Path, tmp_path: Path, how: str) -> None:
    done = CliRunner().invoke(main, ["explore", str(broken(run_folder, tmp_path / "run", how))])
    assert done.exit_code == 1, done.exception
    assert isinstance(done.exception, SystemExit)
    assert done.output.startswith("Error: ")
    assert done.output.count("\n") == 1
    assert str(tmp_path / "run") in done.output or how == "another model"


def test_paths_that_are_no_runs_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in ("file", "nowhere"):
        done = CliRunner().invoke(main, ["explore", str(tmp_path / path)])
        assert done.exit_code == 2
        assert "Traceback" not in done.output


def test_a_run_without_a_catalog_has_no_truth(run_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(run_folder / "surrogate", tmp_path / "alone" / "surrogate")
    for folder in (tmp_path / "alone", tmp_path / "alone" / "surrogate"):
        with served(Run.open(folder)) as address, Tab(address) as tab:
            facts = tab.ask("facts")
            assert (facts["truth"], facts["members"], facts["size"]) == (False, [], None)
            assert [p["train"] + p["validation"] for p in facts["parameters"]] == [[]]
            answer = tab.frame(truth=True)
            assert answer["truth"] is None
            assert "without its catalog nobody can say" in answer["expected"][0]["sentence"]
            assert tab.ask("nearest", message()) == {"found": None}


def test_a_catalog_without_members_has_no_truth(run_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(run_folder, tmp_path / "run", ignore=shutil.ignore_patterns("answers"))
    shutil.rmtree(tmp_path / "run" / "catalog.cdb" / "members")
    with served(Run.open(tmp_path / "run")) as address, Tab(address) as tab:
        assert tab.ask("facts")["truth"] is False
        assert tab.frame(truth=True)["truth"] is None
        assert tab.ask("nearest", message()) == {"found": None}


def test_an_unwritable_run_is_explored_all_the_same(run_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(run_folder, tmp_path / "run", ignore=shutil.ignore_patterns("answers"))
    (tmp_path / "run" / "answers").write_text("in the way")  # permissions would not stop root
    (tmp_path / "run").chmod(0o555)
    with served(Run.open(tmp_path / "run")) as address, Tab(address) as tab:
        lives(tab)
        for _ in range(100):
            if tab.frame()["expected"] is not None:
                break
            wait(tab.waits(0.1))
        (near,) = tab.frame()["expected"]
        assert near["psnr"] is None
        assert near["short"] == "never shown in training: no stored image looks from there"
        (inside,) = tab.frame(camera={**CAMERA, "position": [4.9, 1.0, 0.5], "target": [0, 0, 0], "field": 32})[
            "expected"
        ]
        assert inside["psnr"] > 0
    assert (tmp_path / "run" / "answers").read_text() == "in the way"


def test_damaged_pictures_are_told_of_without_their_paths(run_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(run_folder, tmp_path / "run")
    for picture in (tmp_path / "run" / "catalog.cdb").rglob("*.png"):
        picture.write_bytes(b"no picture")
    with served(Run.open(tmp_path / "run")) as address, Tab(address) as tab:
        facts = tab.ask("facts")
        member, view = facts["members"][0], facts["camera"]
        eye = [t + view["distance"] * d for t, d in zip(view["target"], view["direction"], strict=True)]
        camera = {"position": eye, "target": view["target"], "up": view["up"], "field": view["field"]}
        shown_there = {
            "settings": [{"parameters": {"p": member["values"][0]}}],
            "size": facts["size"],
            "camera": camera,
        }
        answer = tab.frame(**shown_there, truth=True)
        assert answer == {"error": "a stored picture can't be read: the explorer's terminal says which"}
        lives(tab)
