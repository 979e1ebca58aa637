"""The only door to the disk for what must survive a crash: write, sync, rename.

Whatever is committed goes through these functions in this order: contents, `sync` of the file, `rename` into place,
`sync` of the folder (Pillai et al., "All File Systems Are Not Created Equal", OSDI 2014, section 4).  The tests kill a
writer before and after every one of them.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import shutil
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

PARTIAL = ".partial"
SYNCS_AT_ONCE = 16


def write(path: Path, data: bytes) -> None:
    """Write `data` to a new or existing file, neither synced nor atomic: for files nobody reads yet."""
    with open(path, "wb") as stream:
        stream.write(data)


def sync(path: Path) -> None:
    """Make a file's contents, or a folder's entries, durable."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def rename(source: Path, target: Path) -> None:
    """Atomically give `source` the name `target`, replacing a file of that name."""
    os.replace(source, target)


def replace(path: Path, data: bytes) -> None:
    """Let `path` hold `data`, durably, so that a reader sees the old or the new contents and nothing between."""
    partial = partial_name(path)
    try:
        write(partial, data)
        sync(partial)
        rename(partial, path)
        sync(path.parent)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def commit_folder(partial: Path, target: Path) -> None:
    """Make everything below `partial` durable, then let it appear as `target`, whole.

    Files are synced side by side, so that the file system commits many at once.
    """
    folders = [Path(folder) for folder, _, _ in os.walk(partial, topdown=False)]
    files = [path for folder in folders for path in sorted(folder.iterdir()) if path.is_file()]
    with ThreadPoolExecutor(SYNCS_AT_ONCE) as pool:
        list(pool.map(sync, files))
    for folder in folders:
        sync(folder)
    rename(partial, target)
    sync(target.parent)


def partial_name(path: Path) -> Path:
    """A hidden sibling of `path` that says which process of which host writes it."""
    return path.with_name(f".{path.name}.{socket.gethostname()}.{os.getpid()}.{secrets.token_hex(4)}{PARTIAL}")


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove and return partial files and folders in `folder` whose writer, on this host, is no longer alive."""
    removed = []
    for path in sorted(folder.glob(f".*{PARTIAL}")):
        host, _, process = path.name[: -len(PARTIAL)].rsplit(".", 1)[0].rpartition(".")
        if not host.endswith(socket.gethostname()) or not process.isdigit() or _alive(int(process)):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        removed.append(path)
    return removed


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the file lock `path` (created if needed); the kernel releases it when its holder dies."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _alive(process: int) -> bool:
    if process == os.getpid():
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
