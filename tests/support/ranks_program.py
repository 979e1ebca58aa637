"""The program of the ranks in tests of decomposed fields: `mpiexec -n 4 python -m tests.support.ranks_program FOLDER PART...`.

Each rank leaves what it got of each part in rank-N.json.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import insitu
from insitu import Isosurface, Session, TransferFunction, ViewPlan, VolumeRendering
from insitu.bindings.blueprint import BlueprintSession
from tests.support.decomposed import kd_boxes

COMM = MPI.COMM_WORLD
SHAPE, STEP, ORIGIN = (30, 26, 35), 0.06, np.array([-1.0, 2.0, 5.0])
FUNCTION = TransferFunction(((-1.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.1, 0.0)), ((-1.0, 0.0), (0.0, 0.1), (1.0, 0.8)), 0.4)
SHOWN = [
    VolumeRendering("plain", FUNCTION, field="a"),
    VolumeRendering("shaded", FUNCTION, shaded=True, field="b"),
    Isosurface("surface", 0.3, field="a"),
]
OPTIONS: dict[str, Any] = {"space": {"p": (0.0, 1.0)}, "views": ViewPlan(frequency=1, width=48, height=40)}


def field(phase: float) -> Any:
    """A gyroid on all samples, float64."""
    z, y, x = np.meshgrid(*(STEP * np.arange(n) for n in SHAPE), indexing="ij")
    a, b, c = 4 * x + phase, 5 * y, 3.5 * z
    return (np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)) / 1.5


def mine(values: Any, boxes: Any) -> tuple[Any, dict[str, Any]]:
    """This rank's part of the values, and where it lies."""
    box = boxes[COMM.rank]
    part = values[tuple(map(slice, box.start, box.stop))]
    return part, {"spacing": (STEP,) * 3, "origin": ORIGIN + STEP * np.array(box.start[::-1])}


def outcome(work: Callable[[], Any]) -> str:
    """The result, in words."""
    try:
        result = work()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return str(getattr(result, "error", result) or "rendered" * (not getattr(result, "skipped", False)) or "skipped")


def pictures(folder: Path, boxes: Any, told: dict[str, Any]) -> None:
    """One member in blocks, in one block, and as ever."""
    for form in ("png", "exr"):
        options = {**OPTIONS, "appearances": SHOWN, "image_format": form}
        parts = {name: mine(field(phase), boxes) for name, phase in (("a", 0.0), ("b", 1.0))}
        with Session(folder / f"blocks-{form}.cdb", comm=COMM, **options) as session:
            told[f"has {form} before"] = session.has({"p": 0.5})
            data, place = {name: part for name, (part, _) in parts.items()}, parts["a"][1]
            told[f"rendered {form}"] = outcome(lambda: session.render_member(data, {"p": 0.5}, **place))  # noqa: B023
            told[f"has {form}"] = session.has({"p": 0.5})
            told[f"again {form}"] = outcome(lambda: session.render_member(data, {"p": 0.5}, existing="skip", **place))  # noqa: B023
        if COMM.rank == 0:
            whole = {"a": field(0.0), "b": field(1.0)}
            for name, comm in (("one", MPI.COMM_SELF), ("alone", None)):
                with Session(folder / f"{name}-{form}.cdb", comm=comm, **options) as session:
                    session.render_member(whole, {"p": 0.5}, spacing=(STEP,) * 3, origin=ORIGIN)


def partitions(folder: Path, boxes: Any, told: dict[str, Any]) -> None:
    """Shared layers, ghost layers, ranks without a block, two resolutions."""
    appearances = [VolumeRendering("plain", FUNCTION)]
    whole, (part, place) = field(0.0), mine(field(0.0), boxes)
    with Session(
        folder / "partitions.cdb", comm=COMM, appearances=appearances, sample_distance=STEP, **OPTIONS
    ) as session:
        told["blocks"] = outcome(lambda: session.render_member(part, {"p": 0.0}, **place))
        box = boxes[COMM.rank]
        low = np.maximum(np.array(box.start) - 2, 0)
        high = np.minimum(np.array(box.stop) + 3, SHAPE)
        ghosts = [(int(b - a), int(d - c)) for a, b, c, d in zip(low, box.start, box.stop, high, strict=True)][::-1]
        wide = whole[tuple(map(slice, low, high))]
        at = {"spacing": (STEP,) * 3, "origin": ORIGIN + STEP * low[::-1]}
        told["ghosts"] = outcome(lambda: session.render_member(wide, {"p": 0.2}, ghosts=ghosts, **at))
        cuts = [0, 9, 20, SHAPE[0] - 1]
        if COMM.rank < 3:
            slab = whole[cuts[COMM.rank] : cuts[COMM.rank + 1] + 1]
            at = {"spacing": (STEP,) * 3, "origin": ORIGIN + np.array([0, 0, STEP * cuts[COMM.rank]])}
        told["shared"] = outcome(lambda: session.render_member(slab if COMM.rank < 3 else None, {"p": 0.4}, **at))
        half = (SHAPE[2] // 2) // 2 * 2
        sides = {0: (whole[:, :, : half + 1], 0), 1: (whole[::1, :, half:], half)}
        if COMM.rank in sides:
            data, first = sides[COMM.rank]
            every = 2 if COMM.rank else 1
            data = data[:, :, ::every]
            at = {"spacing": (STEP * every, STEP, STEP), "origin": ORIGIN + np.array([STEP * first, 0, 0])}
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            told["levels"] = outcome(
                lambda: session.render_member(data if COMM.rank in sides else None, {"p": 0.6}, **at)
            )
        told["heard"] = [str(one.message) for one in heard]
        told["blueprint"] = outcome(lambda: BlueprintSession(session).execute(mesh(part, place), {"p": 0.8}))


def mesh(values: Any, place: dict[str, Any]) -> dict[str, Any]:
    """A block as Conduit's mesh Blueprint describes it."""
    coords: dict[str, Any] = {"coordsets/coords/type": "uniform"}
    for axis, i, count, step, start in zip(
        "xyz", "ijk", values.shape[::-1], place["spacing"], place["origin"], strict=True
    ):
        coords |= {f"coordsets/coords/dims/{i}": count, f"coordsets/coords/origin/{axis}": float(start)}
        coords[f"coordsets/coords/spacing/d{axis}"] = step
    field = {"association": "vertex", "topology": "mesh", "values": np.ascontiguousarray(values).reshape(-1)}
    topology = {"type": "uniform", "coordset": "coords"}
    told = {f"topologies/mesh/{key}": value for key, value in topology.items()}
    return coords | told | {f"fields/q/{key}": value for key, value in field.items()}


def mistakes(folder: Path, boxes: Any, told: dict[str, Any]) -> None:
    """An error on one rank is raised on all, and the next member is rendered."""
    appearances = [VolumeRendering("plain", FUNCTION)]
    part, place = mine(field(0.0), boxes)
    broken = part.copy()
    if COMM.rank == 2:
        broken[1, 1, 1] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Session(
            folder / "mistakes.cdb", comm=COMM, appearances=appearances, sample_distance=STEP, **OPTIONS
        ) as session:
            told["nan"] = outcome(lambda: session.render_member(broken, {"p": 0.0}, **place))
            told["warned"] = outcome(lambda: session.render_member(broken, {"p": 0.0}, on_error="warn", **place))
            told["type"] = outcome(
                lambda: session.render_member("nothing" if COMM.rank == 3 else part, {"p": 0.0}, **place)
            )
            told["origins"] = outcome(lambda: session.render_member(part[:4, :4, :4], {"p": 0.0}, spacing=(STEP,) * 3))
            told["none"] = outcome(lambda: session.render_member(None, {"p": 0.0}))
            told["parameters"] = outcome(lambda: session.render_member(part, {"q": 0.0}, **place))
            told["transparent"] = outcome(lambda: session.render_member(broken, {"p": 0.3}, nan="transparent", **place))
            told["right"] = outcome(lambda: session.render_member(part, {"p": 0.0}, **place))
            told["twice"] = outcome(lambda: session.render_member(part, {"p": 0.0}, **place))
            told["failures"] = dict(session.failures)
        told["background"] = outcome(lambda: Session(folder / "x.cdb", comm=COMM, background=True, **OPTIONS))
        told["other plan"] = outcome(lambda: Session(folder / "mistakes.cdb", comm=COMM, space={"z": (0, 1)}))


def disagreements(folder: Path, boxes: Any, told: dict[str, Any]) -> None:
    """One rank says something else than the others."""
    part, place = mine(field(0.0), boxes)
    appearances = [VolumeRendering("plain", FUNCTION)]
    options = {"comm": COMM, "appearances": appearances, "sample_distance": STEP, **OPTIONS}
    odd = COMM.rank == 2

    def rendered(case: str, data: Any = part, **changed: Any) -> None:
        arguments = {"parameters": {"p": 0.0}, **place, **changed}
        told[case] = outcome(lambda: session.render_member(data, **arguments))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Session(folder / "disagreements.cdb", **options) as session:
            rendered("parameters", parameters={"p": 0.1 if odd else 0.0})
            rendered("other names", parameters={"q": 0.0} if odd else {"p": 0.0})
            rendered("no parameters", parameters=None if odd else {"p": 0.0})
            rendered("time", time=0.2 if odd else 0.1)
            rendered("no time", time=None if odd else 0.1)
            rendered("name", name="a" if odd else "b")
            rendered("nan", nan="transparent" if odd else "refuse")
            rendered("array", array="q" if odd else None)
            rendered("dims", dims="xyz" if odd else "zyx")
            rendered("warned", time=0.2 if odd else 0.1, on_error="warn")
            whole = np.rint(part).astype(np.int32)
            rendered("types", whole if odd else part)
            rendered("types of meshes", wrapped(whole if odd else part, place), spacing=None, origin=None)
            rendered("bad ghosts", ghosts=-1 if odd else 0)
            rendered("ghosts", ghosts=1 if odd else 0)
            told["has"] = outcome(lambda: session.has({"p": 0.5 if odd else 0.0}))
            odd_mesh = None if odd else mesh(part, place)
            told["mesh"] = outcome(lambda: BlueprintSession(session).execute(odd_mesh, {"p": 0.7}))
            rendered("rounding", parameters={"p": np.float32(0.1) if odd else 0.1})
            rendered("no block", None if COMM.rank == 3 else part[:2], parameters={"p": 0.2}, nan="transparent")
        told["policy"] = outcome(lambda: Session(folder / "x.cdb", **{**options, "nan": "none" if odd else "refuse"}))
        told["background"] = outcome(lambda: Session(folder / "x.cdb", **options, background=odd))
        told["path"] = outcome(lambda: Session(3 if odd else folder / "x.cdb", **options))  # type: ignore[arg-type]


def wrapped(values: Any, place: dict[str, Any]) -> Any:
    """A block as a data set of pyvista."""
    import pyvista

    data = pyvista.ImageData(dimensions=values.shape[::-1], **place)
    data["q"] = values.reshape(-1)
    return data


def killed(folder: Path, boxes: Any, told: dict[str, Any]) -> None:
    """The second member's rank 1 dies in the middle of the pictures."""
    part, place = mine(field(0.0), boxes)
    options = {**OPTIONS, "appearances": [VolumeRendering("plain", FUNCTION)], "sample_distance": STEP}
    with Session(folder / "killed.cdb", comm=COMM, existing="skip", **options) as session:
        session.render_member(part, {"p": 0.0}, **place)
        if (folder / "kill").exists():
            from insitu.fields.blocks import Blocks

            drawn = Blocks._draw

            def dying(self: Blocks, cameras: Any, float_output: bool) -> Any:
                if COMM.rank == 1 and len(cameras) and (folder / "kill").exists():
                    os.kill(os.getpid(), signal.SIGKILL)
                return drawn(self, cameras, float_output)

            Blocks._draw = dying  # type: ignore[method-assign]
        told["second"] = outcome(lambda: session.render_member(part, {"p": 1.0}, **place))


def main(folder: Path, parts: Sequence[str]) -> None:
    boxes = kd_boxes(SHAPE, COMM.size, np.random.default_rng(11))
    told: dict[str, dict[str, Any]] = {part: {} for part in parts}
    for work in (pictures, partitions, mistakes, disagreements, killed):
        if work.__name__ in parts:
            work(folder, boxes, told[work.__name__])
    (folder / f"rank-{COMM.rank}.json").write_text(json.dumps(told))


if __name__ == "__main__":
    assert insitu
    main(Path(sys.argv[1]), sys.argv[2:])
