"""Ensembles on a Dask cluster whose workers are killed while they render, and before finished members are gathered.

    python -m research.benchmarks.ensembles.kills [--kills 50] [--members 10]

Renders small ensembles one after the other until enough workers were killed. Each is killed with SIGKILL and replaced.
Fails unless every member is there once, whole, and nothing else.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np

from catalogs.engines.address import opened
from catalogs.engines.cluster import Cluster
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, ViewPlan
from insitu.ensembles.ensemble import EnsembleResult, run_ensemble
from insitu.members.planning import PlanOptions
from tests.support.local_cluster import LocalCluster, local_cluster

WAIT_SECONDS = 60.0  # wait for an opportunity to kill
SPACE = ParameterSpace((Parameter("w", 0.0, 1.0),))
VOLUME = VolumeRendering(
    "dvr", TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)
)
OPTIONS = PlanOptions(SPACE, (VOLUME,), ViewPlan(frequency=3, width=32, height=32), sample_distance=0.1)


@dataclass(frozen=True)
class Blobs:
    """Fields of blobs of width `w`, (8, 8, 8)."""

    expensive: bool = False

    @property
    def identity(self) -> Mapping[str, Any]:
        return {"kind": "blob"}

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Any:
        import pyvista as pv

        axes = np.meshgrid(*[np.linspace(-1.0, 1.0, 8)] * 3, indexing="ij")
        grid = pv.ImageData(dimensions=(8, 8, 8), spacing=(0.2, 0.2, 0.2))
        values = np.exp(-sum(a**2 for a in axes) / (0.1 + member.parameters["w"]))
        grid["values"] = values.astype(np.float32).ravel()
        return grid


def planned(count: int) -> list[PlannedMember]:
    return [PlannedMember(f"m{i:02d}", {"w": i / (count - 1)}, "train") for i in range(count)]


@dataclass
class Killer:
    """The `progress` of an ensemble; gathering pauses while it waits for an opportunity to kill a worker."""

    workers: LocalCluster
    engine: Cluster
    catalog: Path
    left: int
    rendering: int = 0
    gathering: int = 0
    chance: random.Random = field(default_factory=lambda: random.Random(0))

    def __call__(self, state: Any) -> None:
        if self.left <= self.rendering + self.gathering or not state.images or state.members_done == state.members:
            return
        late = self.gathering <= self.rendering
        until = time.monotonic() + WAIT_SECONDS
        while time.monotonic() < until and not (victim := self._holder() if late else self._renderer()):
            if not late and self._stored() == state.members:
                return
            time.sleep(0.005)
        if victim and self._kill(victim):
            self.gathering += late
            self.rendering += not late

    def _stored(self) -> int:
        return len(list((self.catalog / "members").iterdir()))

    def _holder(self) -> str:
        """The address of a worker that holds the result of a finished task which is not gathered yet."""
        return next((address for address, keys in self.engine.client.has_what().items() if keys), "")

    def _renderer(self) -> str:
        """The address of a busy worker, while a member is half written."""
        if not list(self.catalog.glob(".unfinished/*/dvr/*")):
            return ""
        busy = [address for address, keys in self.engine.client.processing().items() if keys]
        return self.chance.choice(busy) if busy else ""

    def _kill(self, address: str) -> bool:
        pid = self.engine.client.run(_pid, workers=[address], on_error="ignore").get(address)
        for process in [p for p in self.workers.workers if p.pid == pid]:
            self.workers.add_worker()
            self.workers.kill(process)
            return True
        return False


def _pid() -> int:
    import os

    return os.getpid()


def killed_ensemble(workers: LocalCluster, catalog: Path, members: int, kills: int) -> tuple[EnsembleResult, Killer]:
    """Render an ensemble of `members` while up to `kills` workers are killed; raises RuntimeError unless each member is
    there once."""
    with opened(workers.address, [catalog]) as engine:
        assert engine is not None
        killer = Killer(workers, engine, catalog, kills)
        result = run_ensemble(catalog, planned(members), Blobs(), OPTIONS, engine=engine, progress=killer)
    wanted = [member.name for member in planned(members)]
    stored = [member.name for member in Catalog.open(catalog).members]
    reported = sorted([*(m.name for m in result.rendered), *result.skipped])
    wrong = [str(problem) for problem in check(catalog)]
    if result.failures or stored != wanted or reported != wanted or wrong:
        raise RuntimeError(
            f"{catalog}: stored {stored}, reported {reported}, failed {dict(result.failures)}, wrong {wrong}"
        )
    return result, killer


@click.command()
@click.option("--kills", default=50, show_default=True)
@click.option("--members", default=10, show_default=True, help="Of each ensemble.")
def main(kills: int, members: int) -> None:
    rendering = gathering = ensembles = 0
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name, local_cluster(Path(name), workers=3) as workers:
        while rendering + gathering < kills:
            ensembles += 1
            left = kills - rendering - gathering
            _, killer = killed_ensemble(workers, Path(name) / f"{ensembles}.cdb", members, min(left, members - 2))
            rendering, gathering = rendering + killer.rendering, gathering + killer.gathering
            click.echo(f"ensemble {ensembles}: {rendering + gathering} kills, {time.monotonic() - began:.0f} s")
    click.echo(
        f"{rendering + gathering} workers killed, {rendering} while rendering and {gathering} between finishing and gathering: "
        f"all {members * ensembles} members of {ensembles} ensembles are there, each once"
    )


if __name__ == "__main__":
    main()
