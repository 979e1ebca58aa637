"""What a rendered member says of itself, and the peak of memory that is seen while it is rendered."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from insitu.rendered import PeakMemory, RenderedMember

PROJECT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("names", "lines"),
    [
        (("",), ["  values -1 to 3, 25.00 % clipped"]),
        (("q", "speed"), ["  q -1 to 3, 25.00 % clipped", "  speed 0 to 0.5, 0.00 % clipped"]),
    ],
)
def test_each_field_of_a_member_has_a_line(names: tuple[str, ...], lines: list[str]) -> None:
    ranges, clipped = ((-1.0, 3.0), (0.0, 0.5)), (0.25, 0.0)
    member = RenderedMember(
        name="a",
        path=Path("x.cdb/members/a"),
        images=20,
        render_seconds=1.0,
        write_seconds=0.5,
        seconds=2.0,
        extra_memory=3_000_000,
        ranges=dict(zip(names, ranges, strict=False)),
        clipped_fractions=dict(zip(names, clipped, strict=False)),
        warnings=("beware",),
    )
    assert (member.range, member.clipped_fraction, member.images_per_second) == ((-1.0, 3.0), 0.25, 10.0)
    first, *rest = str(member).splitlines()
    assert (
        first
        == repr(member)
        == "RenderedMember a: 20 images in 2.0 s (10/s; render 1.0 s, write 0.5 s), 3 MB extra memory"
    )
    assert rest == [*lines, "  x.cdb/members/a", "  warning: beware"]


def test_a_held_array_is_counted_after_it_is_gone() -> None:
    memory = PeakMemory()
    held = np.ones(8_000_000)  # 64 MB
    memory.sample()
    del held
    assert 55e6 < memory.extra_bytes < 90e6


def test_a_rise_between_samples_is_seen_in_the_high_water_mark() -> None:
    program = (
        "import numpy\nfrom insitu.rendered import PeakMemory\n"
        "memory = PeakMemory()\nnumpy.ones(16_000_000).sum()\nprint(memory.extra_bytes)"  # 128 MB, gone at once
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=PROJECT, capture_output=True, text=True, check=True)
    assert 115e6 < int(result.stdout) < 160e6


def test_doing_nothing_adds_little() -> None:
    assert 0 <= PeakMemory().extra_bytes < 5e6
