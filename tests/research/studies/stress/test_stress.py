"""The table of hard cases holds for every instruction set, and does not hold for engines that are wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from click.testing import CliRunner
from torch import Tensor

import surrogate.splatting
from native import kernels
from research.studies.__main__ import main
from research.studies.stress.cases import BitwiseCase, StressCase, agreements, cases, refusals
from research.studies.stress.check import check, check_agreement, check_refusal, draw_reference, tables
from research.studies.stress.drift import Drift, DriftSnapshot, measure_drift
from research.studies.stress.functions import function_cases
from surrogate.splatting import Primitives, Rendering, cpu, cuda
from tests.support.tables import tables as widths_of_tables

HEAVY = 5_000  # Gaussians


@pytest.fixture(scope="module", autouse=True)
def references() -> Iterator[None]:
    """The reference images of a case, cached for all tests: float64 takes most of their time."""
    with pytest.MonkeyPatch.context() as patch:
        drawn: dict[str, Any] = {}

        def draw_once(case: StressCase) -> Any:
            if case.name not in drawn:
                drawn[case.name] = draw_reference(case)
            return drawn[case.name]

        patch.setattr("research.studies.stress.check.draw_reference", draw_once)
        yield


def by_name(name: str) -> StressCase:
    return next(case for case in cases() if case.name == name)


def marked(case: StressCase) -> Any:
    return pytest.param(case, marks=pytest.mark.slow if heavy(case) else (), id=case.name)


def heavy(case: StressCase) -> bool:
    """True if the reference implementation takes seconds."""
    return len(case.scene().means) > HEAVY or case.camera().width > 200


@pytest.mark.parametrize("case", [marked(case) for case in cases()])
def test_every_hard_case_holds(case: StressCase) -> None:
    sets = kernels.instruction_sets()
    for name in sets[:1] if heavy(case) else sets:
        outcome = check(case, {"instruction_set": name})
        assert outcome.passed, (name, outcome.complaints)
        assert outcome.uncertain < 0.2


@pytest.mark.parametrize("row", [*agreements(), *refusals()], ids=lambda row: row.name)
def test_what_must_agree_agrees_and_what_must_be_refused_is(row: Any) -> None:
    outcome = check_agreement(row, {}) if isinstance(row, BitwiseCase) else check_refusal(row, {})
    assert outcome.passed, outcome.complaints


def drawn_wrong(
    change: Callable[[Rendering], Rendering], prepare: Callable[..., Any] = lambda *tensors: tensors
) -> Any:
    def render(primitives: Primitives, *inputs: Any, **options: Any) -> Rendering:
        return change(cpu.render(Primitives(*prepare(*primitives)), *inputs, **options))

    return SimpleNamespace(render=render)


def brighter(picture: Rendering) -> Rendering:
    return picture._replace(color=picture.color + 1e-3)


def one_nan(picture: Rendering) -> Rendering:
    spoilt = picture.alpha.clone()
    spoilt[0, 0] = torch.nan
    return picture._replace(alpha=spoilt)


def gradient_lost(*tensors: Tensor) -> list[Tensor]:
    """Scales that are seen but have no gradient of their own size."""
    means, scales, *others = tensors
    return [means, scales.detach() + 0.5 * (scales - scales.detach()), *others]


def last_dropped(*tensors: Tensor) -> list[Tensor]:
    keep = torch.ones(len(tensors[3]))
    keep[-1:] = 0.0
    return [*tensors[:3], tensors[3] * keep, tensors[4]]


def nan_made_zero(*tensors: Tensor) -> list[Tensor]:
    return [tensor.nan_to_num(0.0, 0.0, 0.0) for tensor in tensors]


@pytest.mark.parametrize(
    ("engine", "complaint"),
    [
        (drawn_wrong(brighter), "image error"),
        (drawn_wrong(one_nan), "not finite"),
        (drawn_wrong(lambda picture: picture, gradient_lost), "gradient by scales"),
        (drawn_wrong(lambda picture: picture, last_dropped), "image error"),
    ],
    ids=["too bright", "a NaN", "half a gradient", "one Gaussian missing"],
)
def test_a_wrong_engine_misses(engine: Any, complaint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(surrogate.splatting.BACKENDS, "wrong", engine)
    outcome = check(by_name("radius 1 px"), {"backend": "wrong"})
    assert not outcome.passed
    assert any(complaint in text for text in outcome.complaints)


def test_an_engine_that_repairs_nan_misses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(surrogate.splatting.BACKENDS, "wrong", drawn_wrong(lambda p: p, nan_made_zero))
    outcomes = [check_refusal(row, {"backend": "wrong"}) for row in refusals()]
    assert all(outcome.complaints == ("it was drawn",) for outcome in outcomes)


def test_an_engine_that_depends_on_the_run_misses(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def flicker(picture: Rendering) -> Rendering:
        calls.append(picture)
        return picture._replace(color=picture.color * (1.0 + len(calls) * 2.0**-20))

    monkeypatch.setitem(surrogate.splatting.BACKENDS, "wrong", drawn_wrong(flicker))
    assert check_agreement(BitwiseCase("again"), {"backend": "wrong"}).complaints == (
        "the picture differs",
        *(f"the gradient by {name} differs" for name in ("means", "scales", "quats", "opacities", "colors")),
    )


@pytest.mark.slow
def test_a_short_training_does_not_drift() -> None:
    drift = measure_drift(steps=40)
    assert drift.complaints == ()
    assert [snapshot.step for snapshot in drift.exact] == [1, 10, 30, 40]
    assert drift.exact[-1].psnr > drift.exact[0].psnr + 1.0
    assert 0 < drift.distances()[-1][1] < 1e-2


def test_runs_that_part_are_said_to() -> None:
    def snapshot(offset: float, psnr: float, loss: float = 0.1) -> list[DriftSnapshot]:
        return [DriftSnapshot(1, torch.full((3, 3), offset).double(), loss, psnr)]

    assert Drift(snapshot(0.0, 30.0), snapshot(1e-3, 29.9), snapshot(1e-3, 30.0)).complaints == ()
    assert "dB from float64" in Drift(snapshot(0.0, 30.0), snapshot(1e-3, 28.0), snapshot(1e-3, 30.0)).complaints[0]
    assert "times as far" in Drift(snapshot(0.0, 30.0), snapshot(0.1, 30.0), snapshot(1e-3, 30.0)).complaints[0]
    assert (
        "not finite"
        in Drift(snapshot(0.0, 30.0), snapshot(1e-3, 30.0, float("nan")), snapshot(1e-3, 30.0)).complaints[0]
    )


@pytest.mark.slow
def test_the_command_writes_the_page_and_fails_where_a_row_does(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("research.studies.stress.drift.measure_drift", partial(measure_drift, steps=60))
    done = CliRunner().invoke(main, ["stress", "-o", str(tmp_path / "good")])
    assert done.exit_code == 0, done.output
    rows = len(cases()) + len(agreements()) + len(refusals())
    assert done.output.count("passed") == rows * len(kernels.instruction_sets()) + len(function_cases())
    page = (tmp_path / "good" / "stress.md").read_text()
    assert "All cases pass." in page
    assert "It does not drift." in page
    assert "\n| 60 | " in page
    assert "\n| one Gaussian | 1e-05 | " in page
    assert "\n| NaN in means | yes |\n" in page
    assert all(len(set(widths)) == 1 for widths in widths_of_tables(page))
    assert (tmp_path / "good" / "stress.png").stat().st_size > 50_000
    some = [by_name("radius 1 px"), by_name("one Gaussian")]
    monkeypatch.setattr("research.studies.stress.check.cases", lambda: some)
    monkeypatch.setitem(surrogate.splatting.BACKENDS, "wrong", drawn_wrong(brighter))
    done = CliRunner().invoke(main, ["stress", "--backend", "wrong", "--no-drift", "-o", str(tmp_path / "bad")])
    assert done.exit_code == 1
    page = (tmp_path / "bad" / "stress.md").read_text()
    assert "image error" in page
    assert all(case.name in page for case in some)  # no row after a missed one is left out


def test_the_reference_draws_a_case_once_for_all_backends(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, some = [], [by_name("one Gaussian"), by_name("radius 1 px")]
    monkeypatch.setattr("research.studies.stress.check.cases", lambda: some)
    monkeypatch.setattr(
        "research.studies.stress.check.draw_reference", lambda case: (drawn.append(case), draw_reference(case))[1]
    )
    backends = {name: {"instruction_set": name} for name in kernels.instruction_sets()}
    found = tables(backends)
    assert drawn == some
    assert list(found) == list(backends)
    for name, outcomes in found.items():
        assert len(outcomes) == len(some) + len(agreements()) + len(refusals())
        alone = check(some[1], backends[name])
        assert (outcomes[1].image, outcomes[1].gradients) == (alone.image, alone.gradients)


@pytest.mark.cuda
@pytest.mark.skipif(bool(cuda.unusable()), reason=f"the GPU's kernels are not tested: {cuda.unusable()}")
def test_hard_cases_are_finite_on_a_gpu() -> None:
    assert all(outcome.finite for outcome in tables({"cuda": {"backend": "cuda"}})["cuda"])
