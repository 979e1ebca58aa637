"""The result of a rendered member, and the peak of memory while it is rendered."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from insitu.members.result import RenderedMember

PROJECT = Path(__file__).resolve().parents[3]


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


PEAKS = """
import numpy
from insitu.members.result import PeakMemory
print(PeakMemory().extra_bytes)
memory = PeakMemory()
held = numpy.ones(8_000_000)  # 64 MB, which are seen
memory.sample()
del held
print(memory.extra_bytes)
memory = PeakMemory()
numpy.ones(16_000_000).sum()  # 128 MB, gone before anybody looks
print(memory.extra_bytes)
"""


def test_peaks_are_seen_while_they_last_and_afterwards() -> None:
    """In a process of their own, in which nobody else takes or frees memory meanwhile."""
    result = subprocess.run([sys.executable, "-c", PEAKS], cwd=PROJECT, capture_output=True, text=True, check=True)
    nothing, held, between_samples = map(int, result.stdout.split())
    assert 0 <= nothing < 5e6
    assert 55e6 < held < 90e6
    assert 115e6 < between_samples < 160e6
