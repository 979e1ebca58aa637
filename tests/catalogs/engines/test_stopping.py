"""Cancelled tasks outside of a cluster's workers; `test_cluster` tests those of workers."""

from __future__ import annotations

import sys

import pytest

from catalogs.engines.stopping import stop_requested


@pytest.mark.parametrize("is_installed", [True, False])
def test_nobody_takes_back_what_no_engine_runs(is_installed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if is_installed:
        pytest.importorskip("distributed", reason="Dask is not installed: pip install gs-surrogate[dask]")
    else:
        monkeypatch.delitem(sys.modules, "distributed", raising=False)
    assert not stop_requested()
