"""Crash-safe writing of files and folders: write, sync, rename.

Every commit goes through these functions in this order: contents, `sync` of the file, `rename` into place, `sync` of the folder.
See Pillai et al., "All File Systems Are Not Created Equal", OSDI 2014, section 4.  The tests kill a writer before, within and after
each of them, and take away what was not synced.

Written here rather than taken from a library.  Packages that replace a file atomically don't sync folders, handle single files
only, and can't distinguish a dead writer's remains from a living writer's work.
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
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from pathlib import Path
from typing import BinaryIO, NamedTuple

PARTIAL = ".partial"
PARTIAL_NAMES = f".*~*{PARTIAL}"
SYNCS_AT_ONCE = 16
BLOCK = 1 << 20  # bytes per write of data that comes in pieces
QUIET_SECONDS = 86400.0  # without a change, after which a writer on another machine counts as dead
AT_FDCWD = -100  # openat(2): paths are relative to the working directory
RENAME_EXCHANGE = 2  # renameat2(2)
SPECIAL_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class SpecialFileError(OSError):
    """A named pipe, a device, a socket or a folder in place of a regular file."""


class Stamp(NamedTuple):
    """Identity of a file and its contents: differs for another file and after a change."""

    inode: int
    size: int
    changed: int  # nanoseconds


def stamp(path: Path) -> Stamp:
    """The stamp of a file or folder; opening it makes network file systems ask their server."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
    finally:
        os.close(descriptor)
    return Stamp(status.st_ino, status.st_size, status.st_mtime_ns)


def special(path: Path) -> str:
    """The kind of special file at `path`, such as "a named pipe"; "" for a regular file, and where there is none."""
    try:
        return _special_kind(os.stat(path).st_mode)
    except OSError:
        return ""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """The regular file `path`, open for reading; raises SpecialFileError for any other kind, OSError where it is absent."""
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
    _put(path, "wb", data)


def require_writable(path: Path, remedy: str = "nothing can be written there") -> None:
    """Raise OSError, with a remedy, where nothing can be written at `path`: tried where it would be, and left as it was."""
    require_expanded(path)
    place = path.absolute()
    while not os.path.lexists(place):
        place = place.parent
    try:
        with tempfile.TemporaryDirectory(prefix=".gs-", dir=place) as folder:
            write(Path(folder, "block"), bytes(BLOCK))
    except OSError as error:
        raise OSError(error.errno, f"{error.strerror}: {remedy}", str(path)) from None


def append(path: Path, data: bytes) -> None:
    """Add `data` to the end of a file, neither synced nor atomic."""
    _put(path, "ab", data)


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
    """Atomically swap two files or folders; raises OSError where the file system can't (renameat2(2))."""
    library = ctypes.CDLL(None, use_errno=True)
    if not hasattr(library, "renameat2"):
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS), str(first))
    if library.renameat2(AT_FDCWD, os.fsencode(first), AT_FDCWD, os.fsencode(second), RENAME_EXCHANGE):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(first), None, str(second))


def opened_elsewhere(path: Path) -> bool:
    """True where another process may have the file open; always True without file leases."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return True
    try:  # fcntl(2): a write lease is granted only where no other descriptor is open
        fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGURG)  # sent when somebody opens it now; ignored by default
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
    """Write `data`, whole or in pieces, to a file beside `path` before the block, and rename it to `path` after.

    A reader sees the old or the new contents, never a mixture; an exception leaves `path` unchanged.  A full disk raises OSError
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
    """True where a regular file exists and its contents are these pieces joined."""
    try:
        with opened(path) as stream:
            return all(stream.read(len(piece)) == piece for piece in pieces) and not stream.read(1)
    except FileNotFoundError:
        return False


def replace(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Replace the contents of `path` by `data`, durably and atomically."""
    with staged(path, data):
        pass


def require_expanded(path: Path) -> None:
    """Raise ValueError for a path that begins with `~`, which shells expand and nobody else: it would name a new folder."""
    first = path.parts[0] if path.parts else ""
    if first.startswith("~") and not Path(first).exists():
        raise ValueError(f"{path} names a folder called {first}, which a shell alone replaces: write that out")


def make_folder(path: Path) -> None:
    """Create `path` and its missing parents, durably; raises ValueError for a path that `require_expanded` refuses."""
    require_expanded(path)
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        sync(folder.parent)


def sync_tree(folder: Path) -> None:
    """Make everything in and below `folder` durable; files in parallel, so that the file system commits many at once."""
    folders = [Path(inner) for inner, _, _ in os.walk(folder, topdown=False)]
    files = [path for inner in folders for path in sorted(inner.iterdir()) if path.is_file()]
    with ThreadPoolExecutor(SYNCS_AT_ONCE) as pool:
        list(pool.map(sync, files))
    for inner in folders:
        sync(inner)


def commit_folder(partial: Path, target: Path) -> None:
    """Make everything below `partial` durable, then rename it to `target`."""
    sync_tree(partial)
    rename(partial, target)
    sync(target.parent)


def write_folder(target: Path, files: Mapping[str, bytes]) -> None:
    """Make the folder `target` of files by their paths in it, durably: all of it or nothing."""
    partial = partial_name(target)
    try:
        for name, data in files.items():
            path = partial / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, data)
        commit_folder(partial, target)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def partial_name(path: Path) -> Path:
    """A hidden sibling of `path` whose name identifies the writing process, so that others can see when that is dead."""
    process = os.getpid()
    writer = f"{socket.gethostname()}~{_process_space()}~{process}~{_start_time(process)}"
    return path.with_name(f".{path.name}~{writer}~{secrets.token_hex(4)}{PARTIAL}")


def partials(folder: Path) -> list[Path]:
    """Files and folders in `folder` that are being written or whose writer died."""
    return sorted(folder.glob(PARTIAL_NAMES))


def is_partial(name: str) -> bool:
    """True for a name by `partial_name`."""
    return fnmatchcase(name, PARTIAL_NAMES)


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove and return the partial files and folders in `folder` whose writer is dead.

    The writer on another host, in another container or before a reboot counts as dead when nothing changed for a day.
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


def _put(path: Path, mode: str, data: bytes) -> None:
    try:
        with open(path, mode) as stream:
            stream.write(data)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None  # a full disk's error names no file by itself


def _blocks(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """The pieces, joined to blocks of at least `BLOCK` bytes."""
    block: list[bytes] = []
    for piece in pieces:
        block.append(piece)
        if sum(map(len, block)) >= BLOCK:
            yield b"".join(block)
            block = []
    if block:
        yield b"".join(block)


def _refuse_special(path: Path, mode: int) -> None:
    if kind := _special_kind(mode):
        raise SpecialFileError(f"{path} is {kind}, not a regular file")


def _special_kind(mode: int) -> str:
    return next((name for is_kind, name in SPECIAL_KINDS if is_kind(mode)), "")


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
        return False  # just committed


def _last_change(path: Path) -> float:
    inner = [folder for folder in path.iterdir() if folder.is_dir()] if path.is_dir() else []
    return max(entry.lstat().st_mtime for entry in (path, *inner))


@functools.cache
def _process_space() -> str:
    """8 hex digits for this boot of this machine and this container, within which process numbers are unique."""
    parts = []
    with contextlib.suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        parts.append(os.readlink("/proc/self/ns/pid"))
    return hashlib.sha256("".join(parts).encode()).hexdigest()[:8]


def _start_time(process: int) -> str:
    """Start of a process in ticks since boot; "0" where the system has no /proc, "" for a dead process.

    Process numbers are reused; number and start together are unique.
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
