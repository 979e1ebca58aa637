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
    assert "3 members with 276 images, extrapolated from 12 views of 1:" in said.output
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


def test_time_and_bytes_of_a_member_are_those_of_all_shared_out() -> None:
    expected = Estimate(100, 25_200, Sizes(100_000_000, 0, 252, False), 50.0, 300.0, (5, 12), 10.0, 3.0)
    assert "a member: 1 MB, 3.6 s of one core (0.5 s for its field, 3 s for images, 0.1 s for the rest)" in str(
        expected
    )
    assert "all: 6.05 minutes on one core, 36 s on 10; the first member takes 3 s" in expected.on(10)
    assert "3.6 s on 500" in expected.on(500)  # no more cores than members have work


def test_any_field_is_estimated_without_a_scene() -> None:
    asked = ["estimate", "--samples", "16", "--size", "24", "--frequency", "2", "--members", "10", "--cores", "2"]
    said = CliRunner().invoke(main, asked)
    assert said.exit_code == 0, said.output
    assert "10 members with 420 images, extrapolated from 12 views of 2:" in said.output
    assert "on one core" in said.output
    for wrong in (["estimate"], ["estimate", "--samples", "16", "scene.toml"]):
        refused = CliRunner().invoke(main, wrong)
        assert refused.exit_code != 0
