"""How files and folders that must survive a crash come to disk: write, sync, rename.

Whatever is committed goes through these functions in this order: contents, `sync` of the file, `rename` into place,
`sync` of the folder (Pillai et al., "All File Systems Are Not Created Equal", OSDI 2014, section 4).  The tests kill a
writer before, within and after every one of them, and take away what was not synced.

Written here rather than taken from a library: packages that replace a file atomically rename without syncing folders, know no
folders of files, and can't tell a dead writer's remains from what a living one is writing.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import functools
import hashlib
import os
import secrets
import shutil
import signal
import socket
import stat
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO, NamedTuple

PARTIAL = ".partial"
SYNCS_AT_ONCE = 16
BLOCK = 1 << 20  # bytes of what comes in pieces that are written at once
QUIET_SECONDS = 86400.0  # without a change, after which a writer elsewhere counts as dead
HERE = -100  # AT_FDCWD of openat(2)
EXCHANGE = 2  # RENAME_EXCHANGE of renameat2(2)
KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class SpecialFileError(OSError):
    """A named pipe, which would be waited for, a device, which need not end, or a folder, where a regular file belongs."""


class Stamp(NamedTuple):
    """What tells a file from any other and from itself after a change."""

    inode: int
    size: int
    changed: int  # nanoseconds


def stamp(path: Path) -> Stamp:
    """The stamp of a file or folder, which is opened for it: network file systems then ask their server."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
    finally:
        os.close(descriptor)
    return Stamp(status.st_ino, status.st_size, status.st_mtime_ns)


def special(path: Path) -> str:
    """What stands at `path` where a regular file belongs, such as "a named pipe"; "" for a regular file, and for nothing."""
    try:
        return _kind(os.stat(path).st_mode)
    except OSError:
        return ""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """The regular file `path`, opened to be read; raises SpecialFileError for anything else, OSError where there is nothing."""
    _refuse_special(path, os.stat(path).st_mode)  # first: opening a device can have effects
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as stream:
        _refuse_special(path, os.fstat(descriptor).st_mode)
        yield stream


def read(path: Path) -> bytes:
    """The contents of a regular file; raises OSError as `opened` does."""
    with opened(path) as stream:
        return stream.read()


def write(path: Path, data: bytes) -> None:
    """Write `data` to a new or existing file, neither synced nor atomic: for files nobody reads yet."""
    try:
        with open(path, "wb") as stream:
            stream.write(data)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None  # a full disk's error names no file by itself


def append(path: Path, data: bytes) -> None:
    """Add `data` to the end of a file, neither synced nor atomic."""
    try:
        with open(path, "ab") as stream:
            stream.write(data)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


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


def link(source: Path, target: Path) -> None:
    """Give the file `source` the further name `target`."""
    os.link(source, target)


def exchange(first: Path, second: Path) -> None:
    """Atomically let two files or folders change places; raises OSError where the file system can't (renameat2(2))."""
    library = ctypes.CDLL(None, use_errno=True)
    if not hasattr(library, "renameat2"):
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS), str(first))
    if library.renameat2(HERE, os.fsencode(first), HERE, os.fsencode(second), EXCHANGE):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(first), None, str(second))


def opened_elsewhere(path: Path) -> bool:
    """Whether anybody may have the file open; True, too, where the system can't tell (it has no leases, or not there)."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return True
    try:  # fcntl(2): a write lease is granted only where no other descriptor is open
        fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGURG)  # who opens it now sends a signal: one that is ignored
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_WRLCK)
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    except (OSError, AttributeError):
        return True
    finally:
        os.close(descriptor)
    return False


def copy(source: Path, target: Path) -> None:
    """Copy a file's contents within the kernel, where possible without moving them; not synced."""
    with open(source, "rb") as old, open(target, "wb") as new:
        try:
            while os.copy_file_range(old.fileno(), new.fileno(), 1 << 30):
                pass
        except (OSError, AttributeError) as error:
            if isinstance(error, OSError) and error.errno == errno.ENOSPC:
                raise OSError(error.errno, error.strerror, str(target)) from None
            old.seek(0)
            new.seek(0)
            shutil.copyfileobj(old, new)


@contextlib.contextmanager
def staged(path: Path, data: bytes | Iterable[bytes]) -> Iterator[None]:
    """Put `data`, whole or in pieces, on disk beside `path` before the block, and in its place after.

    A reader sees the old or the new contents and nothing between; an exception leaves `path` as it was.  A full disk is noticed
    before the block.
    """
    partial = partial_name(path)
    try:
        blocks = _blocks([data] if isinstance(data, bytes) else data)
        write(partial, next(blocks, b""))
        for block in blocks:
            append(partial, block)
        sync(partial)
        yield
        rename(partial, path)
        sync(path.parent)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def holds(path: Path, pieces: Iterable[bytes]) -> bool:
    """Whether the contents of a regular file are these pieces one after the other; False, too, where there is none."""
    try:
        with opened(path) as stream:
            return all(stream.read(len(piece)) == piece for piece in pieces) and not stream.read(1)
    except FileNotFoundError:
        return False


def replace(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Replace the contents of `path` by `data`, durably and atomically."""
    with staged(path, data):
        pass


def make_folder(path: Path) -> None:
    """Create `path` and its missing parents, durably."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        sync(folder.parent)


def sync_tree(folder: Path) -> None:
    """Make everything in and below `folder` durable.

    Files are synced side by side, so that the file system commits many at once.
    """
    folders = [Path(inner) for inner, _, _ in os.walk(folder, topdown=False)]
    files = [path for inner in folders for path in sorted(inner.iterdir()) if path.is_file()]
    with ThreadPoolExecutor(SYNCS_AT_ONCE) as pool:
        list(pool.map(sync, files))
    for inner in folders:
        sync(inner)


def commit_folder(partial: Path, target: Path) -> None:
    """Make everything below `partial` durable, then let it appear as `target`, whole."""
    sync_tree(partial)
    rename(partial, target)
    sync(target.parent)


def partial_name(path: Path) -> Path:
    """A hidden sibling of `path` that says which process writes it, so that others know when its writer is dead."""
    process = os.getpid()
    writer = f"{socket.gethostname()}~{_process_space()}~{process}~{_start_time(process)}"
    return path.with_name(f".{path.name}~{writer}~{secrets.token_hex(4)}{PARTIAL}")


def partials(folder: Path) -> list[Path]:
    """Files and folders in `folder` that are being written, or were when their writer died."""
    return sorted(folder.glob(f".*~*{PARTIAL}"))


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove and return the partial files and folders in `folder` whose writer is dead.

    A writer of another host, container or boot can't be seen: it counts as dead when nothing changed for a day.
    """
    removed = []
    for path in partials(folder):
        if not _abandoned(path):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        removed.append(path)
    return removed


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the file lock `path` (created if needed); the kernel releases it when its holder dies.

    Raises OSError naming the place where the file system has no locks (some network mounts).
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP):
                raise
            reason = "this file system has no file locks, without which writers would overwrite each other"
            raise OSError(error.errno, f"{reason}: mount it with flock, or write elsewhere", str(path)) from error
        yield
    finally:
        os.close(descriptor)


def _blocks(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """The pieces, small ones joined."""
    held, size = [], 0
    for piece in pieces:
        held.append(piece)
        size += len(piece)
        if size >= BLOCK:
            yield b"".join(held)
            held, size = [], 0
    if held:
        yield b"".join(held)


def _refuse_special(path: Path, mode: int) -> None:
    if kind := _kind(mode):
        raise SpecialFileError(f"{path} is {kind}, where a regular file belongs")


def _kind(mode: int) -> str:
    return next((name for is_kind, name in KINDS if is_kind(mode)), "")


def _abandoned(path: Path) -> bool:
    parts = path.name.removesuffix(PARTIAL).split("~")
    if len(parts) < 6:
        return False  # not ours
    host, space, process, start = parts[-5:-1]
    if (host, space) == (socket.gethostname(), _process_space()) and process.isdigit():
        return _start_time(int(process)) != start
    try:
        return time.time() - _last_change(path) > QUIET_SECONDS
    except FileNotFoundError:
        return False  # its writer has just finished


def _last_change(path: Path) -> float:
    inner = [folder for folder in path.iterdir() if folder.is_dir()] if path.is_dir() else []
    return max(entry.lstat().st_mtime for entry in (path, *inner))


@functools.cache
def _process_space() -> str:
    """Where process numbers are unique, as 8 hex digits: this boot of this machine, and this container."""
    known = []
    with contextlib.suppress(OSError):
        known.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        known.append(os.readlink("/proc/self/ns/pid"))
    return hashlib.sha256("".join(known).encode()).hexdigest()[:8]


def _start_time(process: int) -> str:
    """When a process started, in ticks since boot; "0" where the system doesn't say, "" where there is no such process.

    A number may be given to a new process soon after the old one's death; together with the start it is unique.
    """
    try:
        status = Path(f"/proc/{process}/stat").read_bytes().rpartition(b")")[2].split()  # proc(5): fields 3, 4, ...
        return "" if status[0] in (b"Z", b"X") else status[19].decode()  # a zombie writes no more
    except (OSError, IndexError):
        pass
    if Path("/proc/self/stat").exists():
        return ""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return ""
    except PermissionError:
        pass
    return "0"
