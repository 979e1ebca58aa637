"""A data set is estimated before it is made, and took not far from that in the end."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.store.sizes import Sizes, sizes_of
from catalogs.vocabulary.scene import Scene
from insitu.cli import main
from insitu.ensembles.dataset import make_dataset
from insitu.ensembles.estimate import Estimate, estimate
from tests.support.looks import LOOK
from tests.support.scenes import REYNOLDS, SIMULATED

FLOW = f"""
name = "flow"
{SIMULATED}resolution = 8
time = 0.2
{REYNOLDS}
[members]
train = [100.0, 200.0]
test = [150.0]
[views]
frequency = 3
width = 16
height = 16
[render]
sample_distance = 0.5
{LOOK}"""


@pytest.mark.slow
def test_images_and_fields_are_estimated(tmp_path: Path) -> None:
    (tmp_path / "flow.toml").write_text(FLOW)
    scene = Scene.load(tmp_path / "flow.toml")
    expected = estimate(scene)
    made = make_dataset(scene, tmp_path / "runs", workers=1)
    sizes = sum(map(sizes_of, Catalog.open(made.catalog).members), Sizes(whole=True))
    assert (expected.members, expected.images, expected.tried) == (3, 3 * 92, (1, 12))
    assert 0.7 < expected.sizes.images / sizes.images < 1.4
    assert 0.7 < expected.sizes.fields / sizes.fields < 1.4
    assert (expected.sizes.views, expected.sizes.whole) == (sizes.views, sizes.whole) == (92, True)
    said = CliRunner().invoke(main, ["estimate", str(tmp_path / "flow.toml")])
    assert said.exit_code == 0, said.output
    assert "3 members with 276 images, by 12 views of 1:" in said.output
    assert not list(tmp_path.glob("*.cdb"))


def test_advice_is_given_where_fields_are_whole() -> None:
    text = str(Estimate(100, 25_200, Sizes(127_000_000, 7_800_000, 252, True), 60.0, 120.0, (5, 12)))
    assert "127 MB of images, 7.8 MB of fields" in text
    assert "fewer than 252 views may do" in text


def test_what_is_not_rendered_is_not_estimated(tmp_path: Path) -> None:
    text = 'name = "other"\n[source]\nkind = "nerf"\npath = "x"\nbounds = [[0, 0, 0], [1, 1, 1]]\n'
    (tmp_path / "other.toml").write_text(text)
    said = CliRunner().invoke(main, ["estimate", str(tmp_path / "other.toml")])
    assert said.exit_code == 1
    assert "nothing of it is rendered here" in said.output
