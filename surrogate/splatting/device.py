"""Where tensors live: on a GPU where there is one that can be used, else in main memory."""

from __future__ import annotations

import torch

from surrogate.splatting import cuda


def chosen(device: str) -> torch.device:
    """The device that a setting means: "auto" is a GPU where torch and gsplat can use one.

    Raises RuntimeError saying what is missing where "cuda" is asked for in vain.
    """
    reason = cuda.unusable()
    if device == "cuda" and reason:
        raise RuntimeError(f'training.device is "cuda", but {reason}')
    return torch.device("cpu" if device == "cpu" or reason else "cuda")
