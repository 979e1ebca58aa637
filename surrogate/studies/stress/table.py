"""All rows, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from surrogate.splatting import BACKENDS
from surrogate.studies.stress.cases import Agreement, Case, agreements, cases, refusals
from surrogate.studies.stress.check import Outcome, check, check_agreement, check_refusal


def table(backend: Mapping[str, Any], say: Callable[[Outcome], None] = lambda _: None) -> list[Outcome]:
    """Hold a backend, given by options of `surrogate.splatting.render`, to every row; `say` hears of each when it is done."""
    found = []
    compiled = getattr(BACKENDS.get(backend.get("backend", "cpu")), "COMPILED", {"alpha_floor": None})["alpha_floor"]
    offered = [case for case in cases() if compiled in (None, case.alpha_floor)]  # gsplat has but one alpha floor
    for row in (*offered, *agreements(), *refusals()):
        outcome = _checked(row, backend)
        say(outcome)
        found.append(outcome)
    return found


def _checked(row: Any, backend: Mapping[str, Any]) -> Outcome:
    if isinstance(row, Case):
        return check(row, backend)
    return check_agreement(row, backend) if isinstance(row, Agreement) else check_refusal(row, backend)
