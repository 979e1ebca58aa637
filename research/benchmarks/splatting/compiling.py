"""Small C++ programs that only benchmarks need, compiled when they are measured."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

FLAGS = ["-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-Wno-psabi"]
HASWELL = ["-mavx2", "-mfma", "-mbmi"]
INSTRUCTION_SETS = {  # as CMakeLists.txt compiles the kernels
    "avx512": [*HASWELL, "-mavx512f", "-mavx512dq", "-mavx512bw", "-mavx512vl", "-mprefer-vector-width=512"],
    "avx2": HASWELL,
    "baseline": [],
}
WIDTHS = {"avx512": 16, "avx2": 8, "baseline": 4}  # floats in a vector


def compiled(source: Path, program: Path, instruction_set: str, *options: str) -> Path:
    """Compile `source` to `program` for this instruction set; raises RuntimeError with the message of g++ where it fails."""
    command: Sequence[str] = [
        "g++",
        *FLAGS,
        *INSTRUCTION_SETS[instruction_set],
        *options,
        str(source),
        "-o",
        str(program),
    ]
    try:
        built = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise RuntimeError("g++ is not installed: this benchmark compiles a small program with it") from error
    if built.returncode:
        raise RuntimeError(built.stderr)
    return program
