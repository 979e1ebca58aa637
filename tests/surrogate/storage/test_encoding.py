from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from surrogate.storage.encoding import FORMATS, LEVELS, Encoding, encode

FINITE = st.floats(-(2.0**100), 2.0**100, width=32)


@pytest.mark.parametrize("form", sorted(LEVELS))
@given(values=arrays.arrays(np.float32, st.tuples(st.integers(0, 7), st.integers(1, 4)), elements=FINITE))
def test_no_value_is_off_by_more_than_half_a_level(form: str, values: np.ndarray) -> None:
    decoded = encode(torch.from_numpy(values), form).decoded().double().numpy()
    if len(values):
        spread = values.max(0).astype(np.float64) - values.min(0)
        rounding = 4e-7 * np.abs(values).max(0) + 1e-40  # low and step are float32 numbers themselves
        assert (np.abs(decoded - values) <= 0.5 * spread / LEVELS[form][1] * (1 + 1e-5) + rounding).all()
    assert decoded.shape == values.shape


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("shape", [(0, 3), (1, 3), (50, 3), (50,), (0,)])
def test_the_same_comes_back_from_what_is_stored(form: str, shape: tuple[int, ...]) -> None:
    tensor = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    encoding = encode(tensor, form)
    again = Encoding.of_tensors(form, encoding.tensors())
    assert torch.equal(again.decoded(), encoding.decoded())
    assert encoding.decoded().dtype == torch.float32
    stored = sum(t.numel() * t.element_size() for t in encoding.tensors().values())
    assert encoding.saved_bytes == 4 * tensor.numel() - stored


def test_a_constant_column_is_kept_exactly() -> None:
    tensor = torch.tensor([[0.1, 5.0], [0.1, -7.0]])
    for form in LEVELS:
        assert torch.equal(encode(tensor, form).decoded()[:, 0], tensor[:, 0])


@pytest.mark.parametrize(
    ("form", "change"),
    [
        ("uint8", {"codes": torch.zeros(4, 3)}),
        ("uint8", {"low": torch.zeros(2)}),
        ("uint8", {"step": torch.full((3,), torch.nan)}),
        ("uint8", {"step": torch.zeros(3, dtype=torch.float64)}),
        ("uint8", {"more": torch.zeros(3)}),
        ("float16", {}),
        ("uint4", {}),
        ("__class__", {}),
    ],
)
def test_what_can_not_be_an_encoding_is_refused(form: str, change: dict[str, torch.Tensor]) -> None:
    tensors = encode(torch.randn(4, 3), "uint8").tensors() | change
    with pytest.raises(ValueError, match=r"must (consist of|be 3 finite)"):
        Encoding.of_tensors(form, tensors)
