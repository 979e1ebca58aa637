"""Parameters with names that other parts have a use for."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import insitu
from catalogs.cli import main
from catalogs.files import cinema
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from tests.support.hooked import FUNCTION, SPACING, blob

SMALL = ViewPlan(frequency=1, width=8, height=8)


@pytest.mark.parametrize(
    "name", ["theta", "view", "member", "appearance", "isovalue", "profile", "FILE", "self", "lambda", "1"]
)
def test_any_name_is_a_parameter(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.cdb"
    looks = [VolumeRendering("dvr", FUNCTION), Isosurface("surface", 0.5)]
    with insitu.Session(path, space={name: (0, 1)}, appearances=looks, views=SMALL, sample_distance=0.1) as session:
        for value in (0.25, 0.75):
            session.render_member(blob(), {name: value}, spacing=SPACING)
    assert check(path) == []
    catalog = Catalog.open(path)
    assert [dict(m.parameters) for m in catalog.members] == [{name: 0.25}, {name: 0.75}]
    header, rows = cinema.parse((path / "data.csv").read_text())
    assert header[0] == catalog.plan.parameter_labels[0]
    np.testing.assert_array_equal(sorted({float(row[0]) for row in rows}), [0.25, 0.75])
    assert CliRunner().invoke(main, ["split", str(path), str(tmp_path / "b.cdb"), "--rows", "100"]).exit_code == 0


@pytest.mark.parametrize("name", [" Re", "Re ", "R\te", "Re\u200b", "  "])
def test_names_with_signs_that_nobody_sees_are_refused_at_once(name: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="name"):
        insitu.Session(tmp_path / "a.cdb", space={name: (0, 1)}, appearances=VolumeRendering("dvr", FUNCTION))


def test_a_parameter_named_like_a_visualization_parameter_is_refused_at_once(tmp_path: Path) -> None:
    family = insitu.isovalue_family("iso", train=[0.3, 0.5, 0.7])
    with pytest.raises(ValueError, match="'isovalue' has the name of a visualization parameter"):
        insitu.Session(
            tmp_path / "a.cdb",
            space={"isovalue": (0, 1)},
            appearances=[Isosurface("iso", 0.5), *family.appearances],
            variations=[family.variation],
        )
