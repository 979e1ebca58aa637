"""The environment may choose the kernels; a wrong name is named."""

from __future__ import annotations

import numpy as np
import pytest

from native import kernels


def loss(**options: str) -> float:
    random = np.random.default_rng(0)
    image, target = (random.random((17, 19, 3), dtype=np.float32) for _ in range(2))
    _, _, gradient = kernels.image_loss(image, target, 0.2, 1, **options)
    return float(np.abs(gradient).astype(np.float64).sum())


@pytest.mark.parametrize("name", kernels.instruction_sets())
def test_the_environment_chooses_where_no_argument_does(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    others = {other: loss(instruction_set=other) for other in kernels.instruction_sets()}
    monkeypatch.setenv("GS_SURROGATE_INSTRUCTION_SET", name)
    assert loss() == others[name]
    assert {other: loss(instruction_set=other) for other in others} == others


def test_a_wrong_name_in_the_environment_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_INSTRUCTION_SET", "abacus")
    with pytest.raises(
        ValueError, match=r"'abacus' of GS_SURROGATE_INSTRUCTION_SET is none of this machine's: .*baseline"
    ):
        loss()
