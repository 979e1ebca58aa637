"""Arrays of other libraries, with gradients, on devices and of types that numpy does not know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from render.arrays import plain_array
from render.datasets import to_grid

VALUES = np.arange(24.0).reshape(2, 3, 4)
TENSOR = torch.from_numpy(VALUES)


class OnDevice:
    """An array on a device: DLPack refuses it without a copy, as it does for cupy's and jax's arrays."""

    dtype, device, shape = np.dtype("float64"), "gpu:0", VALUES.shape

    def __dlpack__(self, **options: Any) -> Any:
        raise BufferError("this buffer lies on another device")

    def __dlpack_device__(self) -> tuple[int, int]:
        return (2, 0)


class Copied(OnDevice):
    def get(self) -> np.ndarray:
        return VALUES


class Converted(OnDevice):
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return VALUES


ARRAYS: dict[str, Any] = {
    "lists": VALUES.tolist(),
    "a tensor": TENSOR,
    "a tensor with gradients": TENSOR.clone().requires_grad_(),
    "a tensor within a graph": TENSOR.clone().requires_grad_() * 1.0,
    "bfloat16": TENSOR.to(torch.bfloat16),
    "bfloat16 with gradients": TENSOR.to(torch.bfloat16).requires_grad_(),
    "8-bit floats": TENSOR.to(torch.float8_e5m2).to(torch.float32).to(torch.float8_e5m2),
    "half precision": TENSOR.half(),
    "integers": TENSOR.to(torch.int16),
    "not contiguous": TENSOR.permute(2, 1, 0).contiguous().permute(2, 1, 0),
    "an array of cupy's kind": Copied(),
    "an array of jax's kind": Converted(),
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_an_array_is_read_wherever_it_lies(kind: str) -> None:
    found = plain_array(ARRAYS[kind])
    assert type(found) is np.ndarray
    assert np.allclose(found, VALUES, rtol=0.15 if kind == "8-bit floats" else 0.0)
    assert to_grid(ARRAYS[kind]).shape == (2, 3, 4)


def test_what_lies_in_main_memory_is_shared() -> None:
    assert np.shares_memory(plain_array(TENSOR), VALUES)
    assert np.shares_memory(plain_array(TENSOR.clone().requires_grad_().detach().copy_(TENSOR)), VALUES) is False


@pytest.mark.parametrize(
    ("array", "reason"),
    [
        (OnDevice(), "OnDevice of float64 on gpu:0 can't be read"),
        (TENSOR.to("meta"), "Tensor of torch.float64 on meta"),
    ],
    ids=["a device", "no values"],
)
def test_what_cannot_be_read_is_told_with_a_remedy(array: Any, reason: str) -> None:
    with pytest.raises(TypeError, match=rf"a {reason}.*pass its values as a numpy array in main memory") as caught:
        plain_array(array)
    assert len(str(caught.value).splitlines()) == 1
