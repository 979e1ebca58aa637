"""C++ kernels behind plain arrays: splatting with its gradient, and the image loss.  No torch, no logic.

`forward`, `backward`, `image_loss` and `instruction_sets` load the compiled module when first used.  Arrays are float32 and
C-contiguous; the same input gives bitwise the same output for any number of threads.
"""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["backward", "forward", "image_loss", "instruction_sets"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(importlib.import_module("native._kernels"), name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("the C++ kernels are not built: run `make setup`, or `pip install .`") from error
