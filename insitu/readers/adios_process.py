"""The process that reads ADIOS2 files and streams for `insitu.readers.adios`, which it answers on its standard output.

On damaged files the library ends its process, or waits for ever: in a separate process that harms nobody.  A request is a JSON
object in the first argument.  An answer is the length of a JSON object (8 bytes, little-endian), that object, and the bytes of
the arrays that it lists.
"""

from __future__ import annotations

import functools
import json
import os
import resource
import struct
import sys
import time
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

KINDS = ("float", "double", "int8_t", "uint8_t", "int16_t", "uint16_t", "int32_t", "uint32_t", "int64_t", "uint64_t")
MOST_STEPS = 1_000_000
LONGEST = 64  # numbers of an attribute
PAUSE = 0.1  # seconds between two looks for a stream that is not there yet


@functools.cache
def library() -> Any:
    """The module adios2, kept from loading torch where that is installed: that takes seconds and much memory."""
    sys.modules["torch"] = None  # type: ignore[assignment]
    import adios2

    return adios2


def answer(out: BinaryIO, content: dict[str, Any], arrays: dict[str, np.ndarray] | None = None) -> None:
    """Send a JSON object, and arrays after it."""
    sent = {name: np.ascontiguousarray(values) for name, values in (arrays or {}).items()}
    listed = [{"name": n, "shape": list(v.shape), "kind": v.dtype.str, "bytes": v.nbytes} for n, v in sent.items()]
    header = json.dumps({**content, "arrays": listed}).encode()
    out.write(struct.pack("<Q", len(header)) + header)
    for values in sent.values():
        out.write(values.data.cast("B"))
    out.flush()


def variables(stream: Any) -> dict[str, dict[str, Any]]:
    """Shape, kind and number of steps of the variables that hold numbers; the shape of single ones is ()."""
    table = {}
    for name, about in stream.available_variables().items():
        shape = [int(word) for word in about.get("Shape", "").split(",") if word.strip()]
        is_single = about.get("SingleValue") == "true"
        if about.get("Type") in KINDS and (shape or is_single):
            kind = np.dtype(library().type_adios_to_numpy(about["Type"])).str
            steps = int(about.get("AvailableStepsCount", "1"))
            table[name] = {"shape": [] if is_single else shape, "kind": kind, "steps": steps}
    return table


def attributes(stream: Any) -> dict[str, Any]:
    """Attributes that are numbers or words, none of them long."""
    values: dict[str, Any] = {}
    for name, about in stream.available_attributes().items():
        if int(about.get("Elements", "1")) <= LONGEST and about.get("Type") in (*KINDS, "string"):
            value = stream.read_attribute(name)
            values[name] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    return values


def describe(out: BinaryIO, path: str) -> None:
    """All that a file says but its arrays: at which steps each variable is written, and of single numbers the value at each."""
    with library().FileReader(path) as file:
        steps, table = int(file.num_steps()), variables(file)
        differ = steps <= MOST_STEPS and any(about["steps"] != steps for about in table.values())
        some = written(path, steps) if differ else {}
        for name, about in table.items():
            about["at"] = some.get(name) if about["steps"] != steps else None  # every one
        single = {name: about["steps"] for name, about in table.items() if not about["shape"]}
        values = {n: np.ravel(file.read(n, step_selection=[0, k])).astype(float).tolist() for n, k in single.items()}
        answer(out, {"steps": steps, "variables": table, "attributes": attributes(file), "single": values})


def written(path: str, most: int) -> dict[str, list[int]]:
    """The steps at which each variable is written: only a reader that goes from step to step sees it."""
    steps: dict[str, list[int]] = {}
    io = library().Adios().declare_io("written")
    io.set_engine("BPFile")
    with library().Stream(io, path, "r") as stream:
        for step, _ in enumerate(stream.steps()):
            if step >= most:
                break
            for name in stream.available_variables():
                steps.setdefault(name, []).append(step)
    return steps


def read(out: BinaryIO, path: str, name: str, step: int) -> None:
    """One array at one step."""
    with library().FileReader(path) as file:
        values = file.read(name, step_selection=[step, 1])
        answer(out, {}, {name: np.asarray(values)})


def follow(out: BinaryIO, path: str, engine: str, names: list[str]) -> None:
    """The steps of a file that is being written, or of a stream, as they arrive; of arrays those called `names`, none for all."""
    place = Path(path) / "md.idx" if engine == "BPFile" else Path(f"{path}.sst")
    while not place.exists():
        time.sleep(PAUSE)
    io = library().Adios().declare_io("follow")
    io.set_engine(engine)
    with library().Stream(io, path, "r") as stream:
        for _ in stream.steps():
            table = variables(stream)
            single = {n: float(np.ravel(stream.read(n))[0]) for n, about in table.items() if not about["shape"]}
            chosen = [n for n, about in table.items() if len(about["shape"]) == 3 and (n in names or not names)]
            about = {"step": int(stream.current_step()), "single": single, "attributes": attributes(stream)}
            answer(out, about, {n: np.asarray(stream.read(n)) for n in chosen})


def main() -> None:
    request = json.loads(sys.argv[1])
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the library prints is not an answer
    library()  # what it takes itself is not what files take
    limit = request.pop("memory")
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    commands: dict[str, Any] = {"describe": describe, "read": read, "follow": follow}
    what = commands[request.pop("what")]
    try:
        what(out, **request)
    except (RuntimeError, ValueError, KeyError, TypeError, AttributeError, MemoryError, OSError) as error:
        answer(out, {"error": f"{type(error).__name__}: {error}"[:500]})


if __name__ == "__main__":
    main()
