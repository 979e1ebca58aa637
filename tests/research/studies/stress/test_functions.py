"""The rows about transfer functions hold, and do not hold for a kernel that is wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from research.studies.stress.functions import FunctionCase, average_error, check_function, function_cases, gaussians_of
from surrogate.appearance.transferred import AverageTable, apply


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in function_cases()])
def test_every_hard_function_holds(case: FunctionCase) -> None:
    outcome = check_function(case)
    assert outcome.passed, outcome.complaints


RAMP = next(case for case in function_cases() if case.name == "spreads from 1e-30 to 1e30")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda logits, colors: (logits + 1e-3, colors), "shown wrong by"),
        (lambda logits, colors: (logits, colors * torch.tensor([1.0, 1.0, 1.001])), "shown wrong by"),
        (lambda logits, colors: (logits.detach() + 0.99 * (logits - logits.detach()), colors), "gradient wrong by"),
        (lambda logits, colors: (logits * torch.nan, colors), "not finite"),
    ],
    ids=["opacity", "colour", "gradient", "NaN"],
)
def test_what_is_wrong_is_found(change, complaint: str) -> None:
    def wrong(table: AverageTable, logits: torch.Tensor, values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        found = apply(table, logits, values)
        return change(*found) if logits.dtype == torch.float32 else found

    assert any(complaint in said for said in check_function(RAMP, wrong).complaints)


def test_an_average_that_is_wrong_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Quadrature knows the function itself, not its nodes."""
    import research.studies.stress.functions as functions

    right = functions.resampled
    assert average_error(RAMP) < 1e-4

    def thicker(*asked):
        nodes = right(*asked)
        return replace(nodes, columns=1.001 * nodes.columns)

    monkeypatch.setattr(functions, "resampled", thicker)
    assert average_error(RAMP) == pytest.approx(1e-3, rel=0.1)


def test_a_constant_field_has_one_value() -> None:
    case = next(case for case in function_cases() if case.name == "a constant field, on a ramp")
    _, values = gaussians_of(case)
    assert values[:, 0].unique().tolist() == [0.25]
    assert values[:, 1].exp().max() < 1e-10
