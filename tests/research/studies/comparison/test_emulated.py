"""The emulated field is compared where members keep coarse fields, with its own size, and may lead."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.splits import Splits
from research.studies.comparison.methods import CONTESTANTS, EMULATED, chosen
from research.studies.comparison.page import tables
from research.studies.comparison.reduced import reduced
from research.studies.comparison.result import TRIVIAL, load
from research.studies.comparison.run import RunOptions, study_of
from research.studies.comparison.task import ComparisonTask
from tests.research.support.comparisons import study
from tests.support.field_catalogs import rendered


def test_it_is_a_row_of_its_own(tmp_path: Path) -> None:
    catalog = rendered(tmp_path / "a.cdb", surface=False)
    made = study(ComparisonTask.of(catalog), tmp_path, CONTESTANTS[EMULATED])
    made.run()
    results = load(made.records)
    [result] = [r for r in results if r.method != TRIVIAL]
    assert not result.error
    assert (result.method, result.steps) == (EMULATED, 1)
    assert 0.0 < result.megabytes < 0.1
    assert result.seconds > 0.0
    assert result.cells["both"]["psnr"] > 40.0
    assert result.picture_milliseconds is not None
    row = next(line for line in tables(results).splitlines() if line.startswith("| emulated field, drawn |"))
    assert "**" in row


@pytest.mark.parametrize("kept", [True, False])
def test_it_is_usual_where_members_keep_fields(tmp_path: Path, kept: bool) -> None:
    catalog = rendered(tmp_path / "a.cdb", surface=False, coarse_field=kept)
    made = study_of("a", catalog, tmp_path / "run", tmp_path / "records", RunOptions())
    assert (EMULATED in [contestant.name for contestant in made.contestants]) == kept
    assert [contestant.name for contestant in chosen([EMULATED])] == [EMULATED]


def test_smaller_images_keep_the_fields(tmp_path: Path) -> None:
    catalog = rendered(tmp_path / "a.cdb", surface=False)
    made = reduced(catalog.with_splits(Splits({m.name: m.split for m in catalog.members})), tmp_path / "small.cdb")
    for member, copy in zip(catalog.members, made.members, strict=True):
        [field], [other] = member.coarse_fields().values(), copy.coarse_fields().values()
        np.testing.assert_allclose(other.values, field.values, atol=1e-5)
        assert (other.spacing, other.origin, other.whole) == (field.spacing, field.origin, field.whole)
