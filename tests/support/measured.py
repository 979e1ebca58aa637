"""Rows of what was measured, made up."""

from __future__ import annotations

from collections.abc import Sequence

from surrogate import Surrogate
from surrogate.explore.reliability.expectation import Expectation
from surrogate.explore.reliability.measuring import Measurement
from tests.support.models import plain


def measured(split: str, p: float, *psnr: float, varied: dict[str, float | str] | None = None) -> Measurement:
    """A member of the plain surrogate's ensemble."""
    return Measurement(f"{split}-{p:g}", split, {"p": p}, "dvr", varied or {}, psnr, seen_views=False)


def expected(rows: Sequence[Measurement], surrogate: Surrogate | None = None) -> Expectation:
    """The expectation from these rows, without a catalog."""
    return Expectation.of(rows, surrogate or plain(), ())
