"""Files that VTK reads, by pyvista or by VTK's own reader, and the times in those that hold several."""

from __future__ import annotations

import json
import math
import re
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from insitu.readers.fortran_numbers import respelled
from insitu.readers.image_files import META, NRRD, read_image
from insitu.readers.named_files import require_named
from insitu.readers.reader import Reader, Sampling, StoredState
from insitu.readers.whole_files import XDMF, check_whole, parts
from insitu.readers.xml_files import LARGEST, parsed
from render.cells import blocks, plain
from render.datasets import chosen_array

HEAD = 1 << 10  # bytes in which a legacy file says that it is text
PICKLES = {".pkl", ".pickle"}  # which pyvista would run
XML = {".vthb", ".vtpc", ".htg", ".pvts", ".pvtp"}  # which pyvista does not know
LISTS = {".pvd", ".series"}
TIMED = {*XDMF, *LISTS, ".e", ".ex2", ".exii", ".exo", ".case", ".encas", ".foam", ".cgns", ".vtkhdf"}
TIME = re.compile(r"\d+(\.\d+)?(e[-+]?\d+)?")  # folders of an OpenFOAM case
SEVERAL = (
    "{path} holds {count} times, of which the first, {first:g}, is taken: `insitu ensemble` makes a member of each"
)
SAYS = "VTK says: "
UNREADABLE = "a name is not text: were bytes lost before it?"

_reading = threading.Lock()  # VTK's messages come to one place in a process


def recognizes(path: Path) -> bool:
    """True for files of VTK's formats that may hold several times."""
    return path.suffix.lower() in TIMED and path.is_file()


def files(path: Path) -> list[Path]:
    """The files that belong to one; of an OpenFOAM case, whose own file is empty, those of its mesh and its times."""
    if path.suffix.lower() != ".foam":
        return [path]
    folders = [path.parent / "constant" / "polyMesh"]
    folders += [folder for folder in path.parent.iterdir() if TIME.fullmatch(folder.name)]
    return [
        path,
        *(file for folder in sorted(folders) if folder.is_dir() for file in sorted(folder.iterdir()) if file.is_file()),
    ]


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """The times in a file; one state that says nothing where it holds one time, or none."""
    with reported():
        times = _source(path).times
    return [StoredState((i,), {"time": time}) for i, time in enumerate(times)] if len(times) > 1 else [StoredState()]


def read(path: Path, array: str | None, index: tuple[int, ...] = (), sampling: Sampling | None = None) -> Any:
    """A data set with the one array alone, at the time of an index; raises ValueError for an error or a warning of VTK."""
    if path.suffix.lower() in PICKLES:
        raise ValueError(
            "pickled files run code when they are read: save the data set in a VTK format, such as .vti or .vtu"
        )
    number = index[0] if index else 0
    try:
        with reported():
            source = _source(path)
            if len(source.times) > 1 and not index:
                warnings.warn(SEVERAL.format(path=path, count=len(source.times), first=source.times[0]), stacklevel=2)
            dataset = source.read(number)
    except ValueError as error:
        with _respelled(path) as other:
            if other is not None:
                return read(other, array)
        raise _named(path, number, error) from error
    is_composite = dataset.IsA("vtkCompositeDataSet")
    parts = [block for block in (blocks(dataset) if is_composite else [plain(dataset)]) if block is not None]
    if is_composite and not parts:
        raise ValueError("it holds no block with cells")
    if array is not None:
        return _only(array, parts, dataset, path)
    if is_composite and len(last := _once(parts, path)) < len(parts):
        return last[0] if len(last) == 1 else _joined(last)
    return parts[0] if len(parts) == 1 else dataset


@contextmanager
def _respelled(path: Path) -> Iterator[Path | None]:
    """A copy of a legacy text file with E in Fortran's exponents, of which VTK makes two numbers; None where there are none."""
    text = path.read_bytes() if path.suffix.lower() == ".vtk" else b""
    other = respelled(text) if b"ASCII" in text[:HEAD] else text
    if other == text:
        yield None
        return
    with TemporaryDirectory() as folder:
        Path(folder, path.name).write_bytes(other)
        yield Path(folder, path.name)


def _named(path: Path, number: int, error: ValueError) -> ValueError:
    """The error with the name of the part that causes it, where a file names others."""
    if not str(error).startswith(SAYS):
        return error
    named = _List(path).named_at(number) if path.suffix.lower() in LISTS else parts(path)
    for part in named:
        try:
            with reported():
                _OneReader(part).read(0)
        except ValueError as found:
            return ValueError(f"{part.name}: {_named(part, 0, found)}")
    return error


def _only(array: str, parts: Sequence[Any], dataset: Any, path: Path) -> Any:
    """The data sets that have an array, without the others; raises ValueError listing them where there is no such array."""
    if not parts:
        return dataset
    wanted = chosen_array(parts, array, "it has")
    copies = []
    for block in parts:
        copy = block.NewInstance()
        copy.ShallowCopy(block)
        for on_cells, part in ((False, copy.GetPointData()), (True, copy.GetCellData())):
            for name in [part.GetArrayName(i) for i in range(part.GetNumberOfArrays())]:
                if name and (name, on_cells) != wanted and not name.startswith("vtk"):
                    part.RemoveArray(name)
        copies.append(copy)
    copies = _once(copies, path)
    return copies[0] if len(copies) == 1 else _joined(copies)


def _joined(parts: Sequence[Any]) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet

    dataset = vtkMultiBlockDataSet()
    for number, block in enumerate(parts):
        dataset.SetBlock(number, block)
    return dataset


# ---- one file ---------------------------------------------------------------------------------------------------------


class _OneReader:
    """One of VTK's readers: its times and its data."""

    def __init__(self, path: Path) -> None:
        check_whole(path)
        self.path, self.reader = path, _pyvista_reader(path)
        self.algorithm = self.reader if not hasattr(self.reader, "reader") else self.reader.reader
        self.times: list[float] = []
        if self.algorithm is not None:
            from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

            self.algorithm.UpdateInformation()
            said = self.algorithm.GetOutputInformation(0)
            steps = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
            self.times = [float(said.Get(steps, i)) for i in range(said.Length(steps))] if said.Has(steps) else []

    def read(self, number: int) -> Any:
        import pyvista

        if self.algorithm is None:
            return pyvista.read(self.path)
        if len(self.times) > 1:
            self.algorithm.UpdateTimeStep(self.times[number])
        if self.reader is not self.algorithm:
            return self.reader.read()
        self.algorithm.Update()
        return self.algorithm.GetOutputDataObject(0)


class _List:
    """A file that names others with their times: ParaView's .pvd and .series."""

    def __init__(self, path: Path) -> None:
        named = _of_series(path) if path.suffix.lower() == ".series" else _of_collection(path)
        if not named:
            raise ValueError("it names no file")
        self.path, self.times = path, sorted(named)
        self.named = named

    def read(self, number: int) -> Any:
        from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet

        dataset = vtkMultiBlockDataSet()
        for place, part in enumerate(self.named_at(number)):
            require_named(part)
            if part.suffix.lower() in LISTS:
                raise ValueError(f"it names {part.name}, which is a list of files itself")
            try:
                dataset.SetBlock(place, _source(part).read(0))
            except ValueError as error:
                raise ValueError(f"{part.name}: {error}") from None
        return dataset

    def named_at(self, number: int) -> list[Path]:
        """The files of a time."""
        return [self.path.parent / name for name in self.named[self.times[number]]]


def _once(parts: Sequence[Any], path: Path) -> list[Any]:
    """The last of data sets that fill the same box; one warning says of how many."""
    last = {_alike(block): block for block in parts}
    if len(last) < len(parts):
        count = len(parts) - len(last)
        message = (
            f"{path}: {count} of {len(parts)} blocks fill the same box as a later one, which is taken in their place"
        )
        warnings.warn(message, stacklevel=3)
    return list(last.values())


def _alike(block: Any) -> object:
    """The same for data sets of one box, as many points and cells, and the same arrays: one was written again by a restart."""
    names = (
        part.GetArrayName(i)
        for part in (block.GetPointData(), block.GetCellData())
        for i in range(part.GetNumberOfArrays())
    )
    count = block.GetNumberOfPoints()
    some = tuple(block.GetPoint(number) for number in range(0, count, max(1, count // 64)))
    return block.GetBounds(), count, block.GetNumberOfCells(), some, tuple(names)


class _Image:
    """A file of one of the formats that we read ourselves, at one time."""

    def __init__(self, path: Path) -> None:
        self.path, self.times = path, list[float]()

    def read(self, number: int) -> Any:
        return read_image(self.path)


def _source(path: Path) -> _OneReader | _List | _Image:
    if path.suffix.lower() in NRRD | META:
        return _Image(path)
    return _List(path) if path.suffix.lower() in LISTS else _OneReader(path)


def _pyvista_reader(path: Path) -> Any:
    """A reader of pyvista's or of VTK's; with the attribute `reader` None where pyvista has to find one of meshio's."""
    suffix = path.suffix.lower()
    if suffix not in XDMF | XML:
        return _known_to_pyvista(path)
    from vtkmodules import vtkIOXML as io
    from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

    named = {".vtpc": io.vtkXMLPartitionedDataSetCollectionReader, ".htg": io.vtkXMLHyperTreeGridReader}
    kinds: dict[str, Any] = {**dict.fromkeys(XDMF, vtkXdmfReader), **named}
    reader = kinds.get(suffix, io.vtkXMLGenericDataObjectReader)()
    reader.SetFileName(str(path))
    return reader


def _known_to_pyvista(path: Path) -> Any:
    from types import SimpleNamespace

    import pyvista

    try:
        return pyvista.get_reader(path)
    except ValueError:
        return SimpleNamespace(reader=None)


def _of_collection(path: Path) -> dict[float, list[str]]:
    """The files of a .pvd by their times."""
    by_time: dict[float, list[str]] = {}
    for element in parsed(path).iter("DataSet"):
        time, name = element.get("timestep") or "0", element.get("file")
        if name:
            by_time.setdefault(_time(time), []).append(name)
    return by_time


def _of_series(path: Path) -> dict[float, list[str]]:
    """The files of a .series by their times; their numbers where it does not say these."""
    if path.stat().st_size > LARGEST:
        raise ValueError(f"it has {path.stat().st_size} bytes, more than a list of files")
    said = json.loads(path.read_text(encoding="utf-8"))
    rows = said.get("files") if isinstance(said, dict) else None
    if not isinstance(rows, list) or not all(
        isinstance(row, dict) and isinstance(row.get("name"), str) for row in rows
    ):
        raise ValueError('it must hold {"files": [{"name": ..., "time": ...}, ...]}')
    by_time: dict[float, list[str]] = {}
    for number, row in enumerate(rows):
        by_time.setdefault(_time(row.get("time", number)), []).append(row["name"])
    return by_time


def _time(said: Any) -> float:
    try:
        value = float(said)
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"a time must be a finite number, got {str(said)[:40]!r}")
    return value


# ---- VTK's messages ---------------------------------------------------------------------------------------------------


@contextmanager
def reported() -> Iterator[None]:
    """Raise the first error or warning of VTK, of any reader within another one, as a ValueError; one thread at a time."""
    import pyvista  # noqa: F401 - which takes VTK's messages itself when it is imported
    from vtkmodules.util.misc import calldata_type
    from vtkmodules.util.vtkConstants import VTK_STRING
    from vtkmodules.vtkCommonCore import vtkObject, vtkOutputWindow, vtkStringOutputWindow

    said: list[str] = []
    own = threading.get_ident()

    @calldata_type(VTK_STRING)  # type: ignore[untyped-decorator]
    def note(window: Any, event: str, text: str) -> None:
        if threading.get_ident() != own and threading.get_ident() in {thread.ident for thread in threading.enumerate()}:
            before.DisplayErrorText(text)  # of something else in this process
        else:
            said.append(text or UNREADABLE)

    with _reading:
        before, display = vtkOutputWindow.GetInstance(), vtkObject.GetGlobalWarningDisplay()
        window: Any = vtkStringOutputWindow()
        for event in ("ErrorEvent", "WarningEvent"):
            window.AddObserver(event, note)
        vtkOutputWindow.SetInstance(window)
        vtkObject.SetGlobalWarningDisplay(1)
        try:
            yield
        except Exception as error:
            if said:
                raise ValueError(_sentence(said)) from error
            raise
        finally:
            window.RemoveAllObservers()
            vtkOutputWindow.SetInstance(before)
            vtkObject.SetGlobalWarningDisplay(display)
        if said:
            raise ValueError(_sentence(said))


def _sentence(said: Sequence[str]) -> str:
    """The first of VTK's messages without its places in the source and in memory."""
    texts = [re.sub(r"^.*?In [^\n]*, line \d+\n", "", text, flags=re.DOTALL) for text in said]
    sentence = " ".join(re.sub(r"\b(vtk\w+) \(0x[0-9a-f]+\)", r"\1", texts[0]).split())
    return f"{SAYS}{sentence[:300]}" + (f" (and {len(said) - 1} more)" if len(said) > 1 else "")


READER = Reader(
    "vtk",
    "VTK's formats with several times: .pvd, .series, Exodus, EnSight, OpenFOAM, XDMF",
    recognizes,
    records,
    read,
    files=files,
    grows=True,
)
