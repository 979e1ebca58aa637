"""The counted work against sums made by hand, and the floor against its two limits."""

from __future__ import annotations

import re

import pytest

from native import kernels
from research.benchmarks.page import PROJECT
from research.benchmarks.splatting import counting
from research.benchmarks.splatting.counting import BACKWARD_TERMS, FORWARD_TERMS, Peak, backward_work, forward_work


def test_work_of_pairs_alone() -> None:
    forward, backward = forward_work(1000, 0, 0), backward_work(1000, 0, 0)
    assert (forward.flops, forward.instructions, forward.bytes) == (29_000, 19_000, 0)
    assert (backward.flops, backward.instructions, backward.bytes) == (53_000, 37_000, 0)


def test_work_of_gaussians_and_pixels() -> None:
    forward, backward = forward_work(0, 10, 7), backward_work(0, 10, 7)
    assert forward.bytes == 10 * 14 * 4 + 7 * 4 * 4
    assert backward.bytes == 10 * (14 + 14) * 4 + 7 * (4 + 4) * 4
    assert backward.flops > forward.flops == 2 * counting.PROJECTION * 10


def test_floor_is_the_longer_of_arithmetic_and_memory() -> None:
    peak = Peak(gigaflops=100.0, gigabytes=10.0)  # 50 G instructions/s
    assert peak.floor_ms(counting.Work(0, 50e6, 0)) == pytest.approx(1.0)
    assert peak.floor_ms(counting.Work(0, 50e6, 20e6)) == pytest.approx(2.0)
    assert peak.share(counting.Work(50e6, 0, 0), 1.0) == pytest.approx(0.5)
    assert peak.loop_ms() == pytest.approx(20.0)


@pytest.mark.slow
@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
def test_the_peak_is_one_that_a_processor_can_have(instruction_set: str) -> None:
    peak = Peak.measure(instruction_set, 1, 0.02)
    assert 0.5 < peak.gigaflops < 1000.0
    assert 0.1 < peak.gigabytes < 1000.0


@pytest.mark.parametrize(("name", "terms"), [("forward_tile", FORWARD_TERMS), ("backward_tile", BACKWARD_TERMS)])
def test_terms_follow_the_source(name: str, terms: dict[str, tuple[int, int]]) -> None:
    """Flops, and calls of min, comparisons and exp2, of the loop over blocks: a change there asks for a new count."""
    source = (PROJECT / "native" / "kernels" / "src" / "tiles.inc").read_text()
    body = source[source.index(f"static void {name}") :]
    body = re.sub(r"//.*", "", body[body.index("do {") : body.index("} while")])
    body = re.sub(r"(load|store)\(\w+ \+ (\d \* )?GS_WIDTH", r"\1(at", body)  # addresses
    body = re.sub(r"if constexpr \(kEdges\).*", "", body)  # which training has none of
    lines = [line.strip() for line in body.splitlines() if "block =" not in line and "blocks &" not in line]
    code = " ".join(line for line in lines if "float* at" not in line)
    arithmetic = len(re.findall(r"(?<=[\w)\]] )[-+*/](?= )|[-+*/]?\+=", code))
    calls = 12 * code.count("exp2(") + code.count("smaller(") + 2 * code.count("at_least(at_least(")
    calls += len(re.findall(r"keep\(at_least", code))
    counted = sum(2 * fused + others for fused, others in terms.values())
    assert counted == arithmetic + calls, (
        f"{name} has changed: bring its terms in research/benchmarks/splatting/counting.py up to date"
    )
