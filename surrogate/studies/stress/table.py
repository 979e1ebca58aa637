"""All rows, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from surrogate.splatting import BACKENDS
from surrogate.studies.stress.cases import Agreement, Case, Refusal, agreements, cases, refusals
from surrogate.studies.stress.check import Outcome, check, check_agreement, check_refusal, draw_twin

Backend = Mapping[str, Any]  # options of `surrogate.splatting.render`


def tables(
    backends: Mapping[str, Backend], tell: Callable[[str, Outcome], None] = lambda *_: None
) -> dict[str, list[Outcome]]:
    """Hold backends to every row, each by its name; `tell` hears of each outcome.  The twin draws a case once for all."""
    compiled = [getattr(BACKENDS.get(b.get("backend", "cpu")), "COMPILED", None) for b in backends.values()]
    floors = {constants["alpha_floor"] for constants in compiled if constants}  # gsplat has but one alpha floor
    found: dict[str, list[Outcome]] = {name: [] for name in backends}
    rows: list[Case | Agreement | Refusal] = [
        *(case for case in cases() if floors <= {case.constants.alpha_floor}),
        *agreements(),
        *refusals(),
    ]
    for row in rows:
        for name, outcome in zip(backends, _checked(row, list(backends.values())), strict=True):
            found[name].append(outcome)
            tell(name, outcome)
    return found


def _checked(row: Case | Agreement | Refusal, backends: list[Backend]) -> list[Outcome]:
    if isinstance(row, Case):
        twin = draw_twin(row)
        return [check(row, backend, twin) for backend in backends]
    if isinstance(row, Agreement):
        return [check_agreement(row, backend) for backend in backends]
    return [check_refusal(row, backend) for backend in backends]
