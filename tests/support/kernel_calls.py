"""Which C++ kernels are called."""

from __future__ import annotations

import pytest

from native import kernels


def recorded(monkeypatch: pytest.MonkeyPatch, *names: str) -> list[str]:
    """A list that the names of these kernels are appended to whenever they are called."""
    calls: list[str] = []
    for name in names:
        kernel = getattr(kernels, name)
        monkeypatch.setattr(
            kernels, name, lambda *a, name=name, kernel=kernel: (calls.append(name), kernel(*a))[1], raising=False
        )
    return calls
