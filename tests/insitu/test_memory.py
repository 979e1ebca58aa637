"""Peak memory: what was held for a while is seen, what was there before is not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from insitu.memory import PeakMemory

PROJECT = Path(__file__).resolve().parents[2]


def test_a_held_array_is_counted_after_it_is_gone() -> None:
    memory = PeakMemory()
    held = np.ones(8_000_000)  # 64 MB
    memory.sample()
    del held
    assert 55e6 < memory.extra_bytes < 90e6


def test_a_rise_between_samples_is_seen_in_the_high_water_mark() -> None:
    program = (
        "import numpy\nfrom insitu.memory import PeakMemory\n"
        "memory = PeakMemory()\nnumpy.ones(16_000_000).sum()\nprint(memory.extra_bytes)"  # 128 MB, gone at once
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=PROJECT, capture_output=True, text=True, check=True)
    assert 115e6 < int(result.stdout) < 160e6


def test_doing_nothing_adds_little() -> None:
    assert 0 <= PeakMemory().extra_bytes < 5e6
