"""A Jupyter server with jupyter-server-proxy, below a path of its own as JupyterHub starts them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.request import urlopen

PREFIX = "/user/name/"
TOKEN = "known-to-the-test"
PATIENCE = 60.0  # seconds


@contextmanager
def jupyter(folder: Path, host: str) -> Iterator[str]:
    """The address `http://host:port` of a server that keeps its files in `folder`; `login` lets a browser in."""
    with socket.socket() as line:
        line.bind(("127.0.0.1", 0))
        port = line.getsockname()[1]
    options = {
        "ServerApp.ip": "127.0.0.1",
        "ServerApp.port": port,
        "ServerApp.base_url": PREFIX,
        "ServerApp.root_dir": folder,
        "ServerApp.allow_remote_access": True,
        "ServerApp.allow_root": True,
        "ServerApp.open_browser": False,
        "ServerApp.jpserver_extensions": "jupyter_server_proxy=True",
        "IdentityProvider.token": TOKEN,
    }
    here = dict.fromkeys(("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"), str(folder))
    process = subprocess.Popen(
        [sys.executable, "-m", "jupyter_server", *(f"--{name}={value}" for name, value in options.items())],
        env={**os.environ, **here, "JUPYTER_PLATFORM_DIRS": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + PATIENCE
        while process.poll() is None and time.monotonic() < deadline:
            with suppress(OSError), urlopen(login(f"http://127.0.0.1:{port}"), timeout=PATIENCE):
                break
            time.sleep(0.1)
        yield f"http://{host}:{port}"
    finally:
        process.terminate()
        process.wait(timeout=PATIENCE)


def login(address: str) -> str:
    """The address that logs a browser in."""
    return f"{address}{PREFIX}api/status?token={TOKEN}"
