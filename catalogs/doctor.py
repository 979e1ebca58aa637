"""The machine and the installation as a bug report needs them, each finding with a remedy where something fails."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path

import click

from catalogs.version import DISTRIBUTION, described

SECONDS = 30.0  # for one probe: a network file system may take long to load torch
LEAST_FREE = 2e9  # bytes of memory, or of disk, below which most scenes fail
VARIABLES = re.compile(
    r"(OMP|OPENBLAS|MKL|LP|GS_SURROGATE|CUDA|MESA|GALLIUM|LIBGL|EGL|VTK|KMP)_\w+|DISPLAY|PYTHONPATH|LD_LIBRARY_PATH"
)
REINSTALL = f"install it again: pip install --force-reinstall --no-deps --no-cache-dir {DISTRIBUTION}"


@dataclass(frozen=True)
class Finding:
    """One line of the report; `remedy` is a sentence, "" where nothing is wrong."""

    name: str
    value: str
    remedy: str = ""


@dataclass(frozen=True)
class Package:
    """A package that an extra of this project names ("" for all of them), its version here, and the lowest that will do."""

    name: str
    extra: str
    version: str | None
    least: str

    def too_old(self) -> bool:
        """Its version is lower than `least`, by the numbers that both begin with."""
        return self.version is not None and _numbers(self.version) < _numbers(self.least)


@dataclass(frozen=True)
class Probe:
    """A program that prints its finding, run in a process of its own, for what it loads may crash or hang."""

    name: str
    program: str = field(repr=False)
    needs: str  # the package without which there is nothing to find
    remedy: str


PROBES = (
    Probe(
        "kernels",
        "import os, numpy; from native import kernels; names = kernels.instruction_sets()\n"
        "kernels.directional_colors(*map(numpy.float32, ([[0, 0, 1]], [[0] * 12], [0, 0, 0])), 1)\n"
        "print(os.environ.get('GS_SURROGATE_INSTRUCTION_SET') or names[0], 'of', ', '.join(names))",
        "numpy",
        f"unset GS_SURROGATE_INSTRUCTION_SET if it is set, else {REINSTALL}",
    ),
    Probe(
        "OpenGL",
        "from render.window import open_window; window = open_window(); print(window.backend, *window.driver(), sep='; ')",
        "vtk",
        "if a driver is installed, set LIBGL_ALWAYS_SOFTWARE=1, which takes Mesa's own (package libgl1-mesa-dri)",
    ),
    Probe(
        "GPU",
        "import torch; built = torch.version.cuda; cards = range(torch.cuda.device_count())\n"
        "names = [torch.cuda.get_device_name(card) for card in cards]\n"
        "memory = [f'{torch.cuda.get_device_properties(card).total_memory / 1e9:.0f} GB' for card in cards]\n"
        "shown = ', '.join(f'{name} {size}' for name, size in zip(names, memory)) or 'none'\n"
        "built = f'for CUDA {built}' if built else 'without CUDA'; print(f'{shown} (torch was built {built})')",
        "torch",
        "install torch again: pip install --force-reinstall torch",
    ),
    Probe(
        "MPI",
        "import mpi4py; mpi4py.rc.initialize = False; from mpi4py import MPI\n"
        "print(MPI.Get_library_version().splitlines()[0].strip(' \\0'))",
        "mpi4py",
        "load or install an MPI, or build mpi4py with it: pip install --force-reinstall --no-binary mpi4py mpi4py",
    ),
    Probe(
        "MP4 films",
        "import av; print('by PyAV' if 'libx264' in av.codecs_available else 1 / 0)",
        "av",
        "this PyAV has no H.264 encoder: pip install --force-reinstall av, or make GIFs",
    ),
)


def examine() -> tuple[list[Finding], list[Package]]:
    """Everything that a bug report needs, in a few seconds; writes nothing and raises nothing that the machine may cause."""
    listed = packages()
    versions = {package.name: package.version for package in listed}
    with ThreadPoolExecutor(len(PROBES)) as pool:
        probed = pool.map(lambda probe: run(probe, bool(versions.get(probe.needs))), PROBES)
        findings = [*_system(), *_cores(), _memory(), _disk(), _compilers()]
        return [*findings, *map(_with_driver, probed), _environment()], listed


def packages() -> list[Package]:
    """The packages that this project's extras name, apart from those of its tests."""
    try:
        texts = importlib.metadata.requires(DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        return []
    listed: dict[str, Package] = {}
    for text in texts:
        requirement, _, condition = text.partition(";")
        name = re.split(r"[\[<>=!~ ]", requirement)[0]
        extra = "".join(re.findall(r"""extra == ['"]([\w-]+)""", condition))
        if name != DISTRIBUTION and extra != "test":
            least = "".join(re.findall(r">=([\w.]+)", requirement))
            listed.setdefault(name, Package(name, extra, _installed(name), least))
    return list(listed.values())


def run(probe: Probe, present: bool = True, *, seconds: float = SECONDS) -> Finding:
    """The finding of one probe; `present` says whether the package is installed that it needs."""
    if not present:
        return Finding(probe.name, f"unknown: {probe.needs} is not installed")
    quiet = {**os.environ, "MESA_SHADER_CACHE_DISABLE": "true"}  # which would be written
    command = [sys.executable, "-P", "-B", "-c", probe.program]
    try:
        ended = subprocess.run(
            command,
            env=quiet,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=seconds,
        )
    except subprocess.TimeoutExpired:
        return Finding(probe.name, f"no answer within {seconds:g} s", probe.remedy)
    except OSError as error:
        return Finding(probe.name, f"could not be examined: {error}", probe.remedy)
    if ended.returncode < 0:
        return Finding(probe.name, f"crashed ({_signal(-ended.returncode)})", probe.remedy)
    said = (ended.stderr if ended.returncode else ended.stdout).strip().splitlines() or [f"status {ended.returncode}"]
    return Finding(probe.name, said[-1], probe.remedy if ended.returncode else "")


def lines(findings: Sequence[Finding], listed: Sequence[Package]) -> Iterator[str]:
    """The report in aligned lines, each remedy below its finding, the packages by extra."""
    by_extra = {f"[{package.extra}]" if package.extra else "packages": package.extra for package in listed}
    width = max(map(len, (*by_extra, *(finding.name for finding in findings)))) + 2
    for finding in findings:
        yield f"{finding.name:{width}}{finding.value}"
        if finding.remedy:
            yield f"{'':{width}}-> {finding.remedy}"
    for label, extra in by_extra.items():
        those = (f"{each.name} {each.version or 'not installed'}" for each in listed if each.extra == extra)
        yield f"{label:{width}}{', '.join(those)}"
    for package in listed:
        if package.too_old():
            yield f"{'':{width}}-> pip install '{package.name}>={package.least}'"
    if not all(package.version for package in listed):
        yield f"{'':{width}}-> where you need what is not installed: pip install '{DISTRIBUTION}[EXTRA]'"


@click.command()
@click.option("--json", "as_json", is_flag=True, help="The same as one JSON object.")
def doctor(as_json: bool) -> None:
    """Print what a bug report needs: versions, processor, OpenGL, GPU, MPI, memory, and remedies for what fails.

    Takes a few seconds, writes nothing, and its exit status is 0 whatever it finds.
    """
    findings, listed = examine()
    if as_json:
        click.echo(json.dumps({"findings": [*map(asdict, findings)], "packages": [*map(asdict, listed)]}, indent=1))
    else:
        click.echo("\n".join(lines(findings, listed)))


def _system() -> Iterator[Finding]:
    lost = f"pip install {DISTRIBUTION}" if _installed(DISTRIBUTION) is None else ""
    yield Finding(DISTRIBUTION, f"{described()}, in {Path(__file__).parents[1]}", lost)
    yield Finding("Python", f"{platform.python_implementation()} {platform.python_version()}, {sys.executable}")
    yield Finding("system", platform.platform())


def _cores() -> Iterator[Finding]:
    there = os.cpu_count() or 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else there
    text = os.environ.get("OMP_NUM_THREADS", "")
    wrong = text != "" and not text.split(",")[0].strip().isdecimal()
    yield Finding("processor", _processor())
    yield Finding(
        "cores",
        f"{usable} of {there} usable, OMP_NUM_THREADS {text or 'not set'}",
        "set OMP_NUM_THREADS to a number, or unset it" if wrong else "",
    )


def _processor() -> str:
    try:
        names = re.findall(r"^model name\s*:\s*(.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    except OSError:
        names = []
    return f"{names[0] if names else platform.processor() or 'unknown'} ({platform.machine()})"


def _memory() -> Finding:
    try:
        import psutil

        memory = psutil.virtual_memory()
    except (ImportError, OSError, RuntimeError) as error:
        return Finding("memory", f"unknown: {error}")
    remedy = "close other programs, or take fewer Gaussians or smaller images" if memory.available < LEAST_FREE else ""
    return Finding("memory", f"{memory.available / 1e9:.1f} of {memory.total / 1e9:.1f} GB free", remedy)


def _disk() -> Finding:
    try:
        here = Path.cwd()
        disk = shutil.disk_usage(here)
    except OSError as error:
        return Finding("disk", f"unknown: {error}", "change to a folder that exists")
    free = f"{disk.free / 1e9:.1f} of {disk.total / 1e9:.1f} GB free in the current folder"
    if not os.access(here, os.W_OK):
        return Finding("disk", f"{free}, which is read-only", "change to a folder that you may write to")
    return Finding("disk", free, "make room, or change to a folder on another disk" if disk.free < LEAST_FREE else "")


def _compilers() -> Finding:
    names = next((name for name in ("c++", "g++", "clang++") if shutil.which(name)), "c++"), "nvcc"
    return Finding("compilers", ", ".join(f"{name} {shutil.which(name) or 'not installed'}" for name in names))


def _environment() -> Finding:
    those = (f"{name}={value}" for name, value in sorted(os.environ.items()) if VARIABLES.fullmatch(name))
    return Finding("variables", " ".join(those) or "none that matter")


def _with_driver(finding: Finding) -> Finding:
    """The GPU's finding, with a remedy where the machine has a driver and torch finds no card."""
    if finding.name != "GPU" or not finding.value.startswith("none") or not shutil.which("nvidia-smi"):
        return finding
    remedy = "the machine has an NVIDIA driver: install a torch for its CUDA version, as pytorch.org says"
    return Finding(finding.name, finding.value, remedy)


def _installed(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", version.partition("+")[0])))


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
