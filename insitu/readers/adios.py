"""ADIOS2: BP files, read a step at a time, and files and streams that are followed while a simulation writes them.

The library crashes or hangs on damaged files, so another process reads (`adios_process`); what it answers is checked here.
"""

from __future__ import annotations

import json
import math
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import shortened
from insitu.readers.adios_process import MOST_STEPS
from insitu.readers.arrays import Arrays, StoredArray, check_room
from insitu.readers.reader import Reader, Sampling, StoredState

PATIENCE = 60.0  # seconds that the process may take before it answers, and
SLOWEST = 1e7  # bytes a second after that
ASLEEP = 4.0  # seconds that it may sleep at a stretch: of data cut short, the library sleeps until they come
POLL = 0.25  # seconds between two looks at it
BUSY = 0.05  # part of the time in which a process that works uses a processor
LARGEST = 1 << 26  # bytes of a description
BASE = 1 << 31  # bytes of address space that the process takes without any data
ADIOS2 = "reading ADIOS2 takes its library: pip install 'gs-surrogate[adios2]'"
STREAM = ".sst"  # what a stream's contact file is called
MARKS = ("md.idx", "md.0")  # in a folder of BP4 or BP5


@dataclass(frozen=True, eq=False)
class StreamStep:
    """One step as it arrived: its single numbers, and its arrays with three axes, their attributes beside them."""

    number: int
    says: Mapping[str, float]
    arrays: Arrays


def recognizes(path: Path) -> bool:
    """True if it is a BP folder (BP4, BP5), or a file that ends with .bp (BP3)."""
    return all((path / name).is_file() for name in MARKS) or (path.suffix == ".bp" and path.is_file())


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """Every step, with the single numbers that the file holds of it, its attributes that are numbers, and its number."""
    description = _described(path)
    common = _numbers(description["attributes"])
    volumes = {name: about["places"] for name, about in description["variables"].items() if len(about["shape"]) == 3}
    states = []
    for step in range(description["steps"]):
        says = {**common, **{n: values[step] for n, values in description["single"].items() if step in values}}
        arrays = frozenset(name for name, places in volumes.items() if step in places)
        states.append(StoredState((step,), {**says, "step": float(step)}, arrays))
    return states


@contextmanager
def opens(path: Path) -> Iterator[Arrays]:
    """The arrays of a file as (step, axis, axis, axis); values are read when asked for."""
    description = _described(path)
    arrays = {}
    for name, about in description["variables"].items():
        shape, kind = tuple(about["shape"]), np.dtype(about["kind"])
        if len(shape) == 3:
            own, fetch = _own(description["attributes"], name), _fetch(path, name, shape, kind, about["places"])
            arrays[name] = StoredArray(name, (description["steps"], *shape), kind, ("step", "", "", ""), own, fetch)
    yield Arrays(arrays, {"": description["attributes"]})


def follow(path: Path, names: tuple[str, ...] = (), idle: float | None = None) -> Iterator[StreamStep]:
    """The steps of a BP file that is being written, or of an SST stream (`name.sst`), as they arrive.

    Parameters
    ----------
    path : of the BP folder or of the stream's contact file; it need not be there yet.
    names : of the arrays that are wanted; () for all with three axes.
    idle : seconds without a step after which this ends; None waits until the writer closes the file.

    Raises ValueError where the library gives up.
    """
    engine = "SST" if path.suffix == STREAM else "BPFile"
    stream = path.with_suffix("") if engine == "SST" else path
    with _process({"what": "follow", "path": str(stream), "engine": engine, "names": list(names)}) as process:
        while (step := _answer(process, path, idle)) is not None:
            attributes = step["attributes"]
            arrays = {
                about["name"]: _arrived(about["name"], _values(process, path, about), _own(attributes, about["name"]))
                for about in step["arrays"]
            }
            says = {**_numbers(attributes), **step["single"], "step": float(step["step"])}
            yield StreamStep(step["step"], says, Arrays(arrays, {"": attributes}))


def _arrived(name: str, values: NDArray[Any], attributes: Mapping[str, Any]) -> StoredArray:
    return StoredArray(name, values.shape, values.dtype, ("", "", ""), attributes, lambda index: values[index])


def _described(path: Path) -> dict[str, Any]:
    with _process({"what": "describe", "path": str(path)}) as process, _ended_after(process, PATIENCE):
        summary = _answer(process, path, None)
    if summary is None or not 1 <= summary["steps"] <= MOST_STEPS:
        raise ValueError(f"{path}: it holds {summary['steps'] if summary else 'no'} steps")
    if "/openPMD" in summary["attributes"]:
        raise ValueError(
            f"{path}: openPMD is read from HDF5: convert it by openpmd-pipe --infile {path.name} --outfile {path.stem}_%T.h5"
        )
    for name, about in summary["variables"].items():
        at = range(summary["steps"]) if about["at"] is None else about["at"]
        if any(n < 0 for n in about["shape"]) or np.dtype(about["kind"]).kind not in "fiu" or len(at) != about["steps"]:
            raise ValueError(f"{path}: its variable {name[:40]!r} has the shape {about['shape']} at {len(at)} steps")
        # Of each step, which of the values it has; what is written once, at first, holds for all.
        places = (
            dict.fromkeys(range(summary["steps"]), 0) if list(at) == [0] else {n: place for place, n in enumerate(at)}
        )
        about["places"] = places
        if name in summary["single"]:
            values = summary["single"][name]
            summary["single"][name] = {n: float(values[place]) for n, place in places.items()}
    return summary


def _fetch(
    path: Path, name: str, shape: tuple[int, ...], kind: np.dtype[Any], places: Mapping[int, int]
) -> Callable[[tuple[int, ...]], Any]:
    """Reads an array at a step; `places` says of the steps that have it which of its values it is."""

    def fetch(index: tuple[int, ...]) -> Any:
        if index[0] not in places:
            raise ValueError(f"it is not written at step {index[0]}, but at {shortened(list(map(str, places)), 8)}")
        request = {"what": "read", "path": str(path), "name": name, "step": places[index[0]]}
        seconds = PATIENCE + math.prod(shape) * kind.itemsize / SLOWEST
        with _process(request) as process, _ended_after(process, seconds):
            reply = _answer(process, path, None)
            if reply is None or not reply["arrays"]:
                raise ValueError(f"{path}: ADIOS2 gave nothing of {name!r}")
            values = _values(process, path, reply["arrays"][0])
        if values.size != math.prod(shape):
            raise ValueError(f"{path}: {name!r} has {values.shape} values, its description says {shape}")
        return values.reshape(shape)

    return fetch


def _numbers(attributes: Mapping[str, Any]) -> dict[str, float]:
    """The attributes of the file that are single numbers."""
    single = {n: v[0] if isinstance(v, list) and len(v) == 1 else v for n, v in attributes.items() if "/" not in n}
    return {n: float(v) for n, v in single.items() if isinstance(v, int | float) and math.isfinite(v)}


def _own(attributes: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The attributes of one variable, which are called name/attribute."""
    return {key.removeprefix(f"{name}/"): value for key, value in attributes.items() if key.startswith(f"{name}/")}


# ---- the other process -----------------------------------------------------------------------------------------------


@contextmanager
def _process(request: Mapping[str, Any]) -> Iterator[subprocess.Popen[bytes]]:
    """A process that answers a request, and is ended however this ends."""
    import psutil

    if find_spec("adios2") is None:
        raise ModuleNotFoundError(ADIOS2)
    words = json.dumps({**request, "memory": BASE + psutil.virtual_memory().available})
    command = [sys.executable, "-P", "-m", "insitu.readers.adios_process", words]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL, bufsize=0, env=environment
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout:
            process.stdout.close()


@contextmanager
def _ended_after(process: subprocess.Popen[bytes], seconds: float) -> Iterator[None]:
    """Kill a process that takes longer than `seconds`, or sleeps, which waiting for a disk is not."""
    done = threading.Event()
    watch = threading.Thread(target=_watch, args=(process, seconds, done), daemon=True)
    watch.start()
    try:
        yield
    finally:
        done.set()
        watch.join()


def _watch(process: subprocess.Popen[bytes], seconds: float, done: threading.Event) -> None:
    import psutil

    end = time.monotonic() + seconds
    since, used = time.monotonic(), 0.0
    with suppress(psutil.Error):  # it ended
        reader = psutil.Process(process.pid)
        while not done.wait(min(POLL, max(0.0, end - time.monotonic()))):
            now, work = time.monotonic(), sum(reader.cpu_times()[:2])
            if reader.status() != psutil.STATUS_SLEEPING or work - used > BUSY * (now - since):
                since, used = now, work
            if now >= end or now - since > ASLEEP:
                process.kill()
                return


def _answer(process: subprocess.Popen[bytes], path: Path, idle: float | None) -> dict[str, Any] | None:
    """The next answer but its arrays; None where there is none any more, or none for `idle` seconds.  ValueError for an error."""
    assert process.stdout is not None
    if idle is not None and not select.select([process.stdout], [], [], idle)[0]:
        return None
    head = np.zeros(1, dtype="<u8")
    if not _fill(process, head):
        if code := process.wait():
            raise ValueError(f"{path}: {_ending(code)}")
        return None
    if head[0] > LARGEST:
        raise ValueError(f"{path}: its description has {head[0]} bytes")
    description = np.zeros(int(head[0]), dtype=np.uint8)
    if not _fill(process, description):
        raise ValueError(f"{path}: {_ending(process.wait())}")
    reply = json.loads(description.tobytes())
    if "error" in reply:
        raise ValueError(f"{path}: ADIOS2 cannot read it: {' '.join(reply['error'].split())}")
    return dict(reply)


def _fill(process: subprocess.Popen[bytes], values: NDArray[Any]) -> bool:
    """Fill an array with what a process writes; False where it ends before."""
    output: Any = process.stdout
    room, done = values.reshape(-1).view(np.uint8), 0
    while done < len(room):
        count = output.readinto(room[done:])
        if not count:
            return False
        done += count
    return True


def _ending(code: int) -> str:
    """The end of a process that gave no answer, in words."""
    if code == -signal.SIGKILL:
        return "ADIOS2 did not answer in time: was the file cut short or damaged, or is it being written?"
    how = f"signal {-code}" if code < 0 else f"status {code}"
    return f"ADIOS2 ended its process ({how}) when reading it: it is damaged"


def _values(process: subprocess.Popen[bytes], path: Path, about: Mapping[str, Any]) -> NDArray[Any]:
    """The array that follows an answer."""
    kind, shape = np.dtype(about["kind"]), tuple(about["shape"])
    if kind.kind not in "fiu" or math.prod(shape) * kind.itemsize != about["bytes"]:
        raise ValueError(f"{path}: {about['name']!r} claims {about['bytes']} bytes of {kind} {shape}")
    check_room(about["bytes"], repr(about["name"]))
    values = np.empty(shape, dtype=kind)
    if not _fill(process, values):
        raise ValueError(f"{path}: {_ending(process.wait())}")
    return values


READER = Reader("adios2", "ADIOS2, BP folders and files", recognizes, records, opens=opens, marks=MARKS, grows=True)
