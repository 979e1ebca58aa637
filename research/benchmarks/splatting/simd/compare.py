"""Time the inner loops of splatting written with different vector libraries: which one the kernels should use.

    python -m research.benchmarks.splatting.simd.compare

Prints Markdown.  xsimd and Highway are compared where their headers are (Debian: libxsimd-dev, libhwy-dev).
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from native import kernels
from research.benchmarks.page import command_line, table
from research.benchmarks.splatting.compiling import WIDTHS, compiled

SOURCE = Path(__file__).with_name("loops.cpp")
LIBRARIES = {
    "GCC's vector extensions (the kernels')": ["-DWITH_VECTOR_EXTENSIONS"],
    "std::experimental::simd": ["-DWITH_STD_SIMD"],
    "xsimd": ["-DWITH_XSIMD"],
    "Highway": ["-DWITH_HIGHWAY", "-maes", "-mpclmul", "-mf16c", "-mbmi2"],
    "plain loops, vectorized by GCC": ["-DWITH_ARRAYS"],
}
RUNS = 7


def compare(runs: int = RUNS) -> str:
    """A Markdown table of picoseconds per (pixel, Gaussian) pair: medians of `runs` runs, in turn, with their range.

    Raises RuntimeError where two libraries disagree about the result.
    """
    rows, sums = [], set()
    with tempfile.TemporaryDirectory() as folder:
        for name in [name for name in kernels.instruction_sets() if WIDTHS[name] > 4]:
            programs = {library: _compiled(library, name, Path(folder)) for library in LIBRARIES}
            results: dict[str, list[list[float]]] = {library: [] for library in LIBRARIES}
            for _ in range(runs):
                for library, program in programs.items():
                    if program is not None:
                        values = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split()
                        results[library].append([1e3 * float(value) for value in values[1:3]])
                        sums.add(f"{float(values[3]):.3g}")
            rows += [[library, name, *_cells(times)] for library, times in results.items()]
    if len(sums) > 1:
        raise RuntimeError(f"the libraries disagree about the result: {sorted(sums)}")
    return table(["library", "instruction set", "forward, ps per pair", "backward, ps per pair"], rows)


def _compiled(library: str, instruction_set: str, folder: Path) -> Path | None:
    """The program of a library, or None where its headers are missing."""
    program = folder / f"{instruction_set}-{list(LIBRARIES).index(library)}"
    try:
        return compiled(SOURCE, program, instruction_set, *LIBRARIES[library])
    except RuntimeError as error:
        if "No such file" in str(error):
            return None
        raise


def _cells(times: list[list[float]]) -> list[str]:
    if not times:
        return ["headers not installed"] * 2
    columns = zip(*times, strict=True)
    return [f"{statistics.median(c):.0f} ({min(c):.0f} to {max(c):.0f})" for c in columns]


if __name__ == "__main__":
    command_line("splatting.simd.compare", __doc__).parse_args()
    sys.stdout.write(compare())
