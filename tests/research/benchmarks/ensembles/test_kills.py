"""Workers of a cluster are killed; no member is lost, and none is there twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from research.benchmarks.ensembles.kills import killed_ensemble
from tests.support.local_cluster import local_cluster

pytest.importorskip("distributed", reason="Dask is not installed: pip install gs-surrogate[dask]")


@pytest.mark.slow
def test_an_ensemble_outlives_its_workers(tmp_path: Path) -> None:
    with local_cluster(tmp_path, workers=2) as workers:
        result, killer = killed_ensemble(workers, tmp_path / "a.cdb", members=12, kills=4)
    assert min(killer.rendering, killer.gathering) >= 1
    assert len(result.rendered) + len(result.skipped) == 12
