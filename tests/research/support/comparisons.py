"""A comparison of methods on a few small pictures."""

from __future__ import annotations

from pathlib import Path

from research.studies.baselines.method import Plan
from research.studies.comparison.contestants import Published
from research.studies.comparison.study import ComparisonStudy
from research.studies.comparison.task import ComparisonTask
from tests.research.support.mean_pictures import mean_method
from tests.support.blobs import Blobs

MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.25), ("test", 0.5))
SMALL = Blobs(count=3, size=16)
VIEWS = ("train",) * 4 + ("validation", "test")
SECOND = 0.03 / 60.0  # minutes


def study(task: ComparisonTask, tmp_path: Path, *contestants: Published, **asked) -> ComparisonStudy:
    made = contestants or (Published(mean_method()),)
    form = {"minutes": (SECOND,), "seeds": 1, "plan": Plan(1), **asked}
    return ComparisonStudy(
        task, tmp_path / "comparison", tmp_path / "records" / "blobs", tmp_path / "records", made, **form
    )
