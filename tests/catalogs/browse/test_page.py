"""The page's text, and the files that it does not change."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.browse import page_of, write_page
from catalogs.browse.description import describe
from catalogs.cli import main
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.cameras import icosphere, view_splits
from catalogs.vocabulary.parameters import SPLITS, Parameter, ParameterSpace
from tests.catalogs.browse.conftest import GRID, grid_plan
from tests.support.synthetic import synthetic_catalog


def data_of(page: str) -> dict[str, Any]:
    match = re.search(r'<script type="application/json" id="catalog">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return json.loads(match.group(1))


def test_the_page_names_every_picture(grid: Catalog) -> None:
    data = data_of(page_of(grid))
    members = data["members"]
    assert members["viewpoints"] is members["appearances"] is None, "all have the only ones"
    for name in members["names"]:
        for appearance in data["appearances"]:
            for file in data["files"]:
                assert (grid.path / f"members/{name}/{appearance['name']}/{file}").is_file()
    assert dict(zip(members["names"], zip(*members["values"], strict=True), strict=True)) == {
        f"m{i}": point for i, point in enumerate(GRID)
    }
    assert members["splits"] == "000002"
    assert [[SPLITS[int(digit)] for digit in digits] for digits in data["view_splits"]] == [list(view_splits(42))]
    assert data["background"] is None


def test_the_page_names_only_pictures_that_members_show(varied: Catalog) -> None:
    data = data_of(page_of(varied))
    named = set()
    for name, offered in zip(data["members"]["names"], data["members"]["appearances"], strict=True):
        for number in data["appearance_sets"][offered]:
            named |= {f"members/{name}/{data['appearances'][number]['name']}/{file}" for file in data["files"]}
    assert named == {path.relative_to(varied.path).as_posix() for path in varied.path.rglob("*.png")}


def test_visualization_parameters_stand_beside_their_appearances(varied: Catalog, grid: Catalog) -> None:
    data = describe(varied)
    columns = {p["name"]: dict(zip(varied.appearance_names, p["values"], strict=True)) for p in data["visualization"]}
    assert list(columns) == ["isovalue", "c1_value", "c1_opacity", "c2_value", "c2_opacity"]
    assert columns["isovalue"]["iso=0.5"] == 0.5
    assert columns["isovalue"]["dvr"] is columns["c1_value"]["iso=0.5"] is None
    for name in ("dvr", "dvr-train-07"):
        (shown,) = (a for a in varied.plan.appearances if a.name == name)
        assert isinstance(shown, VolumeRendering)
        (_, *inner, _) = shown.transfer_function.opacity_points
        assert [columns[p][name] for p in list(columns)[1:]] == pytest.approx(
            [part for point in inner for part in point]
        )
    assert describe(grid)["visualization"] == []


def test_many_members_stay_compact(tmp_path: Path) -> None:
    catalog = synthetic_catalog(tmp_path / "many.cdb", members=300, views=1, parameters=6)
    few = synthetic_catalog(tmp_path / "few.cdb", members=1, views=1, parameters=6)
    assert (len(page_of(catalog)) - len(page_of(few))) / 299 < 100


def test_settings_have_titles_and_groups(varied: Catalog, catalog: Catalog) -> None:
    appearances = {a["name"]: a for a in describe(varied)["appearances"]}
    assert appearances["dvr"] == {"name": "dvr", "title": "dvr", "kind": "dvr"}
    assert appearances["dvr-train-07"] == {
        "name": "dvr-train-07",
        "title": "dvr-train-07 (c1_value 0.2, c1_opacity 0.1, c2_value 0.7)",
        "kind": "transfer functions",
        "group": "transfer functions, train",
    }
    assert appearances["dvr-train-65"]["title"] == "dvr-train-65 (c1_value 0.2)"
    assert appearances["dvr-test-01"]["group"] == "transfer functions, test"
    assert appearances["iso=0.5"] == {
        "name": "iso=0.5",
        "title": "iso=0.5 (isovalue 0.5)",
        "kind": "isovalues",
        "group": "isovalues, test",
    }
    assert not any("group" in a for a in describe(catalog)["appearances"])


def test_viewpoints_are_seen_from_the_middle_of_the_box(grid: Catalog) -> None:
    (points,) = describe(grid)["viewpoints"]
    np.testing.assert_allclose(np.array(points)[:, :3], icosphere(2), atol=2e-6)
    np.testing.assert_allclose(np.array(points)[:, 3:], [c.up for c in grid.plan.cameras], atol=2e-6)


def test_a_hostile_name_stays_text(tmp_path: Path) -> None:
    plan = grid_plan(space=ParameterSpace((Parameter("</script><script>alert(1)</script>", 0.0, 1.0),)))
    page = page_of(Catalog.create(tmp_path / "x.cdb", plan))
    assert page.count("<script") == 2
    assert data_of(page)["parameters"][0]["name"] == "</script><script>alert(1)</script>"


def test_the_page_asks_nobody_else(grid: Catalog) -> None:
    page = page_of(grid)
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", page)
    assert "default-src 'none'" in page


def test_the_page_leaves_the_catalog_valid_and_replaces_itself(catalog: Catalog) -> None:
    assert check(catalog.path) == []
    page = write_page(catalog.path)
    assert page == catalog.path / "index.html"
    page.write_text("old")
    assert "<html" in write_page(catalog.path).read_text()
    assert check(catalog.path) == []
    assert [p.name for p in catalog.path.iterdir() if "partial" in p.name] == []


def test_what_can_not_be_browsed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CatalogError, match="exr images, which no browser shows"):
        page_of(Catalog.create(tmp_path / "x.cdb", grid_plan(image_format="exr")))
    with pytest.raises(CatalogError, match=r"catalog\.json is missing"):
        write_page(tmp_path)
    assert list(tmp_path.glob("*.html")) == []
    result = CliRunner().invoke(main, ["browse", str(tmp_path / "nothing.cdb")])
    assert result.exit_code == 1
    assert "catalog.json is missing" in result.output


def test_the_title_tells_catalogs_apart(tmp_path: Path) -> None:
    assert describe(Catalog.create(tmp_path / "runs/nyx/catalog.cdb", grid_plan()))["title"] == "nyx"
    assert describe(Catalog.create(tmp_path / "mine.cdb", grid_plan()))["title"] == "mine"
    plan = grid_plan(provenance={"scene": "tgv"})
    assert describe(Catalog.create(tmp_path / "other.cdb", plan))["title"] == "tgv"
